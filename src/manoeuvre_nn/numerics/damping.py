"""Damping rules of Levenberg-Marquardt and the reasons to stop, for many independent problems at once."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Count, NotNegative, Positive

Rule = Literal["trainlm", "nielsen"]


class Reason(StrEnum):
    """Why a problem is no longer worked on; its number is its place in this list, and stored states keep numbers."""

    RUNNING = ""
    GOAL = "goal reached"
    GRADIENT = "gradient below min_grad"
    DAMPING = "mu above mu_max: no step lowers the error any more"
    VALIDATION = "validation error rose max_fail times"
    NOT_FINITE = "error is not finite"
    STEP = "step below min_step"
    FALL = "error falls by less than min_fall"
    EPOCHS = "epochs used up"

    @property
    def code(self) -> float:
        """The number that stands for the reason in a tensor."""
        return float(list(Reason).index(self))


@dataclass(frozen=True)
class Stops:
    """When a problem is done.

    Attributes:
        epochs: Steps that it may take.
        goal: Mean square error that is enough.
        min_grad: Norm of the gradient of the mean square error that counts as flat.
        min_step: Step over weights that counts as none [-].
        min_fall: Fall of the error over the error that counts as none [-].
        max_fail: Rises of the validation error that end it, where there is one.
    """

    epochs: Count = 1000
    goal: NotNegative = 0.0
    min_grad: NotNegative = 1e-13
    min_step: NotNegative = 1e-12
    min_fall: NotNegative = 0.0
    max_fail: Count = 6

    def __post_init__(self) -> None:
        """Refuse what makes no sense.

        Raises:
            InputError: If ``max_fail`` is not positive.
        """
        if self.max_fail < 1:
            raise InputError(f"Levenberg-Marquardt with max_fail={self.max_fail}: expected at least 1")


@dataclass(frozen=True)
class Damping:
    """How mu follows the success of the steps.

    ``trainlm``: mu falls by a factor after a step that lowers the error and rises by another after one that does not.
    ``nielsen``: after a good step it falls by up to 3, the more the better the quadratic model foretold the fall; after
    bad ones it rises by 2, 4, 8 and so on.

    Attributes:
        rule: ``trainlm`` or ``nielsen``.
        mu: First damping; with ``nielsen`` relative to the largest diagonal element of J^T J [-].
        mu_dec: TRAINLM's factor after a step that lowers the error [-].
        mu_inc: Its factor after one that does not [-].
        mu_max: Damping above which a problem is given up.

    Source:
        Hagan & Menhaj 1994 (TRAINLM's rule); Nielsen 1999 in the form of Madsen, Nielsen & Tingleff 2004,
        algorithm 3.16. Deviation: mu never falls below the smallest normal number of its type, since from 0 no factor
        could raise it again.
    """

    rule: Rule = "trainlm"
    mu: Positive = 1e-3
    mu_dec: Positive = 0.1
    mu_inc: Positive = 10.0
    mu_max: Positive = 1e10

    def __post_init__(self) -> None:
        """Refuse what makes no sense.

        Raises:
            InputError: If the rule is unknown or a number is out of range.
        """
        check_choice("fit.damping", self.rule, ["trainlm", "nielsen"])
        if not (self.mu > 0 and 0 < self.mu_dec < 1 < self.mu_inc and self.mu_max > self.mu):
            raise InputError(
                f"Levenberg-Marquardt with mu={self.mu}, mu_dec={self.mu_dec}, mu_inc={self.mu_inc}, mu_max="
                f"{self.mu_max}: expected 0 < mu < mu_max and 0 < mu_dec < 1 < mu_inc"
            )

    def first(self, normal: Float[Tensor, "k p p"]) -> Float[Tensor, " k"]:
        """Damping of the first step.

        Args:
            normal: J^T J of every problem.

        Returns:
            mu.
        """
        largest = normal.diagonal(dim1=1, dim2=2).amax(1)
        return _floored(self.mu * largest if self.rule == "nielsen" else torch.full_like(largest, self.mu))

    def after(
        self,
        mu: Float[Tensor, " k"],
        nu: Float[Tensor, " k"],
        better: Bool[Tensor, " k"],
        move: Float[Tensor, "k p"],
        gradient: Float[Tensor, "k p"],
        fall: Float[Tensor, " k"],
    ) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"]]:
        """Damping after a step.

        Args:
            mu: Damping of that step.
            nu: Nielsen's factor for a step that fails, 2 at the start [-].
            better: Whether the step lowered the error.
            move: The step d.
            gradient: J^T e before it.
            fall: How much ``e^T e / 2`` fell; the quadratic model promised ``d^T (mu d - J^T e) / 2``.

        Returns:
            New mu and nu.
        """
        if self.rule == "trainlm":
            return _floored(torch.where(better, mu * self.mu_dec, mu * self.mu_inc)), nu
        promised = 0.5 * (move * (mu[:, None] * move - gradient)).sum(1)
        ratio = fall / promised.clamp(min=torch.finfo(mu.dtype).tiny)
        factor = (1 - (2 * ratio - 1) ** 3).clamp(min=1 / 3)
        return _floored(mu * torch.where(better, factor, nu)), torch.where(better, 2.0, 2 * nu)


def damped_step(
    normal: Float[Tensor, "k p p"], gradient: Float[Tensor, "k p"], mu: Float[Tensor, " k"]
) -> tuple[Float[Tensor, "k p"], Bool[Tensor, " k"]]:
    """Solve ``(J^T J + mu I) d = -J^T e`` of every problem by Cholesky's factors.

    Returns:
        d, and whether the matrix is positive definite in floating point; where it is not, d may be anything.
    """
    system = normal.clone()
    system.diagonal(dim1=1, dim2=2).add_(mu[:, None])
    factor, info = torch.linalg.cholesky_ex(system)
    return -torch.cholesky_solve(gradient[..., None], factor)[..., 0], info == 0


def _floored(mu: Tensor) -> Tensor:
    return mu.clamp(min=torch.finfo(mu.dtype).tiny)
