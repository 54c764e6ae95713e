"""One effect more beside the best few hypotheses: its partners, screened by a linear step, and the best ones fitted."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

from manoeuvre_nn.diagnosis.fits import PUBLISHED_SD_LEVEL, from_four_sides, refine, sizes_of
from manoeuvre_nn.diagnosis.windows import EventGrid
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

MAX_BUILT_UPON = 5
"""Number of hypotheses that are built upon."""
Progress = Callable[[str], None]


def extended(
    likelihood: MarginalLikelihood,
    leading: Sequence[FittedHypothesis],
    singles: Sequence[FittedHypothesis],
    anew: bool,
    progress: Progress,
    workers: int,
) -> Iterator[FittedHypothesis]:
    """One effect more: all partners of the best few hypotheses, screened by a linear step, the best ones fitted.

    Where calm water is far off, a partner's values alone say nothing of it: it is tried ``anew`` from all its starts.

    Yields:
        The best few, fitted.
    """
    if not leading:
        return
    seen: set[tuple[frozenset[str], tuple[int, int]]] = set()
    partnered: list[list[FittedHypothesis]] = [[] for _ in singles]
    for first in leading:
        for firsts, second in zip(partnered, singles, strict=True):
            names = frozenset((*first.names, *second.names))
            if len(names) > len(first.names) and (names, first.best) not in seen and not _same_thing(first, second):
                seen.add((names, first.best))
                firsts.append(first)

    def screen(second: FittedHypothesis, firsts: list[FittedHypothesis]) -> list[tuple[float, int, Hypothesis]]:
        starts, (effect,) = [second.hypothesis, *_elsewhere(second.hypothesis, anew)], second.hypothesis.effects
        grid = EventGrid(likelihood, effect) if effect.timed and firsts else None
        return [
            (likelihood.pair_evidence(first.hypothesis, partner, *first.best), k, partner)
            for k, first in enumerate(firsts)
            for partner in (starts if grid is None else _restarts(grid, first, second.hypothesis))
        ]

    # By partners: what of one is whitened serves all that it is tried beside.
    found = shared_out([partial(screen, *both) for both in zip(singles, partnered, strict=True)], workers)
    screened = [
        (score, firsts[k], firsts[k].hypothesis.joined(partner))
        for firsts, scores in zip(partnered, found, strict=True)
        for score, k, partner in scores
    ]
    # Those beside published coefficients and those beside worse ones each for themselves: before it is fitted, the
    # right partner explains less at published ones than any does where coefficients may be anything.
    finalists: dict[bool, dict[frozenset[str], tuple[FittedHypothesis, Hypothesis]]] = {}
    for _, first, both in sorted(screened, key=lambda t: -t[0]):
        finalists.setdefault(first.best[1] > PUBLISHED_SD_LEVEL, {}).setdefault(frozenset(both.names), (first, both))
    chosen = [pair for pairs in finalists.values() for pair in list(pairs.values())[:MAX_BUILT_UPON]]
    for pair in shared_out([partial(refine, likelihood, both, *first.best) for first, both in chosen], workers):
        progress(" + ".join(pair.names))
        yield pair


def _restarts(grid: EventGrid, first: FittedHypothesis, alone: Hypothesis) -> list[Hypothesis]:
    """When an event may act beside another effect: as alone, or when that one leaves it."""
    events = grid.best_windows(*first.best, first.hypothesis)
    return [alone, *(replace(alone, values=(values,)) for values in events)]


def _elsewhere(alone: Hypothesis, anew: bool) -> Iterator[Hypothesis]:
    """An effect with a direction from four sides, its sizes at their starts; another, if asked for, from all starts."""
    (effect,), values = alone.effects, alone.values[0].copy()
    if any(p.period for p in effect.declared):
        yield from from_four_sides(alone)
        return
    sizes = sizes_of(effect)
    for start in product(*(effect.declared[j].starts for j in sizes)) if anew else ():
        values[:, sizes] = start
        yield replace(alone, values=(values.copy(),))


def _same_thing(first: FittedHypothesis, second: FittedHypothesis) -> bool:
    """Whether two different effects of both are one thing in two forms: winds are one wind, however it blows."""
    effects = {e.name: e.exclusive for j in (first, second) for e in j.hypothesis.effects if e.exclusive}
    return len(effects) > len(set(effects.values()))
