"""The contest: every candidate, then combinations, fitted and judged on all recordings together."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf

import numpy as np

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.bench import Bench
from manoeuvre_nn.diagnosis.court import Court, linear
from manoeuvre_nn.diagnosis.gusts import judge_gusts
from manoeuvre_nn.diagnosis.hypothesis import RANDOM, Hypothesis, Judged
from manoeuvre_nn.diagnosis.refine import refined
from manoeuvre_nn.diagnosis.screen import Screen
from manoeuvre_nn.diagnosis.windows import best_windows
from manoeuvre_nn.diagnosis.workers import shared_out

HOPE = 30.0
"""Log evidence by which a candidate may lie behind calm water after its first fit, made at calm water's noise."""
WORTH = 12.0
"""Evidence of the best effect over calm water from which everything is linearised again about its track."""
WIDTH = 5
"""Number of hypotheses that are built upon."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Contest:
    """All hypotheses that were judged.

    Attributes:
        none: Calm water alone.
        judged: Everything else, best first.
        court: Where they were judged.
    """

    none: Judged
    judged: list[Judged] = field(repr=False)
    court: Court = field(repr=False)


def contest(bench: Bench, effects: Sequence[Effect], progress: Progress = lambda _: None, workers: int = 1) -> Contest:
    """Judge calm water, every effect, and combinations of two.

    Args:
        bench: The fitted runs.
        effects: Prototypes of the candidates.
        progress: Is told which candidate is under test.
        workers: Processes among which the candidates are shared out.

    Returns:
        The contest.
    """
    court = Court(bench)
    none = court.judge(Hypothesis((), ()))

    # A gusty wind is a variant of what a steady wind explains: see below.
    plain = [e for e in effects if e.name != "wind_gusty"]

    def alone(number: int) -> Judged | None:
        return single(court, plain[number], none)

    singles = []
    for effect, found in zip(plain, shared_out(alone, len(plain), workers), strict=True):
        progress(effect.name)
        singles += [found] if found is not None else []
    singles.sort(key=lambda j: -j.evidence)
    if singles and singles[0].evidence > none.evidence + WORTH:
        progress("second linearisation")
        court, none, singles = _again(court, none, singles)
    pairs = list(_pairs(court, singles, none, progress, workers))
    judged = sorted(singles + pairs, key=lambda j: -j.evidence)
    windy = [j for j in judged[:WIDTH] if "wind_steady" in j.names and j.evidence > none.evidence]
    # On ponds the mean wind may show in nothing but its gusts.
    unmixed = [j for j in judged if j.names == ("wind_steady",) and bench.dynamics.particulars.is_model]
    gusty = next((e for e in effects if e.name == "wind_gusty"), None)
    if gusty is not None:
        for j in windy[:3] + [j for j in unmixed if j not in windy[:3]]:
            progress(" + ".join(j.names).replace("wind_steady", "wind_gusty"))
            judged.append(judge_gusts(court, j, gusty))
    judged.sort(key=lambda j: -j.evidence)
    return Contest(none, judged, court)


def _again(court: Court, none: Judged, singles: Sequence[Judged]) -> tuple[Court, Judged, list[Judged]]:
    """The best few singles and calm water about the track of the best; the others keep their distance to calm water."""
    there = Court(refined(court.bench, singles[0]))
    calm = there.judge(Hypothesis((), ()), around=none.best[0])
    best = [settle(there, j.hypothesis, *j.best) for j in singles[:WIDTH]]
    rest = [replace(j, evidence=j.evidence - none.evidence + calm.evidence) for j in singles[WIDTH:]]
    return there, calm, sorted(best + rest, key=lambda j: -j.evidence)


def single(court: Court, effect: Effect, none: Judged, given: Hypothesis | None = None) -> Judged | None:
    """Fit and judge one effect, alone or beside others.

    Args:
        court: Where.
        effect: The candidate.
        none: Calm water, for the noise levels at the start.
        given: Effects that are there already.

    Returns:
        What came out; None if there is nothing to start from.
    """
    level, scatter = none.best
    tried = []
    for start in _starts(court, effect, level, scatter, given):
        hypothesis, score = court.improve(start, level, scatter, rounds=3)
        tried.append((score, hypothesis))
    if not tried:
        return None
    best = max(tried, key=lambda t: t[0])[1]
    return settle(court, best, level, scatter, none.evidence - HOPE)


def settle(court: Court, hypothesis: Hypothesis, level: int, scatter: int, least: float = -inf) -> Judged:
    """Fit to the end, at the noise levels that the hypothesis itself leaves.

    Args:
        court: Where.
        hypothesis: Roughly fitted.
        level: Force level to begin with.
        scatter: Scatter level to begin with.
        least: Evidence that is worth further work.

    Returns:
        What came out.
    """
    hypothesis, _ = court.improve(hypothesis, level, scatter)
    judged = court.judge(hypothesis, around=level)
    for _ in range(2):
        if judged.evidence < least:
            return judged
        before = judged
        hypothesis, _ = court.improve(judged.hypothesis, *judged.best, rounds=4)
        judged = court.judge(hypothesis, around=judged.best[0])
        if judged.evidence < before.evidence + 0.1:
            return max(before, judged, key=lambda j: j.evidence)
    return judged


def _starts(court: Court, effect: Effect, level: int, scatter: int, given: Hypothesis | None) -> Iterator[Hypothesis]:
    """The two most promising of all starts, by what a linear step from each would gain."""
    bench = court.bench
    runs = len(bench.places)
    grid = np.array(list(product(*[(p.null,) if p.form else p.starts for p in effect.declared])), dtype=float)
    if any(p.per_run for p in effect.declared):
        for values in best_windows(court, effect, grid, level, scatter, given):
            mine = Hypothesis((effect,), (values,))
            yield mine if given is None else given.joined(mine)
        return
    made = [Hypothesis((effect,), (np.tile(row, (runs, 1)),)) for row in grid]
    made = made if given is None else [given.joined(h) for h in made]
    if len(made) > 2:
        scores = [court.posterior(linear(bench, h), [level]).by_level[0, scatter] for h in made]
        made = [made[k] for k in np.argsort(scores)[::-1][:2]]
    yield from made


def _pairs(court: Court, singles: Sequence[Judged], none: Judged, progress: Progress, workers: int) -> Iterator[Judged]:
    """Two effects at once: all partners of the best few singles, screened by a linear step, the best ones fitted."""
    worth = [s for s in singles if s.evidence > none.evidence + 3.0]
    if not worth:
        return
    seen: set[frozenset[str]] = set()
    screen, screened = Screen(court), []
    turned: dict[str, list[Hypothesis]] = {}
    for first in worth[:WIDTH]:
        for second in singles:
            names = frozenset((*first.names, *second.names))
            if len(names) < 2 or names in seen or _same_thing(first, second):
                continue
            seen.add(names)
            for partner in _restarts(court, first, second, turned):
                score = screen.evidence(first.hypothesis, partner, *first.best)
                screened.append((score, first, first.hypothesis.joined(partner)))
    screened.sort(key=lambda t: -t[0])
    finalists: dict[frozenset[str], tuple[Judged, Hypothesis]] = {}
    for _, first, both in screened:
        finalists.setdefault(frozenset(both.names), (first, both))

    chosen = list(finalists.values())[:WIDTH]

    def together(number: int) -> Judged:
        first, both = chosen[number]
        return settle(court, both, *first.best)

    for (_, both), found in zip(chosen, shared_out(together, len(chosen), workers), strict=True):
        progress(" + ".join(both.names))
        yield found


def _restarts(court: Court, first: Judged, second: Judged, turned: dict[str, list[Hypothesis]]) -> list[Hypothesis]:
    """Where a partner may stand beside another effect: as alone, turned, or as an event where that one leaves it."""
    alone = second.hypothesis
    effect = alone.effects[0]
    if effect.name not in turned:
        turned[effect.name] = [alone, *_turned(alone)]
    made = turned[effect.name]
    if not any(p.per_run for p in effect.declared):
        return made
    grid = np.stack([h.values[0][0] for h in made])
    placed = best_windows(court, effect, grid, *first.best, first.hypothesis)
    return [alone, *(Hypothesis((effect,), (values,)) for values in placed)]


def _turned(alone: Hypothesis) -> Iterator[Hypothesis]:
    """An effect with a direction from four sides, its other parameters at their starts."""
    effect = alone.effects[0]
    directions = [j for j, p in enumerate(effect.declared) if p.period]
    for angle in range(0, 360, 90) if directions else ():
        values = alone.values[0].copy()
        for j, p in enumerate(effect.declared):
            if not p.form and not p.period and not p.per_run and p.name not in RANDOM:
                values[:, j] = p.starts[0]
        values[:, directions[0]] = angle
        yield Hypothesis((effect,), (values,))


def _same_thing(first: Judged, second: Judged) -> bool:
    """Winds are one wind: steady, gusty and setting in are not combined."""
    wind = {"wind_steady", "wind_gusty", "wind_onset"}
    local = {"side_force", "bow_thruster", "tow"}
    both = {*first.names, *second.names}
    return len(both & wind) > 1 or len(both & local) > 1
