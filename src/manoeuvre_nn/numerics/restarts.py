"""Levenberg-Marquardt from many starts as one batch: every row has its own damping, pace and reason to stop."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.damping import Damping, Reason, Stops, damped_step
from manoeuvre_nn.numerics.least_squares import Carry, LeastSquares

WEIGHT_REASONS = Reason.NOT_FINITE, Reason.GOAL, Reason.GRADIENT, Reason.EPOCHS
STEP_REASONS = Reason.STEP, Reason.DAMPING, Reason.FALL
"""What is told of the present weights and of the last step, in the order of the tests."""


@dataclass(frozen=True)
class Solutions:
    """What became of every start.

    Attributes:
        weights: Weights of every row.
        mse: Mean square errors: their distribution over the starts says how far one fit can be trusted.
        reasons: Why each row stopped.
        epochs: Steps that each row took.
        tries: Steps that each row tried: those it took and those that did not lower its error.
    """

    weights: Float[Tensor, "k p"]
    mse: Float[Tensor, " k"]
    reasons: list[Reason]
    epochs: Int[Tensor, " k"]
    tries: Int[Tensor, " k"]

    @property
    def best(self) -> int:
        """Row with the least error; one whose error is no number is never it."""
        return int(self.mse.nan_to_num(nan=torch.inf).argmin())


class _Rows:
    """The rows that are still worked on."""

    def __init__(self, problem: LeastSquares, start: Tensor, damping: Damping) -> None:
        self.problem, self.weights = problem, start
        self.mse, self.carry = problem.evaluate(start)
        self.normal, self.gradient = problem.linearise(start, self.carry)
        self.mu = damping.first(self.normal)
        self.nu = torch.full_like(self.mu, 2.0)
        self.where = torch.arange(len(start), device=start.device)
        self.reason = torch.zeros_like(self.mu)
        self.epochs, self.tries = torch.zeros_like(self.where), torch.zeros_like(self.where)

    def keep(self, rows: Tensor) -> None:
        """Go on with some rows."""
        self.problem = self.problem.take(rows)
        self.carry = tuple(part[rows] for part in self.carry)
        for name, value in vars(self).items():
            if isinstance(value, Tensor):
                setattr(self, name, value[rows])

    def check(self, stops: Stops, *last: Tensor) -> bool:
        """Note which rows stop at the present weights, or by a test of the last step; whether any does."""
        slope = 2 / self.problem.residuals * self.gradient.norm(dim=1)
        unfit = ~(self.mse + slope < torch.inf) | self.mu.isnan()
        tests = (unfit, self.mse <= stops.goal, slope < stops.min_grad, self.epochs >= stops.epochs, *last)
        if not torch.stack(tests).any():
            return False
        for reason, where in zip(WEIGHT_REASONS + STEP_REASONS, tests, strict=False):
            self.reason = torch.where(where & (self.reason == 0), reason.code, self.reason)
        return True

    def advance(self, damping: Damping, stops: Stops) -> bool:
        """Try a step of every row, form new normal equations where it was taken, and check which rows stop."""
        move, solved = damped_step(self.normal, self.gradient, self.mu)
        trial = self.weights + move
        mse, carry = self.problem.evaluate(trial)
        self.tries = self.tries + 1
        better = solved & (mse < self.mse)  # a comparison with NaN is false
        fall = self.mse - mse
        errors = 0.5 * self.problem.residuals * fall
        self.mu, self.nu = damping.after(self.mu, self.nu, better, move, self.gradient, errors)
        small = solved & (move.norm(dim=1) < stops.min_step * self.weights.norm(dim=1))
        last = [small, ~better & (self.mu > damping.mu_max)]
        if stops.min_fall > 0:
            last.append(better & (fall < stops.min_fall * self.mse))
        self._accept(better, trial, mse, carry)
        return self.check(stops, *last)

    def _accept(self, better: Tensor, trial: Tensor, mse: Tensor, carry: Carry) -> None:
        if better.all():
            self.weights, self.mse, self.carry = trial, mse, carry
            self.normal, self.gradient = self.problem.linearise(trial, carry)
        elif better.any():
            rows = better.nonzero()[:, 0]
            for kept, new in zip((self.weights, self.mse, *self.carry), (trial, mse, *carry), strict=True):
                kept[rows] = new[rows]
            part = tuple(new[rows] for new in carry)
            self.normal[rows], self.gradient[rows] = self.problem.take(rows).linearise(trial[rows], part)
        self.epochs = self.epochs + better


@torch.no_grad()
def minimise(
    problem: LeastSquares,
    start: Float[Tensor, "k p"],
    *,
    damping: Damping | None = None,
    stops: Stops | None = None,
    at_once: int | None = None,
) -> Solutions:
    """Solve from many starts; the device is that of the data and the starts.

    A row whose step fails raises its damping while others go on to their next step, and a row that has stopped is
    taken out of the batch, so that the slow rows do not pay for it.

    Args:
        problem: What to solve; targets of its own for every row, or common ones.
        start: First weights.
        damping: Rule of mu; by default Nielsen's.
        stops: When a row is done.
        at_once: Rows in a batch, as many as fit into memory; None takes all.

    Returns:
        What became of every start.

    Raises:
        InputError: If ``at_once`` is not positive.
    """
    if at_once is not None and at_once < 1:
        raise InputError(f"at_once={at_once}: expected at least 1 row in a batch")
    damping, stops = damping or Damping("nielsen"), stops or Stops()
    parts = torch.arange(len(start), device=start.device).split(at_once or len(start))
    return _joined([_minimise(problem.take(rows), start[rows], damping, stops) for rows in parts])


def _minimise(problem: LeastSquares, start: Tensor, damping: Damping, stops: Stops) -> Solutions:
    """One batch."""
    rows = _Rows(problem, start, damping)
    whole = {name: getattr(rows, name).clone() for name in ("weights", "mse", "reason", "epochs", "tries")}
    over = rows.check(stops)
    while True:
        if over:
            ended = rows.reason != 0
            for name, value in whole.items():
                value[rows.where[ended]] = getattr(rows, name)[ended]
            if ended.all():
                break
            rows.keep((~ended).nonzero()[:, 0])
        over = rows.advance(damping, stops)
    reasons = [list(Reason)[int(code)] for code in whole.pop("reason")]
    return Solutions(reasons=reasons, **whole)


def _joined(parts: list[Solutions]) -> Solutions:
    whole = {name: torch.cat([getattr(part, name) for part in parts]) for name in ("weights", "mse", "epochs", "tries")}
    return Solutions(reasons=[reason for part in parts for reason in part.reasons], **whole)
