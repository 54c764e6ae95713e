"""One run as linear equations, its states integrated out: what every estimation of states and unknowns comes down to.

About a track the deviations ``ds`` of the states at all samples and the unknowns ``theta`` obey

    steps:    left_k ds_k + right_k ds_{k+1} + defect_k = B_k theta + e_k,    e_k ~ N(0, (root_k^T root_k)^-1)
    samples:  H_k ds_k + C_k theta = residual_k + noise,                      noise ~ N(0, diag(precision_k)^-1)
    start:    ds_0 + offset ~ N(0, diag(start)^-1)

The precision of the states is a band matrix. One banded Cholesky factor gives the log normaliser, the inner products of
any columns (data, coefficients, parameters) in the metric of the samples' marginal covariance, the most likely states
for given unknowns, and their covariance: what a Kalman filter and smoother give, for hundreds of columns at once.

With ``E`` the equations' derivatives by the states and ``y`` the columns, both in units of the noise, the products are
``y^T y - (E^T y)^T A^-1 (E^T y)``, ``A = E^T E``. The size of the process noise is unknown, and all of this is asked
for at one size after another. States that are process noise are therefore in units of their standard deviation D: then
``A = D M D + P`` and ``D E^T y``, D being 1 for the motion, and ``y^T y``, ``E^T y``, M and P are the same at every
size (:class:`RunEquations`). What is left for each is a factor and a solution (:class:`IntegratedRun`).

How the equations of the steps are made is the model's business: the trapezoidal rule (:mod:`.collocation`) where
accelerations are linear in the coefficients, Runge-Kutta steps (:mod:`.linearised_run`) where they are any function.

Source:
    Bell 1994 (SIAM J. Optim. 4:626) and Aravkin et al. 2017 (Automatica 86:63) for the equivalence with the filter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from manoeuvre_nn.numerics.chain import Chain


@lru_cache(maxsize=1024)
def nothing(*shape: int) -> Float[np.ndarray, "*shape"]:
    """Zeros without memory of their own: what forces add to samples at once, and sensors to the motion."""
    return np.broadcast_to(0.0, shape)


def is_nothing(part: Float[np.ndarray, "*shape"]) -> bool:
    """Whether an array is one of :func:`nothing`, or empty: that it adds nothing is known without looking at it."""
    return not part.size or not (any(part.strides) or part.flat[0])


@dataclass(frozen=True, eq=False)
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
        return self._each(lambda part: _kept(part, chosen))

    def __add__(self, other: "Columns") -> "Columns":
        """The sum, column by column."""
        return Columns(_sum(self.measured, other.measured), _sum(self.moved, other.moved))

    def __sub__(self, other: "Columns") -> "Columns":
        """Columns less others, one by one or all less one; without those of the first state."""
        return Columns(_sum(self.measured, other.measured, -1), _sum(self.moved, other.moved, -1))

    def __truediv__(self, size: Float[np.ndarray, " p"]) -> "Columns":
        """Every column over its size."""
        return self._each(lambda part: part if is_nothing(part) else part / size)

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Columns":
        """The columns summed up, each with a share, as one column."""
        return self._each(lambda part: part[..., :1] if is_nothing(part) else (part @ shares)[..., None])

    def _each(self, change: Callable[[np.ndarray], np.ndarray]) -> "Columns":
        """The same done to all parts."""
        return Columns(change(self.measured), change(self.moved), None if self.start is None else change(self.start))


def joined(parts: Sequence[Columns]) -> Columns:
    """Columns side by side, without those of the first state."""
    return Columns(_beside([c.measured for c in parts]), _beside([c.moved for c in parts]))


def _kept(part: Float[np.ndarray, "n k p"], chosen: slice | Bool[np.ndarray, " p"]) -> Float[np.ndarray, "n k q"]:
    """Some of the columns of a part; those of :func:`nothing` stay such, for a mask would write them out."""
    if isinstance(chosen, slice) or not is_nothing(part):
        return part[..., chosen]
    return nothing(*part.shape[:-1], int(np.count_nonzero(chosen)))


def _sum(one: Float[np.ndarray, "n k #p"], other: Float[np.ndarray, "n k #p"], sign: int = 1) -> np.ndarray:
    """Parts of columns added, or the other one taken away."""
    if is_nothing(one) and is_nothing(other):
        return nothing(*np.broadcast_shapes(one.shape, other.shape))
    return one + other if sign > 0 else one - other


def _beside(parts: Sequence[Float[np.ndarray, "n k _"]]) -> Float[np.ndarray, "n k q"]:
    """Parts of columns side by side."""
    if all(is_nothing(part) for part in parts):
        return nothing(*parts[0].shape[:-1], sum(part.shape[-1] for part in parts))
    return np.concatenate(parts, axis=-1)


class _Rows(NamedTuple):
    """Equations of one kind in units of their noise: only the columns that enter them, and which of all these are."""

    values: Float[np.ndarray, "a q"]
    at: Int[np.ndarray, " q"]


@dataclass(frozen=True, eq=False)
class WeightedColumns:
    """Columns in units of the noise of samples, steps and start; the same at any size of the process noise.

    Attributes:
        rows: What they add to the samples, to the steps and to the start (y).
        pull: What they add to the right-hand side of the states' normal equations (E^T y).
    """

    rows: tuple[_Rows, ...]
    pull: Float[np.ndarray, "k p"]
    _products: WeakKeyDictionary["WeightedColumns", Float[np.ndarray, "p q"]] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    def dot(self, other: "WeightedColumns") -> Float[np.ndarray, "p q"]:
        """Inner products before states absorb anything; kept, for they are asked for at every level of the noise."""
        if other not in self._products:
            made = np.zeros((self.pull.shape[1], other.pull.shape[1]))
            for mine, others in zip(self.rows, other.rows, strict=True):
                if len(mine.at) and len(others.at):
                    made[np.ix_(mine.at, others.at)] += mine.values.T @ others.values
            self._products[other] = made
        return self._products[other]

    def __getitem__(self, chosen: slice) -> "WeightedColumns":
        """Some of the columns."""
        kept = np.arange(self.pull.shape[1])[chosen]
        rows = (_Rows(a.values[:, np.isin(a.at, kept)], np.flatnonzero(np.isin(kept, a.at))) for a in self.rows)
        return WeightedColumns(tuple(rows), self.pull[:, chosen])

    def joined(self, other: "WeightedColumns") -> "WeightedColumns":
        """These columns, and then others."""
        count = self.pull.shape[1]
        rows = (
            _Rows(np.hstack([a.values, b.values]), np.append(a.at, count + b.at))
            for a, b in zip(self.rows, other.rows, strict=True)
        )
        return WeightedColumns(tuple(rows), np.hstack([self.pull, other.pull]))

    def combined(self, shares: Float[np.ndarray, " p"]) -> "WeightedColumns":
        """The columns summed up, each with a share, as one."""
        rows = (_Rows((a.values @ shares[a.at])[:, None], np.zeros(1, dtype=int)) for a in self.rows)
        return WeightedColumns(tuple(rows), (self.pull @ shares)[:, None])


@dataclass(frozen=True)
class Embedded:
    """Columns as vectors: the inner product is that of ``outer`` less that of ``inner`` (what the states absorb)."""

    outer: WeightedColumns
    inner: Float[np.ndarray, "b p"]

    def dot(self, other: "Embedded") -> Float[np.ndarray, "p q"]:
        """Inner products of all columns with all others.

        Args:
            other: Other columns of the same run at the same noise.

        Returns:
            One row a column of this, one column a column of the other.
        """
        return self.outer.dot(other.outer) - self.inner.T @ other.inner

    def __getitem__(self, chosen: slice) -> "Embedded":
        """Some of the columns."""
        return Embedded(self.outer[chosen], self.inner[:, chosen])

    def joined(self, other: "Embedded") -> "Embedded":
        """These columns, and then others of the same run at the same noise."""
        return Embedded(self.outer.joined(other.outer), np.hstack([self.inner, other.inner]))

    def combined(self, shares: Float[np.ndarray, " p"]) -> "Embedded":
        """The columns summed up, each with a share, as one."""
        return Embedded(self.outer.combined(shares), (self.inner @ shares)[:, None])


class _Blocks(NamedTuple):
    """A block tridiagonal matrix: its blocks on the diagonal and below it."""

    on: Float[np.ndarray, "n s s"]
    below: Float[np.ndarray, "steps s s"]


@dataclass(frozen=True, eq=False)
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
        noises: How many of the last states are process noise in units of its standard deviation.
    """

    left: Float[np.ndarray, "steps s s"]
    right: Float[np.ndarray, "steps s s"]
    root: Float[np.ndarray, "steps s s"]
    log_det: float
    observed: Float[np.ndarray, "n c s"]
    precision: Float[np.ndarray, "n c"]
    start: Float[np.ndarray, " s"]
    unit: Float[np.ndarray, " s"] | None = None
    noises: int = 0
    _weighted: WeakKeyDictionary[Columns, WeightedColumns] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @cached_property
    def units(self) -> Float[np.ndarray, " s"]:
        """Unit of each state."""
        return np.ones(len(self.start)) if self.unit is None else self.unit

    @cached_property
    def log_norm(self) -> float:
        """Log normaliser of samples, steps and start."""
        prior = self.log_det + 0.5 * float(np.log(self.start[self.start > 0]).sum())
        noise = 0.5 * float(np.log(self.precision[self.precision > 0]).sum())
        return prior + noise + float(np.log(self.units).sum()) * len(self.observed)

    @cached_property
    def _seen(self) -> Float[np.ndarray, "n c s"]:
        """Derivatives of the samples in units of their noise."""
        return np.sqrt(self.precision)[..., None] * self.observed * self.units

    @cached_property
    def _steps(self) -> tuple[Float[np.ndarray, "steps s s"], Float[np.ndarray, "steps s s"]]:
        """Derivatives of the steps by the states before and after them in units of what they may miss."""
        return self.root @ (self.left * self.units), self.root @ (self.right * self.units)

    @cached_property
    def _start(self) -> Float[np.ndarray, " s"]:
        """Derivatives of the start."""
        return np.sqrt(self.start) * self.units

    @cached_property
    def blocks(self) -> tuple[_Blocks, _Blocks]:
        """``E^T E`` of samples, motion and its start (M), and of the process noise (P)."""
        motion = len(self.start) - self.noises
        made = []
        for rows in (slice(0, motion), slice(motion, None)):
            left, right = (side[:, rows] for side in self._steps)
            on = np.zeros((len(self.observed), *self.left.shape[1:]))
            on[:-1] += left.transpose(0, 2, 1) @ left
            on[1:] += right.transpose(0, 2, 1) @ right
            on[0, rows, rows] += np.diag(self._start[rows] ** 2)
            made.append(_Blocks(on, right.transpose(0, 2, 1) @ left))
        made[0].on[:] += self._seen.transpose(0, 2, 1) @ self._seen
        return made[0], made[1]

    @cached_property
    def _equations(self) -> tuple[sparse.csr_array, sparse.csr_array, sparse.csr_array]:
        """``E^T`` of samples and of steps of the motion, and what turns these steps into units of their noise."""
        motion = len(self.start) - self.noises
        left, right = (_bands(side[:, :motion].transpose(0, 2, 1), here) for here, side in enumerate(self._steps))
        return _bands(self._seen.transpose(0, 2, 1)), left + right, _bands(self.root[:, :motion, :motion])

    def weighted(self, c: Columns) -> WeightedColumns:
        """Columns in units of the noise; kept as long as the columns are, for every size of the process noise."""
        if c not in self._weighted:
            samples, steps, root = self._equations
            (seen, shows), (pushed, moves) = _entering(c.measured), _entering(c.moved)
            rows = [_Rows(np.sqrt(self.precision).reshape(-1, 1) * seen, shows), _Rows(-(root @ pushed), moves)]
            pull = np.zeros((len(self.observed) * len(self.start), c.count), order="F")  # as LAPACK has it
            for equations, (values, at) in zip((samples, steps), rows, strict=True):
                pull[:, at] += equations @ values
            begun = np.zeros((len(self.start), 0)) if c.start is None else -np.sqrt(self.start)[:, None] * c.start
            rows.append(_Rows(begun, np.arange(begun.shape[1])))
            pull[: len(begun), rows[-1].at] += self._start[:, None] * begun
            self._weighted[c] = WeightedColumns(tuple(rows), pull)
        return self._weighted[c]


def _entering(part: Float[np.ndarray, "n k p"]) -> tuple[Float[np.ndarray, "nk q"], Int[np.ndarray, " q"]]:
    """Columns that are not 0 throughout, the samples below each other, and which they are."""
    at = np.flatnonzero(part[:0] if is_nothing(part) else part.any(axis=(0, 1)))
    kept = part if len(at) == part.shape[-1] else part[..., at]
    return kept.reshape(int(np.prod(part.shape[:-1])), len(at)), at


def _bands(blocks: Float[np.ndarray, "n a b"], below: int | None = None) -> sparse.csr_array:
    """Blocks on the diagonal of a matrix; or ``below`` the diagonal of one with one row of blocks more."""
    n, a, b = blocks.shape
    ends = np.arange(n + 1) if below is None else np.r_[[0] * below, np.arange(n + 1), [n] * (1 - below)]
    made = sparse.bsr_array((blocks, np.arange(n), ends), shape=((len(ends) - 1) * a, n * b)).tocsr()
    made.eliminate_zeros()
    return made


class IntegratedRun:
    """A run at given noise with its states integrated out.

    Attributes:
        equations: Its equations.
        unit: Size of the states inside the factor.
        chain: Their precision.
        log_norm: ``-0.5 log det`` of the covariance of all measured samples, up to a constant of the run.
    """

    def __init__(self, equations: RunEquations, process_sd: Float[np.ndarray, " p"] | None = None) -> None:
        """Factor the precision of the states.

        Args:
            equations: The run's equations.
            process_sd: Standard deviation of the process noise; None is 1.
        """
        self.equations = equations
        self._scale = np.ones(len(equations.start))
        if process_sd is not None:
            self._scale[len(self._scale) - equations.noises :] = process_sd
        self.unit = equations.units * self._scale
        # A = D M D + P, D = 1 for the motion and the size of the process noise for its states.
        scale, (moving, noise) = self._scale[:, None] * self._scale, equations.blocks
        self.chain = Chain(scale * moving.on + noise.on, scale * moving.below + noise.below)
        self._scales = np.tile(self._scale, self.chain.samples)[:, None]
        self.log_norm = equations.log_norm - 0.5 * self.chain.log_det

    def embed(self, c: Columns) -> Embedded:
        """Vectors whose inner products are those of the columns in the metric of the samples' marginal covariance."""
        weighted = self.equations.weighted(c)
        return Embedded(weighted, self.chain.whiten(self._scales * weighted.pull))

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
