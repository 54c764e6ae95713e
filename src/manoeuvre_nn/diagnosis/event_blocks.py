"""A run in blocks: what an event would add if it acted in one alone, and how likely every set of times makes the data.

With the event whitened block by block and coefficients and latency taken out, inner products of blocks give the log
likelihood ratio of all sets of times by sums:

    ratio(g) = b g - 1/2 g G g        g: share of the event that acts in each block
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import contribution
from manoeuvre_nn.estimation.hypothesis import STOPS, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns
from manoeuvre_nn.estimation.linear_run import Columns, Embedded, IntegratedRun
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

BLOCK, MAX_BLOCKS, MAX_BLOCKS_OF_GRID = 10.0, 90, 36
"""Least length of the blocks that times are made of [s]; their number in a long run, for one force and for a grid."""
MIN_BLOCKS = 2
"""Least number of blocks in an interval, and between two."""
LONG_RAMPS = (60.0, 180.0, 420.0)
"""Ramps beside a step that are tried for an event that lasts [s]."""
SCALES = (0.7, 1.4)
"""By what a force may differ from that of a grid of sizes twice as large each."""
SHARE_LEFT_OUT = 0.01
"""Share of the forces over a run, squared, that their main courses may leave out."""
ALWAYS = -1e4
"""A start before all recordings [s]."""
Times = tuple[tuple[float, float], ...]
"""Intervals of a run in order [s]; an end that never comes is inf."""


@dataclass(frozen=True)
class BlockColumns:
    """What an event would add in each block of a run, before anything is said of the noise and of what is measured.

    Attributes:
        edges: Of the blocks [s].
        columns: What a few courses add in each block, course by course.
        shares: Of each course in every row of values.
    """

    edges: Float[np.ndarray, " e"]
    columns: Columns
    shares: Float[np.ndarray, "k parts"]
    _known: dict[int, tuple[Embedded, Float[np.ndarray, "m m"]]] = field(default_factory=dict, init=False, repr=False)

    def at(self, level: int, white: IntegratedRun) -> tuple[Embedded, Float[np.ndarray, "m m"]]:
        """The columns whitened at a level of the process noise, and their inner products."""
        if level not in self._known:
            embedded = white.embed(self.columns)
            self._known[level] = embedded, embedded.dot(embedded)
        return self._known[level]


@dataclass(frozen=True)
class Blocks:
    """A run in blocks: what the event would add in each at every row of values.

    Attributes:
        edges: Of the blocks [s].
        right: Inner products with the data.
        gram: With each other.
        scales: By what its size may differ.
    """

    edges: Float[np.ndarray, " e"]
    right: Float[np.ndarray, "k count"]
    gram: Float[np.ndarray, "k count count"]
    scales: tuple[float, float]

    def intervals(self, may_last: bool, ramp: float) -> "Intervals":
        """All intervals, and all starts without an end where the event may last; with a long ramp only these."""
        start, end = np.triu_indices(len(self.edges), MIN_BLOCKS)
        lasts = (end == len(self.edges) - 1) & may_last
        if ramp in LONG_RAMPS:
            start, end, lasts = start[lasts], end[lasts], lasts[lasts]
        times = np.stack([self.edges[start], np.where(lasts, np.inf, self.edges[end])], axis=-1)
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        wide = max(ramp, self.edges[1] - self.edges[0])
        rise, fall = (np.clip((middle - edge[:, None]) / wide + 0.5, 0.0, 1.0) for edge in times.T)
        prior = np.full(len(times), -np.log(len(times)))
        if may_last:
            prior = np.where(
                lasts, np.log(1 - STOPS) - np.log(lasts.sum()), np.log(STOPS) - np.log(max((~lasts).sum(), 1))
            )
        return Intervals(times, rise - fall, prior)

    def ratios(
        self, row: int | slice, gates: Float[np.ndarray, "m count"], there: Float[np.ndarray, " count"] | None = None
    ) -> Float[np.ndarray, "*k m"]:
        """Log likelihood ratios of acting in gates, of one row of values or of several, beside what acts already."""
        right, gram = self.right[row], self.gram[row]
        if there is not None:
            right = right - gram @ there
        b, a = right @ gates.T, ((gates @ gram) * gates).sum(axis=-1)
        return ratio(b, a, self.scales if there is None else (1.0, 1.0))


@dataclass(frozen=True)
class Intervals:
    """Intervals that are tried.

    Attributes:
        times: Start and end [s].
        shares: Of the event that act in each block.
        prior: Log prior probability.
    """

    times: Float[np.ndarray, "m 2"]
    shares: Float[np.ndarray, "m count"]
    prior: Float[np.ndarray, " m"]

    @property
    def gap(self) -> float:
        """Least time between two, and on either side of a hole: that of the shortest interval [s]."""
        return max(MIN_BLOCKS * BLOCK, float(np.ptp(self.times, axis=1).min()))

    def share_of(self, times: Times) -> Float[np.ndarray, " count"]:
        """Share of the event that acts in each block in several of the intervals."""
        each = [self.shares[int((self.times == interval).all(axis=1).argmax())] for interval in times]
        return sum(each, np.zeros(self.shares.shape[1]))


def ratio(
    b: Float[np.ndarray, "*k m"], a: Float[np.ndarray, "*k m"], scales: tuple[float, float]
) -> Float[np.ndarray, "*k m"]:
    """Log likelihood ratio ``s b - 1/2 s^2 a`` of an event of inner products b with the data and a with itself.

    Args:
        b: With the data.
        a: With itself.
        scales: Least and largest s, by which its size may differ.

    Returns:
        At the likeliest s.
    """
    s = np.clip(b / (a + 1e-9), *scales)
    return s * b - 0.5 * s**2 * a


def in_blocks(
    likelihood: MarginalLikelihood, cuts: Sequence[BlockColumns], noise: tuple[int, int], given: Hypothesis | None
) -> list[Blocks]:
    """All runs in blocks, each with its own rows of values."""
    data_set = likelihood.data_set
    # Not the levels that calm water needs: there the event itself is taken for process noise and wrong coefficients.
    low = data_set.levels.quiet(noise[0]), min(noise[1], 2)
    there = None if given is None else likelihood.columns(given)
    return [_blocks(data_set, run, cut, low, there) for run, cut in enumerate(cuts)]


def block_columns(data_set: WhitenedDataSet, run: int, effect: Effect, rows: Float[np.ndarray, "k p"]) -> BlockColumns:
    """A run cut into blocks."""
    linearised = data_set.runs[run].linearised
    time, step = linearised.run.time, linearised.run.step
    most = MAX_BLOCKS if len(rows) == 1 else MAX_BLOCKS_OF_GRID
    edges = np.arange(time[0], time[-1] + 1e-9, max(BLOCK, np.ptp(time) / most))
    edges[-1] = time[-1]
    count = len(edges) - 1
    which = np.clip(np.searchsorted(edges, time[1:] - step / 2) - 1, 0, count - 1)
    table = rows.copy()
    for values in table:
        write_times(effect, values, ((ALWAYS, np.inf),))
    courses, shares = _main_courses(contribution(effect, table, linearised).moved, data_set.unit[:3])
    parts = courses.shape[-1]
    moved = np.zeros((len(time) - 1, courses.shape[1], parts, count))
    moved[np.arange(len(time) - 1), :, :, which] = courses
    none = np.zeros((len(time), len(linearised.states.channels), parts * count))
    return BlockColumns(edges, Columns(none, moved.reshape(*moved.shape[:2], -1)), shares)


def _blocks(
    data_set: WhitenedDataSet, run: int, cut: BlockColumns, noise: tuple[int, int], given: HypothesisColumns | None
) -> Blocks:
    """A run in blocks, coefficients and latency taken out."""
    here, shares, count = data_set.at(noise[0]), cut.shares, len(cut.edges) - 1
    white, base = here.white[run], here.base[run]
    (blocks, products), parts = cut.at(noise[0], white), shares.shape[1]
    if given is not None:  # the data less what is known
        known = white.embed(given.columns[run][:1])
        base = base[:1].joined(known).combined(np.array([1.0, -1.0])).joined(base[1:])
    own, cross = base.dot(base), base.dot(blocks)
    if given is not None:
        own, cross = given.turn(run, own, gram=True), given.turn(run, cross)
    nuisance = own[1:, 1:] + np.diag(data_set.nuisance_sd(noise[1], runs=1) ** -2.0)
    weights = np.linalg.solve(nuisance, cross[1:])
    gram, right = products - cross[1:].T @ weights, cross[0] - own[0, 1:] @ weights
    gram = gram.reshape(parts, count, parts, count)
    half = np.einsum("kp,pcqd->kcqd", shares, gram, optimize=True)
    whole = np.einsum("kcqd,kq->kcd", half, shares, optimize=True)
    scales = SCALES if len(shares) > 1 else (1.0, 1.0)
    return Blocks(cut.edges, shares @ right.reshape(parts, count), whole, scales)


def _main_courses(
    moved: Float[np.ndarray, "steps s k"], unit: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, "steps s m"], Float[np.ndarray, "k m"]]:
    """Few courses over a run, and the share of each in every one of many."""
    pushed = (moved[:, :3] / unit[:, None]).reshape(-1, moved.shape[-1])
    size = np.sqrt((pushed**2).sum(axis=0)) + 1e-30
    values, vectors = np.linalg.eigh((pushed / size).T @ (pushed / size))
    left_out = np.cumsum(np.maximum(values, 0.0)) < SHARE_LEFT_OUT * len(values)
    kept = vectors[:, ~left_out]
    return (moved / size) @ kept, size[:, None] * kept


def write_times(effect: Effect, values: Float[np.ndarray, " p"], times: Times) -> None:
    """Put times into an effect's values; what is left of them never comes."""
    columns = effect.timed
    values[columns] = np.inf
    for k, interval in enumerate(times[: len(columns) // 2]):
        values[columns[2 * k : 2 * k + 2]] = interval
