"""One run as linear equations, its states integrated out: what every estimation of states and unknowns comes down to.

About a track the deviations ``ds`` of the states at all samples and the unknowns ``theta`` obey

    steps:    left_k ds_k + right_k ds_{k+1} + defect_k = B_k theta + e_k,    e_k ~ N(0, (root_k^T root_k)^-1)
    samples:  H_k ds_k + C_k theta = residual_k + noise,                      noise ~ N(0, diag(precision_k)^-1)
    start:    ds_0 + offset ~ N(0, diag(start)^-1)

The precision of the states is a band matrix. One banded Cholesky factor gives the log normaliser, the inner products of
any columns (data, coefficients, parameters) in the metric of the samples' marginal covariance, the most likely states
for given unknowns, and their covariance: what a Kalman filter and smoother give, for hundreds of columns at once.

How the equations of the steps are made is the model's business: the trapezoidal rule (:mod:`.collocation`) where
accelerations are linear in the coefficients, Runge-Kutta steps (:mod:`.linearised_run`) where they are any function.

Source:
    Bell 1994 (SIAM J. Optim. 4:626) and Aravkin et al. 2017 (Automatica 86:63) for the equivalence with the filter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from manoeuvre_nn.numerics.chain import Chain


@dataclass(frozen=True)
class Columns:
    """What unknowns add to a run, one a column; data minus columns times unknowns is what is left.

    Attributes:
        measured: What each adds to the measured channels.
        moved: What each adds to the first states within each step (B); of the data, the defect.
        start: The same for the first state; None is nothing.
    """

    measured: Float[np.ndarray, "n c p"]
    moved: Float[np.ndarray, "steps k p"]
    start: Float[np.ndarray, "s p"] | None = None

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.measured.shape[-1]

    def __getitem__(self, chosen: slice | Bool[np.ndarray, " p"]) -> "Columns":
        """Some of the columns."""
        return self._each(lambda part: part[..., chosen])

    def __sub__(self, other: "Columns") -> "Columns":
        """Columns less others, one by one or all less one; without those of the first state."""
        return Columns(self.measured - other.measured, self.moved - other.moved)

    def __truediv__(self, size: Float[np.ndarray, " p"]) -> "Columns":
        """Every column over its size."""
        return self._each(lambda part: part / size)

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Columns":
        """The columns summed up, each with a share, as one column."""
        return self._each(lambda part: (part @ shares)[..., None])

    def _each(self, change: Callable[[np.ndarray], np.ndarray]) -> "Columns":
        """The same done to all parts."""
        return Columns(change(self.measured), change(self.moved), None if self.start is None else change(self.start))


def joined(parts: Sequence[Columns]) -> Columns:
    """Columns side by side, without those of the first state."""
    return Columns(
        np.concatenate([c.measured for c in parts], axis=-1), np.concatenate([c.moved for c in parts], axis=-1)
    )


@dataclass(frozen=True)
class RunEquations:
    """A run's equations about a track: how states follow each other, what channels show of them, where they begin.

    Attributes:
        left: Derivative of a step by the state before it.
        right: Derivative by the state after it.
        root: ``root^T root`` is the precision of what a step may miss.
        log_det: Log determinant of the prior's root over all steps, for the normaliser.
        observed: Derivative of the channels by the state (H).
        precision: One over the variance of each sample's noise; 0 where nothing was measured.
        start: Precision of the first state; 0 where nothing is known.
        unit: Usual size of the states, for the condition of the factor; None is 1.
    """

    left: Float[np.ndarray, "steps s s"]
    right: Float[np.ndarray, "steps s s"]
    root: Float[np.ndarray, "steps s s"]
    log_det: float
    observed: Float[np.ndarray, "n c s"]
    precision: Float[np.ndarray, "n c"]
    start: Float[np.ndarray, " s"]
    unit: Float[np.ndarray, " s"] | None = None


@dataclass(frozen=True)
class Embedded:
    """Columns as vectors: the inner product is that of ``outer`` less that of ``inner`` (what the states absorb)."""

    outer: Float[np.ndarray, "a p"]
    inner: Float[np.ndarray, "b p"]

    def dot(self, other: "Embedded") -> Float[np.ndarray, "p q"]:
        """Inner products of all columns with all others.

        Args:
            other: Other columns of the same run at the same noise.

        Returns:
            One row a column of this, one column a column of the other.
        """
        return self.outer.T @ other.outer - self.inner.T @ other.inner

    def joined(self, other: "Embedded") -> "Embedded":
        """These columns, and then others of the same run at the same noise."""
        return Embedded(np.hstack([self.outer, other.outer]), np.hstack([self.inner, other.inner]))

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Embedded":
        """The columns summed up, each with a share, as one."""
        return Embedded((self.outer @ shares)[:, None], (self.inner @ shares)[:, None])


class IntegratedRun:
    """A run at given noise with its states integrated out.

    Attributes:
        unit: Size of the states inside the factor.
        chain: Their precision.
        log_norm: ``-0.5 log det`` of the covariance of all measured samples, up to a constant of the run.
    """

    def __init__(self, e: RunEquations) -> None:
        """Factor the precision of the states."""
        self.unit = np.ones(len(e.start)) if e.unit is None else e.unit
        self._root = e.root
        self._left, self._right = e.root @ (e.left * self.unit), e.root @ (e.right * self.unit)
        self._weight, self._start = np.sqrt(e.precision), np.sqrt(e.start)
        self._seen = e.observed * self.unit * self._weight[..., None]
        # ds^T A ds: squares of all equations above.
        diagonal = self._seen.transpose(0, 2, 1) @ self._seen
        diagonal[:-1] += self._left.transpose(0, 2, 1) @ self._left
        diagonal[1:] += self._right.transpose(0, 2, 1) @ self._right
        diagonal[0] += np.diag((self._start * self.unit) ** 2)
        self.chain = Chain(diagonal, self._right.transpose(0, 2, 1) @ self._left)
        prior = e.log_det + float(np.log(self._start[e.start > 0]).sum())
        noise = float(np.log(self._weight[e.precision > 0]).sum())
        self.log_norm = prior + noise + float(np.log(self.unit).sum()) * len(diagonal) - 0.5 * self.chain.log_det

    def embed(self, c: Columns) -> Embedded:
        """Vectors whose inner products are those of the columns in the metric of the samples' marginal covariance."""
        k = c.moved.shape[1]  # roots do not mix the states that columns may move with the others
        seen, missed = self._weight[..., None] * c.measured, self._root[:, :k, :k] @ c.moved
        parts = [seen.reshape(-1, c.count), missed.reshape(-1, c.count)]
        # A ds = H^T R C - left^T W B - right^T W B, from the derivative of the squares by ds.
        right = self._seen.transpose(0, 2, 1) @ seen
        right[1:] -= self._right[:, :k].transpose(0, 2, 1) @ missed
        right[:-1] -= self._left[:, :k].transpose(0, 2, 1) @ missed
        if c.start is not None:
            parts.append(self._start[:, None] * c.start)
            right[0] -= (self._start * self.unit)[:, None] * parts[-1]
        return Embedded(np.concatenate(parts), self.chain.whiten(right))

    def states(self, embedded: Embedded) -> Float[np.ndarray, "n s p"]:
        """Most likely deviation of the states from the track for a column, unknowns at zero."""
        return self.chain.unwhiten(embedded.inner) * self.unit[:, None]

    @cached_property
    def covariances(self) -> tuple[Float[np.ndarray, "n s s"], Float[np.ndarray, "m s s"]]:
        """Of every sample's state, and of each with the one before it, unknowns given."""
        on, below = self.chain.covariances
        scale = self.unit[:, None] * self.unit
        return on * scale, below * scale


def summed(
    parts: Sequence[Float[np.ndarray, "p p"]], index: Sequence[Int[np.ndarray, " p"]], size: int
) -> Float[np.ndarray, "q q"]:
    """Inner products of several runs together.

    Args:
        parts: Those of each run's columns.
        index: Where each run's columns stand among those of all runs.
        size: Number of columns of all runs.

    Returns:
        Their sum.
    """
    gram = np.zeros((size, size))
    for part, at in zip(parts, index, strict=True):
        gram[np.ix_(at, at)] += part
    return gram
