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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

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

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Columns":
        """The columns summed up, each with a share, as one column.

        Args:
            shares: One a column.

        Returns:
            One column.
        """
        return Columns((self.measured @ shares)[..., None], (self.moved @ shares)[..., None])


def joined(parts: Sequence[Columns]) -> Columns:
    """Columns side by side, without those of the first state.

    Args:
        parts: At least one.

    Returns:
        All columns.
    """
    return Columns(
        np.concatenate([c.measured for c in parts], axis=-1), np.concatenate([c.moved for c in parts], axis=-1)
    )


@dataclass(frozen=True)
class StepEquations:
    """How states follow each other.

    Attributes:
        left: Derivative by the state before the step.
        right: Derivative by the state after it.
        root: ``root^T root`` is the precision of what a step may miss.
        log_det: Log determinant of the prior's root over all steps, for the normaliser.
    """

    left: Float[np.ndarray, "steps s s"]
    right: Float[np.ndarray, "steps s s"]
    root: Float[np.ndarray, "steps s s"]
    log_det: float


@dataclass(frozen=True)
class SampleEquations:
    """What the channels show of the states.

    Attributes:
        observed: Derivative of the channels by the state (H).
        precision: One over the variance of each sample's noise; 0 where nothing was measured.
    """

    observed: Float[np.ndarray, "n c s"]
    precision: Float[np.ndarray, "n c"]


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

    def beside(self, other: "Embedded") -> "Embedded":
        """These columns, then others of the same run at the same noise."""
        return Embedded(np.hstack([self.outer, other.outer]), np.hstack([self.inner, other.inner]))

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Embedded":
        """The columns summed up, each with a share, as one.

        Args:
            shares: One a column.

        Returns:
            One column.
        """
        return Embedded((self.outer @ shares)[:, None], (self.inner @ shares)[:, None])


class IntegratedRun:
    """A run at given noise with its states integrated out.

    Attributes:
        unit: Size of the states inside the factor.
        chain: Their precision.
        log_norm: ``-0.5 log det`` of the covariance of all measured samples, up to a constant of the run.
    """

    def __init__(
        self,
        steps: StepEquations,
        samples: SampleEquations,
        start: Float[np.ndarray, " s"],
        unit: Float[np.ndarray, " s"] | None = None,
    ) -> None:
        """Factor the precision of the states.

        Args:
            steps: How states follow each other.
            samples: What channels show of them.
            start: Precision of the first state; 0 where nothing is known.
            unit: Usual size of the states, for the condition of the factor; None is 1.
        """
        self.unit = np.ones(len(start)) if unit is None else unit
        self._root = steps.root
        self._left, self._right = steps.root @ (steps.left * self.unit), steps.root @ (steps.right * self.unit)
        self._weight, self._start = np.sqrt(samples.precision), np.sqrt(start)
        self._seen = samples.observed * self.unit * self._weight[..., None]
        # ds^T A ds: squares of all equations above.
        diagonal = self._seen.transpose(0, 2, 1) @ self._seen
        diagonal[:-1] += self._left.transpose(0, 2, 1) @ self._left
        diagonal[1:] += self._right.transpose(0, 2, 1) @ self._right
        diagonal[0] += np.diag((self._start * self.unit) ** 2)
        self.chain = Chain(diagonal, self._right.transpose(0, 2, 1) @ self._left)
        prior = steps.log_det + float(np.log(self._start[start > 0]).sum())
        noise = float(np.log(self._weight[samples.precision > 0]).sum())
        self.log_norm = prior + noise + float(np.log(self.unit).sum()) * len(diagonal) - 0.5 * self.chain.log_det

    def embed(self, c: Columns) -> Embedded:
        """Vectors whose inner products are those of the columns in the metric of the samples' marginal covariance.

        Args:
            c: Columns.

        Returns:
            The vectors.
        """
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
        """Most likely deviation of the states from the track for a column, unknowns at zero.

        Args:
            embedded: Columns.

        Returns:
            Deviations.
        """
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
