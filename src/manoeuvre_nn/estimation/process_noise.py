"""Process noise: accelerations that no model explains, and how they go on from sample to sample.

Source:
    Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, section 4.2.1 and appendix B; Hartikainen &
    Sarkka 2010 (IEEE MLSP) for the same as a chain of states.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

AXES = 3
"""Surge, sway, yaw."""
MIN_LOG_WEIGHT = -4.6
"""Log weight beside that of the best point below which others are left out: a hundredth."""
WIDE_STRIDE = 3
"""Sizes that the search for the likeliest one skips at first."""
QUIET_SIZE = 0.015
"""Size of the process noise where hypotheses must explain what more of it would."""


@dataclass(frozen=True)
class ProcessLevels:
    """The grid of standard deviations of the process noise that are tried: in surge, and in sway, yaw and roll.

    They are over the resistance and over what 20 deg of rudder do. Grid points are numbered row by row: a row is a size
    in surge, a column one beside.

    Attributes:
        sizes: What is tried of each [-].
    """

    sizes: tuple[float, ...]

    @cached_property
    def pairs(self) -> Float[np.ndarray, "g 2"]:
        """Sizes at every grid point."""
        return np.array(list(product(self.sizes, self.sizes)))

    def __len__(self) -> int:
        """Number of grid points."""
        return len(self.sizes) ** 2

    def __getitem__(self, point: int) -> Float[np.ndarray, " 2"]:
        """Sizes at a grid point."""
        return self.pairs[point]

    def sd(self, point: int, unit: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Standard deviations of the accelerations at a grid point, from what is large in a manoeuvre."""
        return by_equation(self.pairs[point], len(unit)) * unit

    def point(self, surge: int, lateral: int) -> int:
        """Number of the grid point with the k-th size of each, or the last one."""
        last = len(self.sizes) - 1
        return min(surge, last) * len(self.sizes) + min(lateral, last)

    def at(self, point: int) -> tuple[int, int]:
        """Which size a grid point has in surge, and which beside."""
        return divmod(point, len(self.sizes))

    def beside(self, point: int) -> list[int]:
        """A grid point and those one size from it in surge or beside, not in both."""
        row, column = self.at(point)
        beside = [(row - 1, column), (row, column - 1), (row, column), (row, column + 1), (row + 1, column)]
        return [self.point(*at) for at in beside if 0 <= min(at) and max(at) < len(self.sizes)]

    def uphill(self, start: int, score: Callable[[int], float], fine: bool = True) -> dict[int, float]:
        """Climb from a grid point until the best one is surrounded by worse ones.

        What surge and the rest add hardly depends on each other: what is better in both is tried at once. Where the
        first point is not the best, steps are :data:`WIDE_STRIDE`, until they lead no further.

        Args:
            start: Where to begin.
            score: Log weight of a point; no point is asked for twice.
            fine: Whether the best is sought among all points, or among those :data:`WIDE_STRIDE` sizes from the first.

        Returns:
            Of every point that was asked for; from the best one on, all in surge and all beside that weigh anything.
        """
        known, best = {start: score(start)}, start

        def looked(at: int, stride: int) -> int:
            row, column = self.at(at)
            lines = [[(k, column) for k in self._within(row, stride)], [(row, k) for k in self._within(column, stride)]]
            for line in lines:
                known.update((g, score(g)) for g in (self.point(*one) for one in line) if g not in known)
            better = [max(line, key=lambda one: known[self.point(*one)]) for line in lines]
            if (corner := self.point(better[0][0], better[1][1])) not in known:
                known[corner] = score(corner)
            return max(known, key=lambda g: known[g])

        def climbed(at: int, stride: int) -> int:
            while (further := looked(at, stride)) != at:
                at = further
            return at

        if not fine:
            climbed(best, WIDE_STRIDE)
            return known
        if (further := looked(best, 1)) != best:
            best = climbed(climbed(further, WIDE_STRIDE), 1)
        for axis, step in product((0, 1), (-1, 1)):
            at = list(self.at(best))
            while known[self.point(*at)] > known[best] + MIN_LOG_WEIGHT and 0 <= at[axis] + step < len(self.sizes):
                at[axis] += step
                if (g := self.point(*at)) not in known:
                    known[g] = score(g)
        return known

    def filled(self, by_level: Float[np.ndarray, "g s"]) -> Float[np.ndarray, "g s"]:
        """Log weights at all grid points by those in the row and the column of the best one, as if they only added up.

        Args:
            by_level: At every grid point, minus infinity where it is not known.

        Returns:
            The same; where a point is not known ``w(i, k) = w(i, k*) + w(i*, k) - w(i*, k*)``, at most ``w(i*, k*)``
            of the best (i*, k*).
        """
        table = by_level.reshape(len(self.sizes), len(self.sizes), -1)
        row, column = self.at(int(np.nanmax(by_level, axis=1).argmax()))
        with np.errstate(invalid="ignore"):
            added = np.minimum(table[:, column, None] + table[row, None] - table[row, column], table[row, column])
        known = np.isfinite(by_level)
        return np.where(known, by_level, np.nan_to_num(added, nan=-np.inf, neginf=-np.inf).reshape(by_level.shape))

    def _within(self, number: int, stride: int) -> list[int]:
        """A size's number, and those so many below and above, as far as there are any."""
        return [k for k in (number, number - stride, number + stride) if 0 <= k < len(self.sizes)]

    def largest(self, size: float) -> int:
        """Number of the largest size that is no larger than one; the first if all are."""
        return max(int(np.searchsorted(self.sizes, size, side="right")) - 1, 0)

    def quiet(self, point: int) -> int:
        """The grid point with neither size above :data:`QUIET_SIZE`."""
        most = self.largest(QUIET_SIZE)
        return self.point(*(min(k, most) for k in self.at(point)))


def by_equation(pair: Float[np.ndarray, " 2"], count: int) -> Float[np.ndarray, " k"]:
    """A number for surge and one for the rest, written out for as many accelerations."""
    return pair[[0, 1, 1, 1][:count]]


PROCESS_LEVELS = ProcessLevels((
    0.003,
    0.0045,
    0.0067,
    0.01,
    0.015,
    0.022,
    0.033,
    0.05,
    0.072,
    0.104,
    0.15,
    0.22,
    0.33,
    0.5,
))
"""The usual ones of what no hypothesis explains. Runs tell the size beside surge to a sixth or better: steps
of a factor of 1.5 are needed, or what is added to a hypothesis is weighed with noise that is too small or too large."""


@dataclass(frozen=True)
class ProcessNoise:
    """A stationary Gaussian process for each acceleration, of the same correlation time.

    Its covariance over the variance is that of Ornstein and Uhlenbeck, ``exp(-|t|)``: what gusts and missing terms do;
    or, ``smooth``, Matern's of order 3/2, ``(1 + |t|) exp(-|t|)``: the acceleration has a rate, which is a state as
    well (times the correlation time, so that it has the acceleration's variance): what a whole ship does.

    Attributes:
        time: Correlation time.
        smooth: Which of the two.
        axes: Number of accelerations: 4 of a ship that rolls.
    """

    time: float = 1.0
    smooth: bool = False
    axes: int = AXES

    @property
    def order(self) -> int:
        """States of each acceleration."""
        return 2 if self.smooth else 1

    @property
    def size(self) -> int:
        """States: the accelerations, then their rates if they are smooth."""
        return self.axes * self.order

    def steps(self, h: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m c c"], Float[np.ndarray, "m c c"]]:
        """Innovations of the steps, ``left a_k + right a_{k+1}``: white, with the variance of the process."""
        x = h / self.time
        decay = np.exp(-x)
        if self.smooth:
            shift = np.array([[[1 + k, k], [-k, 1 - k]] for k in x]) * decay[:, None, None]
        else:
            shift = decay[:, None, None]
        # Of the stationary variance a step keeps shift shift^T; the rest is new.
        right = np.linalg.inv(np.linalg.cholesky(np.eye(self.order) - shift @ shift.transpose(0, 2, 1)))
        eye = np.eye(self.axes)
        return np.kron(-right @ shift, eye), np.kron(right, eye)


def drawn_process(
    rng: np.random.Generator, time: Float[np.ndarray, " n"], correlation_time: float, shape: tuple[int, ...]
) -> Float[np.ndarray, "n *shape"]:
    """Courses of Ornstein and Uhlenbeck's process with variance 1.

    Args:
        rng: Source of chance.
        time: Sample times [s].
        correlation_time: Its correlation time [s].
        shape: Of the courses, which are independent.

    Returns:
        Time first.
    """
    courses = rng.standard_normal((len(time), *shape))
    keep = np.exp(-np.diff(time) / correlation_time)
    for k, share in enumerate(keep, 1):
        courses[k] = share * courses[k - 1] + np.sqrt(1 - share**2) * courses[k]
    return courses


def markov_course(time: Float[np.ndarray, " n"], gap: float, memory: float) -> Float[np.ndarray, "n k"]:
    """Courses of a first-order Markov process of size one: hat functions, mixed so that amplitudes are independent.

    Args:
        time: Where it is wanted [s].
        gap: Time between its knots [s]; straight lines between.
        memory: Its correlation time [s], ``cov = exp(-|t| / memory)``.

    Returns:
        One column a knot.
    """
    knots = np.arange(time[0], time[-1] + gap, gap)
    hats = np.clip(1 - np.abs(time[:, None] - knots) / gap, 0, None)
    return hats @ np.linalg.cholesky(np.exp(-np.abs(knots[:, None] - knots) / memory) + 1e-9 * np.eye(len(knots)))


def without_course(
    whole: Float[np.ndarray, "p p"], own: Float[np.ndarray, "k k"], cross: Float[np.ndarray, "k p"], size: float
) -> tuple[Float[np.ndarray, "p p"], float]:
    """Inner products with a random course integrated out.

    ``G - s^2 C^T (1 + s^2 K)^-1 C`` and ``-1/2 log det(1 + s^2 K)``: amplitudes are independent, of s.d. s.

    Args:
        whole: Inner products G of the other columns.
        own: Those K of the course's columns.
        cross: Those C of the course's columns with the others.
        size: Standard deviation s.

    Returns:
        Inner products, and what is added to the log normaliser.
    """
    factor = np.linalg.cholesky(size**2 * own + np.eye(len(own)))
    half = solve_triangular(factor, size * cross, lower=True)
    return whole - half.T @ half, -float(np.log(np.diag(factor)).sum())
