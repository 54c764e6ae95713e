"""When an event acts: the times in each run that the whitened data ask for most, by the event's own force.

A run is cut into blocks. What the event would add if it acted in one block alone is whitened once, coefficients and
latency are taken out, and inner products of blocks give the log likelihood ratio of every set of times by sums:

    ratio(g) = b g - 1/2 g G g        g: share of the event that acts in each block

With a flat prior over all pairs of a start and an end the mean of exp(ratio) is the Bayes factor of one interval more.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import logsumexp

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import contribution
from manoeuvre_nn.estimation.hypothesis import NUMBER_OF_INTERVALS, STOPS, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

BLOCK, MAX_BLOCKS, MAX_BLOCKS_OF_GRID = 10.0, 90, 36
"""Least length of the blocks that times are made of [s]; their number in a long run, for one force and for a grid."""
MIN_BLOCKS = 2
"""Least number of blocks in an interval, and between two."""
MAX_INTERVALS = len(NUMBER_OF_INTERVALS) - 1
"""Times that an event happens in a run, at most."""
LONG_RAMPS = (60.0, 180.0, 420.0)
"""Ramps beside a step that are tried for an event that lasts [s]."""
SCALES = (0.7, 1.4)
"""By what a force may differ from that of a grid of sizes twice as large each."""
BEYOND_STARTS = 4.0
"""By how much sizes that are tried go beyond the starts of an event."""
SHARE_LEFT_OUT = 0.01
"""Share of the forces over a run, squared, that their main courses may leave out."""
MAX_STARTS = 3
"""Starts of an event that a fit is made from."""
SAME_TIME = 15.0
"""Difference of times below which two sets of times lead to one fit [s]."""
MIN_GAIN = 0.5
"""Log evidence that other times must gain."""
ALWAYS = -1e4
"""A start before all recordings [s]."""
Times = tuple[tuple[float, float], ...]
"""Intervals of a run in order [s]; an end that never comes is inf."""


def best_windows(
    likelihood: MarginalLikelihood, effect: Effect, level: int, scatter: int, given: Hypothesis | None = None
) -> Iterator[Float[np.ndarray, "runs p"]]:
    """Start values of an effect with times of its own in every run, best first.

    Args:
        likelihood: The runs.
        effect: The effect.
        level: Force level at which data are whitened.
        scatter: Scatter level.
        given: Effects that are there already; what they explain is no event.

    Yields:
        Values for every run.
    """
    rows, ramp = _grid(effect), [p.name == RAMP.name for p in effect.declared]
    blocks = _all_blocks(likelihood, effect, [rows] * len(likelihood.data_set.runs), (level, scatter), given)
    found = []
    for long in (_ramp(effect, rows[0]), *(LONG_RAMPS if _may_last(effect) and any(ramp) else ())):
        gates = [b.gates(_may_last(effect), long) for b in blocks]
        for k in range(len(rows)):
            total = sum(
                float(np.logaddexp(np.log(NUMBER_OF_INTERVALS[0]), np.log(NUMBER_OF_INTERVALS[1]) + _evidence(b, k, g)))
                for b, g in zip(blocks, gates, strict=True)
            )
            found.append((total, k, long))
    seen: set[tuple[float, ...]] = set()
    where = [j for j, p in enumerate(effect.declared) if p.null is None and not p.is_time]
    for _, k, long in sorted(found, reverse=True):
        key = tuple(rows[k, where])
        if key in seen or len(seen) == MAX_STARTS:
            continue
        seen.add(key)
        values = np.tile(rows[k], (len(blocks), 1))
        values[:, ramp] = long
        sets = [_sets_of_times(b, k, effect, long) for b in blocks]
        chosen = [s[-1] if len(s) > 1 else () for s in sets]
        if not any(chosen):
            best = int(np.argmax([_evidence(b, k, b.gates(_may_last(effect), long)) for b in blocks]))
            chosen[best] = _best(blocks[best], k, blocks[best].gates(_may_last(effect), long))
        for run, times in enumerate(chosen):
            _write(effect, values[run], times)
        yield values


def replaced(likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int, scatter: int) -> Hypothesis:
    """A hypothesis whose events happen when and as often as the evidence of each run says, all else as good as fitted.

    Args:
        likelihood: The runs.
        hypothesis: Fitted; its effects may be fixed but for their times.
        level: Force level.
        scatter: Scatter level.

    Returns:
        The same, with other times where these have more evidence.
    """
    best, score = hypothesis, None
    for k, effect in enumerate(hypothesis.effects):
        if not effect.timed:
            continue
        given = best.without(k)
        rows = [row[None] for row in best.values[k]]
        blocks = _all_blocks(likelihood, effect, rows, (level, scatter), given if given.effects else None)
        ramp = _ramp(effect, best.values[k][0])
        sets = [_sets_of_times(b, 0, effect, ramp, every=True) for b in blocks]
        # All runs at once first: as long as others lack theirs, coefficients that suit these speak against any.
        trials = [dict(enumerate(of_run[-1] for of_run in sets))]
        trials += [{run: times} for run, of_run in enumerate(sets) for times in of_run]
        for trial_times in trials:
            now = {run: times_of(effect, best.values[k][run]) for run in trial_times}
            if all(_alike(times, now[run]) for run, times in trial_times.items()):
                continue
            if score is None:
                score = _score(likelihood, best, level, scatter)
            trial = best.with_vector(best.vector())
            for run, times in trial_times.items():
                _write(effect, trial.values[k][run], times)
            if not trial.fixed and np.isinf(trial.values[k][:, effect.timed]).all():
                continue
            trial, _ = likelihood.improve(trial, level, scatter, rounds=4)
            there = _score(likelihood, trial, level, scatter)
            if there > score + MIN_GAIN and all(_in_order(effect, trial.values[k][run]) for run in trial_times):
                best, score = trial, there
    return best


def times_of(effect: Effect, values: Float[np.ndarray, " p"]) -> Times:
    """When an event acts in a run."""
    times = values[effect.timed].reshape(-1, 2).tolist()
    return tuple(sorted((start, max(start, end)) for start, end in times if np.isfinite(start)))


def _score(likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int, scatter: int) -> float:
    """Log evidence at one noise level."""
    return float(likelihood.posterior(likelihood.columns(hypothesis), level).evidence[scatter])


def _ramp(effect: Effect, values: Float[np.ndarray, " p"]) -> float:
    """Time in which it builds up [s]; a step where it declares none."""
    return next((float(v) for p, v in zip(effect.declared, values, strict=True) if p.name == RAMP.name), RAMP.low)


def _may_last(effect: Effect) -> bool:
    """Whether it may go on to the end of a run."""
    return bool(np.isinf(effect.declared[effect.timed[1]].starts[0]))


def _write(effect: Effect, values: Float[np.ndarray, " p"], times: Times) -> None:
    """Put times into an effect's values; what is left of them never comes."""
    columns = effect.timed
    values[columns] = np.inf
    for k, interval in enumerate(times[: len(columns) // 2]):
        values[columns[2 * k : 2 * k + 2]] = interval


def _alike(some: Times, others: Times) -> bool:
    """Whether a fit from either would end at the same times."""
    if len(some) != len(others):
        return False
    a, b = (np.minimum(np.array(times).ravel(), 1e6) for times in (some, others))
    return bool((np.abs(a - b) < SAME_TIME).all())


def _in_order(effect: Effect, values: Float[np.ndarray, " p"]) -> bool:
    """Whether intervals follow each other."""
    edges = np.array(times_of(effect, values)).ravel()
    return bool((edges[1:] > edges[:-1]).all())


def _grid(effect: Effect) -> Float[np.ndarray, "k p"]:
    """Values of everything but the times: all starts of directions and levers, sizes on a logarithmic scale."""
    axes = []
    for p in effect.declared:
        if p.is_time or p.form or p.name == RAMP.name:
            axes.append([p.starts[0] if p.null is None or p.name == RAMP.name else p.null])
        elif p.null is None:
            axes.append(list(p.starts))
        else:
            low, high = np.abs(p.starts).min() / BEYOND_STARTS, np.abs(p.starts).max() * BEYOND_STARTS
            sizes = np.geomspace(low, high, 1 + round(float(np.log2(high / low))))
            axes.append([
                float(np.clip(s * size, p.low, p.high)) for s in sorted({*np.sign(p.starts)}) for size in sizes
            ])
    return np.array(list(product(*axes)), dtype=float)


@dataclass(frozen=True)
class _Blocks:
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

    def gates(self, may_last: bool, ramp: float) -> "_Gates":
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
        return _Gates(times, rise - fall, prior)

    def ratios(
        self, row: int, gates: Float[np.ndarray, "m count"], there: Float[np.ndarray, " count"] | None = None
    ) -> Float[np.ndarray, " m"]:
        """Log likelihood ratios of acting in gates, beside what acts there already."""
        right, gram = self.right[row], self.gram[row]
        if there is not None:
            right = right - gram @ there
        b, a = gates @ right, ((gates @ gram) * gates).sum(axis=1) + 1e-9
        s = np.clip(b / a, *self.scales) if there is None else 1.0
        return s * b - 0.5 * s**2 * a


@dataclass(frozen=True)
class _Gates:
    """Intervals that are tried.

    Attributes:
        times: Start and end [s].
        shares: Of the event that act in each block.
        prior: Log prior probability.
    """

    times: Float[np.ndarray, "m 2"]
    shares: Float[np.ndarray, "m count"]
    prior: Float[np.ndarray, " m"]


def _evidence(blocks: _Blocks, row: int, gates: _Gates) -> float:
    """Log Bayes factor of one interval against none."""
    return float(logsumexp(blocks.ratios(row, gates.shares) + gates.prior))


def _best(blocks: _Blocks, row: int, gates: _Gates) -> Times:
    """The one interval that explains most."""
    k = int((blocks.ratios(row, gates.shares) + gates.prior).argmax())
    start, end = gates.times[k].tolist()
    return ((start, end),)


def _sets_of_times(b: _Blocks, row: int, effect: Effect, ramp: float, every: bool = False) -> list[Times]:
    """None, one, then more intervals as long as another one is worth its prior; with ``every``, once at least."""
    gates, most = b.gates(_may_last(effect), ramp), min(len(effect.timed) // 2, MAX_INTERVALS)
    found: list[Times] = [()]
    there = np.zeros(gates.shares.shape[1])
    for number in range(1, most + 1):
        more = []
        for sign, allowed in _allowed(gates, found[-1]):
            if allowed.any():
                gain = b.ratios(row, sign * gates.shares[allowed], there if number > 1 else None) + gates.prior[allowed]
                k = int(gain.argmax())
                more.append((float(logsumexp(gain)), sign, gates.times[allowed][k], gates.shares[allowed][k]))
        if not more:
            break
        gain, sign, times, share = max(more, key=lambda m: m[0])
        cost = np.log(NUMBER_OF_INTERVALS[number - 1] / NUMBER_OF_INTERVALS[number])
        # A run that says nothing has no event, whatever is usual.
        if gain < max(cost, 0.0) and not (every and number == 1 and gain > 0):
            break
        there = there + sign * share
        found.append(_with(found[-1], (float(times[0]), float(times[1])), sign))
    return found


def _allowed(gates: _Gates, there: Times) -> Iterator[tuple[float, Bool[np.ndarray, " m"]]]:
    """Intervals beside those that there are, and holes within them."""
    start, end = gates.times.T
    gap = MIN_BLOCKS * BLOCK
    yield 1.0, np.all([(end <= s - gap) | (start >= e + gap) for s, e in there] or [start == start], axis=0)
    if there:
        yield -1.0, np.any([(start >= s + gap) & (end <= e - gap) for s, e in there], axis=0)


def _with(there: Times, more: tuple[float, float], sign: float) -> Times:
    """Intervals with one more, or with a hole in one."""
    if sign > 0:
        return tuple(sorted((*there, more)))
    cut = [((s, more[0]), (more[1], e)) if s < more[0] < e else ((s, e),) for s, e in there]
    return tuple(interval for parts in cut for interval in parts)


def _all_blocks(
    likelihood: MarginalLikelihood,
    effect: Effect,
    rows: Sequence[Float[np.ndarray, "k p"]],
    noise: tuple[int, int],
    given: Hypothesis | None,
) -> list[_Blocks]:
    """All runs in blocks, each with its own rows of values."""
    data_set = likelihood.data_set
    # Not the levels that calm water needs: there the event itself is taken for process noise and wrong coefficients.
    low = data_set.levels.quiet(noise[0]), min(noise[1], 2)
    there = None if given is None else likelihood.columns(given)
    return [_blocks(data_set, run, effect, table, low, there) for run, table in enumerate(rows)]


def _blocks(
    data_set: WhitenedDataSet,
    run: int,
    effect: Effect,
    rows: Float[np.ndarray, "k p"],
    noise: tuple[int, int],
    given: HypothesisColumns | None,
) -> _Blocks:
    """A run in blocks, coefficients and latency taken out."""
    linearised, white = data_set.runs[run].linearised, data_set.at(noise[0]).white[run]
    time, step = linearised.run.time, linearised.run.step
    most = MAX_BLOCKS if len(rows) == 1 else MAX_BLOCKS_OF_GRID
    edges = np.arange(time[0], time[-1] + 1e-9, max(BLOCK, np.ptp(time) / most))
    edges[-1] = time[-1]
    count = len(edges) - 1
    which = np.clip(np.searchsorted(edges, time[1:] - step / 2) - 1, 0, count - 1)
    table = rows.copy()
    for values in table:
        _write(effect, values, ((ALWAYS, np.inf),))
    courses, shares = _main_courses(contribution(effect, table, linearised).moved, data_set.unit[:3])
    parts = courses.shape[-1]
    moved = np.zeros((len(time) - 1, courses.shape[1], parts, count))
    moved[np.arange(len(time) - 1), :, :, which] = courses
    none = np.zeros((len(time), len(linearised.states.channels), parts * count))
    base, blocks = data_set.at(noise[0]).base[run], white.embed(Columns(none, moved.reshape(*moved.shape[:2], -1)))
    if given is not None:  # the data less what is known
        known = white.embed(given.columns[run][:1])
        base = base[:1].joined(known).combined(np.array([1.0, -1.0])).joined(base[1:])
    own, cross = base.dot(base), base.dot(blocks)
    if given is not None:
        own, cross = given.turn(run, own, gram=True), given.turn(run, cross)
    nuisance = own[1:, 1:] + np.diag(data_set.nuisance_sd(noise[1], runs=1) ** -2.0)
    weights = np.linalg.solve(nuisance, cross[1:])
    gram, right = blocks.dot(blocks) - cross[1:].T @ weights, cross[0] - own[0, 1:] @ weights
    gram = gram.reshape(parts, count, parts, count)
    half = np.einsum("kp,pcqd->kcqd", shares, gram, optimize=True)
    whole = np.einsum("kcqd,kq->kcd", half, shares, optimize=True)
    return _Blocks(edges, shares @ right.reshape(parts, count), whole, SCALES if len(rows) > 1 else (1.0, 1.0))


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
