"""When an event acts: the times in each run that the whitened data ask for most, by the event's own force.

A run is cut into blocks (:mod:`.event_blocks`), whose inner products give the log likelihood ratio of every set of
times. With a flat prior over all pairs of a start and an end the mean of exp(ratio) is the Bayes factor of one interval
more.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import logsumexp

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis.event_blocks import (
    LONG_RAMPS,
    Blocks,
    Intervals,
    Times,
    block_columns,
    in_blocks,
    ratio,
    write_times,
)
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.estimation.hypothesis import NUMBER_OF_INTERVALS, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

MAX_INTERVALS = len(NUMBER_OF_INTERVALS) - 1
"""Times that an event happens in a run, at most."""
BELOW_STARTS, BEYOND_USUAL = 4.0, 100.0
"""By how much the least size that is tried is below the starts of an event; the largest is what is possible at sea, and
at most so many times what is usual."""
MAX_STARTS = 3
"""Starts of an event that a fit is made from."""
SAME_TIME = 15.0
"""Difference of times below which two sets of times lead to one fit [s]."""
MIN_GAIN, MAX_SWEEPS = 0.5, 4
"""Log evidence that other times must gain; how often each of several intervals is moved for that at most."""
MAX_DEFICIT = 20.0
"""Log evidence by which other times may lie behind before they are fitted: of a thousand, one in a hundred wins."""


class EventGrid:
    """An effect with times of its own at all its sizes, directions and levers, in every run cut into blocks.

    What it would add there is the same whatever acts beside it: it is made once.
    """

    def __init__(self, likelihood: MarginalLikelihood, effect: Effect) -> None:
        """Take the runs and the effect."""
        self._likelihood, self._effect, self._rows = likelihood, effect, _grid(effect)
        runs = likelihood.data_set.runs
        self._cuts = [block_columns(likelihood.data_set, run, effect, self._rows) for run in range(len(runs))]

    def best_windows(
        self, level: int, scatter: int, given: Hypothesis | None = None
    ) -> Iterator[Float[np.ndarray, "runs p"]]:
        """Start values of the effect, best first.

        Args:
            level: Force level at which data are whitened.
            scatter: Scatter level.
            given: Effects that are there already; what they explain is no event.

        Yields:
            Values for every run.
        """
        effect, rows = self._effect, self._rows
        blocks = in_blocks(self._likelihood, self._cuts, (level, scatter), given)
        found = self._by_one_interval(blocks)
        # As often as it happens in a run its size suits all its times: one interval for two short ones is too weak.
        sizes = [j for j, p in enumerate(effect.declared) if p.null is not None and not p.is_time]
        of_size: dict[tuple[float, ...], tuple[int, float]] = {}
        for k, ramp in found:
            of_size.setdefault((*rows[k, sizes], ramp), (k, ramp))
        sets = {(k, ramp): [_sets_of_times(b, k, effect, ramp) for b in blocks] for k, ramp in of_size.values()}
        often = sorted(sets, key=lambda at: -sum(weight for weight, _ in sets[at]))
        where = [j for j, p in enumerate(effect.declared) if p.null is None and not p.is_time]
        starts: dict[tuple[float, ...], tuple[int, float]] = {}
        for k, ramp in (*often, *found):
            starts.setdefault(tuple(rows[k, where]), (k, ramp))
        for k, ramp in list(starts.values())[:MAX_STARTS]:
            of_runs = sets.get((k, ramp)) or [_sets_of_times(b, k, effect, ramp) for b in blocks]
            yield self._placed(blocks, k, ramp, [of_run[-1] if len(of_run) > 1 else () for _, of_run in of_runs])

    def _by_one_interval(self, blocks: Sequence[Blocks]) -> list[tuple[int, float]]:
        """Rows of values and ramps by the log evidence of at most one interval in each run, best first."""
        effect, rows = self._effect, self._rows
        long = LONG_RAMPS if _may_last(effect) and any(p.name == RAMP.name for p in effect.declared) else ()
        seldom, once = np.log(NUMBER_OF_INTERVALS[:2])
        found = []
        for ramp in (_ramp(effect, rows[0]), *long):
            each = np.array([_evidence(b, slice(None), b.intervals(_may_last(effect), ramp)) for b in blocks])
            total = np.logaddexp(seldom, once + each).sum(axis=0)
            found += [(float(total[k]), k, ramp) for k in range(len(rows))]
        return [(k, ramp) for _, k, ramp in sorted(found, reverse=True)]

    def _placed(
        self, blocks: Sequence[Blocks], row: int, ramp: float, times: list[Times]
    ) -> Float[np.ndarray, "runs p"]:
        """A row of values with a ramp and times in each run; the likeliest interval of all where no run has any."""
        effect, values = self._effect, np.tile(self._rows[row], (len(blocks), 1))
        values[:, [p.name == RAMP.name for p in effect.declared]] = ramp
        if not any(times):
            gates = [b.intervals(_may_last(effect), ramp) for b in blocks]
            best = int(np.argmax([_evidence(b, row, g) for b, g in zip(blocks, gates, strict=True)]))
            _, times[best] = _one_more(blocks[best], row, gates[best], ())
        for run, of_run in enumerate(times):
            write_times(effect, values[run], of_run)
        return values


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
        cuts = [block_columns(likelihood.data_set, run, effect, row[None]) for run, row in enumerate(best.values[k])]
        blocks = in_blocks(likelihood, cuts, (level, scatter), given if given.effects else None)
        ramp = _ramp(effect, best.values[k][0])
        sets = [_sets_of_times(b, 0, effect, ramp, every=True)[1] for b in blocks]
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
                write_times(effect, trial.values[k][run], times)
            if not trial.fixed and np.isinf(trial.values[k][:, effect.timed]).all():
                continue
            if _score(likelihood, trial, level, scatter) < score - MAX_DEFICIT:
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


def acting(hypothesis: Hypothesis, runs: Sequence[Recording]) -> list[bool]:
    """Whether each effect acts in any of several runs: an event may have no time, or none before they end."""
    found = []
    for effect, values in zip(hypothesis.effects, hypothesis.values, strict=True):
        placed = [
            end > start and start < run.time[-1]
            for of_run, run in zip(values, runs, strict=True)
            for start, end in (times_of(effect, of_run) if effect.timed else ())
        ]
        found.append(not effect.timed or any(placed))
    return found


def _score(likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int, scatter: int) -> float:
    """Log evidence at one noise level."""
    return float(likelihood.posterior(likelihood.columns(hypothesis), level).evidence[scatter])


def _ramp(effect: Effect, values: Float[np.ndarray, " p"]) -> float:
    """Time in which it builds up [s]; a step where it declares none."""
    return next((float(v) for p, v in zip(effect.declared, values, strict=True) if p.name == RAMP.name), RAMP.low)


def _may_last(effect: Effect) -> bool:
    """Whether it may go on to the end of a run."""
    return bool(np.isinf(effect.declared[effect.timed[1]].starts[0]))


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
            low = np.abs(p.starts).min() / BELOW_STARTS
            high = min(max(abs(p.low), abs(p.high)), BEYOND_USUAL * p.spread)
            sizes = np.geomspace(low, high, 1 + round(float(np.log2(high / low))))
            axes.append([
                float(np.clip(s * size, p.low, p.high)) for s in sorted({*np.sign(p.starts)}) for size in sizes
            ])
    return np.array(list(product(*axes)), dtype=float)


def _evidence(blocks: Blocks, row: int | slice, gates: Intervals) -> Float[np.ndarray, "*k"]:
    """Log Bayes factor of one interval against none."""
    return logsumexp(blocks.ratios(row, gates.shares) + gates.prior, axis=-1)


def _sets_of_times(b: Blocks, row: int, effect: Effect, ramp: float, every: bool = False) -> tuple[float, list[Times]]:
    """None, one, then more intervals as long as another one is worth its prior; with ``every``, once at least.

    Returns:
        Log Bayes factor of the last of them against none, and all of them.
    """
    gates, most = b.intervals(_may_last(effect), ramp), min(len(effect.timed) // 2, MAX_INTERVALS)
    found, known, among = list[Times]([()]), 0.0, 0.0
    for number in range(1, most + 1):
        others, times = _one_more(b, row, gates, found[-1])
        if times == found[-1]:
            break
        trials = [(among + others, times), *([_pair(b, row, gates)] if number == 2 else [])]
        if number > 1:
            trials = [(others, _each_moved(b, row, gates, times)) for others, times in trials]
        weights = [others + b.ratios(row, gates.share_of(times)[None])[0] for others, times in trials]
        best = int(np.argmax(weights))
        gain = weights[best] - known
        cost = np.log(NUMBER_OF_INTERVALS[number - 1] / NUMBER_OF_INTERVALS[number])
        # A run that says nothing has no event, whatever is usual.
        if gain < max(cost, 0.0) and not (every and number == 1 and gain > 0):
            break
        known, (among, times) = weights[best], trials[best]
        found.append(times)
    return float(known + np.log(NUMBER_OF_INTERVALS[len(found) - 1] / NUMBER_OF_INTERVALS[0])), found


def _one_more(b: Blocks, row: int, gates: Intervals, there: Times) -> tuple[float, Times]:
    """The likeliest interval beside others, or the likeliest hole in one of them.

    Returns:
        Log of what any one more says over what this one does, its prior counted; all intervals with it, or those
        that there are where no room is left.
    """
    acts, found = gates.share_of(there) if there else None, []
    for sign, allowed in _allowed(gates, there):
        if allowed.any():
            gain = b.ratios(row, sign * gates.shares[allowed], acts) + gates.prior[allowed]
            k = int(gain.argmax())
            others = float(logsumexp(gain) - gain[k] + gates.prior[allowed][k])
            start, end = gates.times[allowed][k].tolist()
            found.append((float(gain[k]) + others, others, _with(there, (start, end), sign)))
    return max(found)[1:] if found else (0.0, there)


def _pair(b: Blocks, row: int, gates: Intervals) -> tuple[float, Times]:
    """Two intervals that together say most, among every second edge of the blocks.

    One that says most alone is a bad guess of where each of two is.

    Returns:
        Log of what any two say over what these do; the two, none where no two are far enough apart.
    """
    few = np.isin(gates.times, np.append(b.edges[::2], np.inf)).all(axis=1)
    times, shares = gates.times[few], gates.shares[few]
    power, right = shares @ b.gram[row] @ shares.T, shares @ b.right[row]
    i, j = np.nonzero(times[:, 1, None] + gates.gap <= times[:, 0])
    if not len(i):
        return 0.0, ()
    a, pull = power[i, i] + power[j, j] + 2 * power[i, j], right[i] + right[j]
    gain = ratio(pull, a, b.scales)
    k = int(gain.argmax())
    (start, end), (again, last) = times[i[k]].tolist(), times[j[k]].tolist()
    return float(logsumexp(gain) - gain[k] - np.log(len(gain))), ((start, end), (again, last))


def _each_moved(b: Blocks, row: int, gates: Intervals, times: Times) -> Times:
    """Several intervals, each moved to where it says most beside the others, as long as that says more."""
    for _ in range(MAX_SWEEPS * len(times)):
        best, moved = MIN_GAIN, times
        for k, one in enumerate(times):
            others = times[:k] + times[k + 1 :]
            (_, allowed), *_ = _allowed(gates, others)
            gain = b.ratios(row, gates.shares[allowed], gates.share_of(others)) + gates.prior[allowed]
            now = (gates.times[allowed] == one).all(axis=1)
            if now.any() and gain.max() - gain[now][0] > best:
                best, (start, end) = gain.max() - gain[now][0], gates.times[allowed][int(gain.argmax())].tolist()
                moved = tuple(sorted((*others, (start, end))))
        if moved == times:
            break
        times = moved
    return times


def _allowed(gates: Intervals, there: Times) -> Iterator[tuple[float, Bool[np.ndarray, " m"]]]:
    """Intervals beside those that there are, and holes within them."""
    (start, end), gap = gates.times.T, gates.gap
    yield 1.0, np.all([(end <= s - gap) | (start >= e + gap) for s, e in there] or [start == start], axis=0)
    if there:
        yield -1.0, np.any([(start >= s + gap) & (end <= e - gap) for s, e in there], axis=0)


def _with(there: Times, more: tuple[float, float], sign: float) -> Times:
    """Intervals with one more, or with a hole in one."""
    if sign > 0:
        return tuple(sorted((*there, more)))
    cut = [((s, more[0]), (more[1], e)) if s < more[0] < e else ((s, e),) for s, e in there]
    return tuple(interval for parts in cut for interval in parts)
