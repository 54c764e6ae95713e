"""The model search: every candidate, then combinations of two and three, fitted to all recordings together."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.gusts import fitted_gusts
from manoeuvre_nn.diagnosis.windows import best_windows, replaced
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, quiet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.relinearise import (
    MAX_PASSES,
    STATES_AT_REST,
    beside,
    change_of_states,
    refined,
    with_likely_coefficient_prior,
)

MAX_FIRST_DEFICIT = 30.0
"""Log evidence by which a candidate may lie behind calm water after its first fit, made at calm water's noise."""
MIN_GAIN_TO_RELINEARISE = 12.0
"""Evidence of the best effect over calm water from which everything is linearised again about its states; below it,
everything is about those of calm water."""
MAX_BUILT_UPON = 5
"""Number of hypotheses that are built upon."""
MAX_EFFECTS = 3
"""Effects in a hypothesis."""
MIN_GAIN_OF_SINGLE = 3.0
"""Evidence of an effect over calm water from which it is combined with others."""
MIN_GAIN_OF_SECOND = 6.0
"""Least log evidence that a second or third effect must add, to the best without it and to what raises the alarm."""
PUBLISHED_SD_LEVEL = 2
"""Level of the coefficients' standard deviation that published sets have, 3 %."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class SearchResult:
    """All hypotheses that were fitted.

    Attributes:
        none: Calm water alone.
        fitted: Everything else, best first.
        likelihood: Where they were fitted.
    """

    none: FittedHypothesis
    fitted: list[FittedHypothesis] = field(repr=False)
    likelihood: MarginalLikelihood = field(repr=False)


def search(
    data_set: WhitenedDataSet, effects: Sequence[Effect], progress: Progress = lambda _: None, workers: int = 1
) -> SearchResult:
    """Fit calm water, every effect, and combinations of two and three.

    Args:
        data_set: The fitted runs.
        effects: Prototypes of the candidates.
        progress: Is told which candidate is under test.
        workers: Processes among which the candidates are shared out.

    Returns:
        The result.
    """
    likelihood = MarginalLikelihood(data_set)
    none = likelihood.evaluate(Hypothesis((), ()))
    likelihood = MarginalLikelihood(with_likely_coefficient_prior(data_set, none))
    data_set.release()
    none = likelihood.evaluate(Hypothesis((), ()), around=none.best[0])

    # A gusty wind is a variant of what a steady wind explains: see below.
    plain, variants = [e for e in effects if not e.variant_of], [e for e in effects if e.variant_of]

    def alone(number: int) -> FittedHypothesis:
        return single(likelihood, plain[number], none)

    singles = []
    for effect, found in zip(plain, shared_out(alone, len(plain), workers), strict=True):
        progress(effect.name)
        singles.append(found)
    singles.sort(key=lambda j: -j.evidence)
    if singles:
        progress("second linearisation")
        clear = singles[0].evidence > none.evidence + MIN_GAIN_TO_RELINEARISE
        likelihood, none, singles = _again(likelihood, none, singles, workers, singles[0] if clear else none)
    fitted = _with_other_forms(likelihood, singles, plain)
    leading = [s for s in fitted if s.evidence > none.evidence + MIN_GAIN_OF_SINGLE] or _beside_published(none, fitted)
    for size in range(2, MAX_EFFECTS + 1):
        singles = [j for j in fitted if len(j.names) == 1]
        more = list(_extended(likelihood, leading, singles, progress, workers))
        gained = max((j.evidence for j in more), default=-inf) - max((j.evidence for j in fitted), default=-inf)
        fitted = _with_other_forms(likelihood, [*fitted, *more], plain) if more else fitted
        if more and gained > MIN_GAIN_TO_RELINEARISE:
            progress(f"linearisation about {' + '.join(fitted[0].names)}")
            likelihood, none, fitted = _again(likelihood, none, fitted, workers, fitted[0])
        known = {frozenset(j.names): j.evidence for j in fitted}
        leading = [j for j in fitted if len(j.names) == size and worth_its_size(j, known)]
    for variant in variants:
        steady = variant.variant_of
        windy = [j for j in fitted[:MAX_BUILT_UPON] if steady in j.names and j.evidence > none.evidence]
        # Alone too: beside a steady wind gusts are taken for another effect. On ponds the mean may not show at all.
        on_pond = data_set.dynamics.particulars.is_model
        unmixed = [j for j in fitted if j.names == (steady,) and (on_pond or j.evidence > none.evidence)]
        for j in windy[:3] + [j for j in unmixed if j not in windy[:3]]:
            progress(" + ".join(j.names).replace(steady, variant.name))
            fitted.append(fitted_gusts(likelihood, j, variant))
    fitted.sort(key=lambda j: -j.evidence)
    return SearchResult(none, fitted, likelihood)


def _beside_published(none: FittedHypothesis, singles: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """What pairs are built upon where no effect alone gains and calm water needs worse coefficients than are published.

    Coefficients that may be anything explain two strong effects better than one of the two does.

    Returns:
        The best effects with published coefficients; none where calm water does with these.
    """
    at = quiet(none.best[0]), PUBLISHED_SD_LEVEL
    if none.best[1] <= PUBLISHED_SD_LEVEL + 1:
        return []
    ranked = sorted(singles, key=lambda s: -float(s.by_level[:, : PUBLISHED_SD_LEVEL + 1].max()))
    return [replace(s, best=at) for s in ranked[:MAX_BUILT_UPON]]


def _again(
    likelihood: MarginalLikelihood,
    none: FittedHypothesis,
    fitted: Sequence[FittedHypothesis],
    workers: int,
    about: FittedHypothesis,
) -> tuple[MarginalLikelihood, FittedHypothesis, list[FittedHypothesis]]:
    """The best few and calm water about the states of one of them; the others keep their distance to that one."""
    data_set, leading = at_rest(likelihood.data_set, about)
    there = MarginalLikelihood(with_likely_coefficient_prior(data_set, leading))
    for followed in (data_set, likelihood.data_set):
        followed.release()
    calm = beside(there, none.hypothesis).evaluate(none.hypothesis, around=none.best[0])

    def refitted(number: int) -> FittedHypothesis:
        return refine(there, fitted[number].hypothesis, *fitted[number].best)

    best = list(shared_out(refitted, min(len(fitted), MAX_BUILT_UPON), workers))
    # Not to calm water: where that misses much, its own evidence changes by more than what parts the others.
    gained = next((j for j in best if j.names == about.names), calm).evidence - about.evidence
    rest = [replace(j, evidence=j.evidence + gained) for j in fitted[MAX_BUILT_UPON:]]
    return there, calm, sorted(best + rest, key=lambda j: -j.evidence)


def single(likelihood: MarginalLikelihood, effect: Effect, none: FittedHypothesis) -> FittedHypothesis:
    """Fit one effect alone, from the noise levels of calm water and from those at which it must explain the misfit.

    Where calm water calls a large effect wrong coefficients, a fit that begins there stays where the effect is small.

    Returns:
        The better of the two.
    """
    found = []
    noises = {(quiet(none.best[0]), min(none.best[1], PUBLISHED_SD_LEVEL))}
    if not any(p.per_run for p in effect.declared):  # events are placed where they must explain the misfit anyway
        noises.add(none.best)
    for level, scatter in noises:
        tried = [likelihood.improve(h, level, scatter, rounds=3) for h in _starts(likelihood, effect, level, scatter)]
        best = max(tried, key=lambda t: t[1])[0]
        found.append(refine(likelihood, best, level, scatter, none.evidence - MAX_FIRST_DEFICIT))
    return max(found, key=lambda j: j.evidence)


def refine(
    likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int, scatter: int, min_evidence: float = -inf
) -> FittedHypothesis:
    """Fit to the end, at the noise levels that the hypothesis itself leaves.

    Args:
        likelihood: Where.
        hypothesis: Roughly fitted.
        level: Level of the process noise to begin with.
        scatter: Level of the coefficients' standard deviation to begin with.
        min_evidence: Evidence below which it is not worked on.

    Returns:
        What came out.
    """
    hypothesis, _ = beside(likelihood, hypothesis).improve(hypothesis, level, scatter)
    there = beside(likelihood, hypothesis)
    fitted = there.evaluate(hypothesis, around=level)
    if fitted.evidence > min_evidence:
        elsewhen = replaced(there, fitted.hypothesis, *fitted.best)
        if elsewhen is not fitted.hypothesis:
            fitted = there.evaluate(elsewhen, around=fitted.best[0])
    for _ in range(2):
        if fitted.evidence < min_evidence:
            return fitted
        before = fitted
        hypothesis, _ = beside(likelihood, fitted.hypothesis).improve(fitted.hypothesis, *fitted.best, rounds=4)
        fitted = beside(likelihood, hypothesis).evaluate(hypothesis, around=fitted.best[0])
        if fitted.evidence < before.evidence + 0.1:
            return max(before, fitted, key=lambda j: j.evidence)
    return fitted


def at_rest(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> tuple[WhitenedDataSet, FittedHypothesis]:
    """A hypothesis about its own states, linearised until they rest.

    Returns:
        The runs about its states, and the hypothesis fitted to them.
    """
    random, data_set = fitted.random, beside(MarginalLikelihood(data_set), fitted.hypothesis).data_set
    for _ in range(MAX_PASSES):
        there = refined(data_set, fitted)
        if change_of_states(data_set, there, fitted.best[0]) < STATES_AT_REST:
            break
        data_set, fitted = there, refine(MarginalLikelihood(there), fitted.hypothesis, *fitted.best)
    return data_set, replace(fitted, random=random)


def _starts(likelihood: MarginalLikelihood, effect: Effect, level: int, scatter: int) -> list[Hypothesis]:
    """The two most promising of all starts, by what a linear step from each would gain; windows of an event."""
    data_set = likelihood.data_set
    if any(p.per_run for p in effect.declared):
        events = best_windows(likelihood, effect, level, scatter)
        return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in events]
    grid = np.array(list(product(*[(p.null,) if p.form else p.starts for p in effect.declared])), dtype=float)
    made = np.tile(grid[:, None], (1, len(data_set.runs), 1))
    if len(grid) < 3:
        return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in made]

    def scores(values: Float[np.ndarray, "k runs p"]) -> Float[np.ndarray, " k"]:
        each = [Hypothesis((effect,), (v,), campaigns=data_set.campaigns) for v in values]
        found = [likelihood.posterior(likelihood.columns(h), level).evidence[scatter] for h in each]
        return np.array(found)

    # What acts in one campaign is another thing than what acts in the next: each on its own, nothing in the others.
    best = np.empty((2, len(data_set.runs), grid.shape[1]))
    for number in set(data_set.campaigns) or {0}:
        mine = np.array(data_set.campaigns or [0] * len(data_set.runs)) == number
        alone = np.where(mine[None, :, None], made, effect.null().numpy())
        best[:, mine] = made[np.argsort(scores(alone))[::-1][:2]][:, mine]
    return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in best]


def worth_its_size(fitted: FittedHypothesis, known: Mapping[frozenset[str], float]) -> bool:
    """Whether the last of several effects adds more than chance does.

    Args:
        fitted: What was found.
        known: Log evidence of hypotheses by their effects' names.

    Returns:
        True for one effect alone.
    """
    names = frozenset(fitted.names)
    parts = [evidence for part, evidence in known.items() if part and part < names]
    return fitted.evidence > max(parts, default=-inf) + (MIN_GAIN_OF_SECOND if len(names) > 1 else 0.0)


def _extended(
    likelihood: MarginalLikelihood,
    leading: Sequence[FittedHypothesis],
    singles: Sequence[FittedHypothesis],
    progress: Progress,
    workers: int,
) -> Iterator[FittedHypothesis]:
    """One effect more: all partners of the best few hypotheses, screened by a linear step, the best ones fitted."""
    if not leading:
        return
    seen: set[frozenset[str]] = set()
    screened = []
    turned = [(second, [second.hypothesis, *_turned(second.hypothesis)]) for second in singles]
    for first in leading[:MAX_BUILT_UPON]:
        for second, starts in turned:
            names = frozenset((*first.names, *second.names))
            if len(names) == len(first.names) or names in seen or _same_thing(first, second):
                continue
            seen.add(names)
            for partner in _restarts(likelihood, first, starts):
                score = likelihood.pair_evidence(first.hypothesis, partner, *first.best)
                screened.append((score, first, first.hypothesis.joined(partner)))
    screened.sort(key=lambda t: -t[0])
    finalists: dict[frozenset[str], tuple[FittedHypothesis, Hypothesis]] = {}
    for _, first, both in screened:
        finalists.setdefault(frozenset(both.names), (first, both))

    chosen = list(finalists.values())[:MAX_BUILT_UPON]

    def together(number: int) -> FittedHypothesis:
        first, both = chosen[number]
        return refine(likelihood, both, *first.best)

    for (_, both), found in zip(chosen, shared_out(together, len(chosen), workers), strict=True):
        progress(" + ".join(both.names))
        yield found


def _restarts(likelihood: MarginalLikelihood, first: FittedHypothesis, starts: list[Hypothesis]) -> list[Hypothesis]:
    """Where a partner may stand beside another effect: as alone, turned, or as an event where that one leaves it."""
    (effect,) = starts[0].effects
    if not any(p.per_run for p in effect.declared):
        return starts
    events = best_windows(likelihood, effect, *first.best, first.hypothesis)
    return [starts[0], *(replace(starts[0], values=(values,)) for values in events)]


def _turned(alone: Hypothesis) -> Iterator[Hypothesis]:
    """An effect with a direction from four sides, its other parameters at their starts."""
    (effect,), values = alone.effects, alone.values[0].copy()
    directions = [j for j, p in enumerate(effect.declared) if p.period]
    for j, p in enumerate(effect.declared):
        if not (p.form or p.period or p.per_run or p.random):
            values[:, j] = p.starts[0]
    for angle in range(0, 360, 90) if directions else ():
        values[:, directions[0]] = angle
        yield replace(alone, values=(values.copy(),))


def _with_other_forms(
    likelihood: MarginalLikelihood, fitted: Sequence[FittedHypothesis], effects: Sequence[Effect]
) -> list[FittedHypothesis]:
    """Hypotheses with different effects, the best also with its events in each other form and without each effect.

    Placed on its own, another form may have stopped at other times: that would judge the times and not the form. And
    what an effect adds can only be told beside the same without it.

    Returns:
        The same and the new ones, the most evidence first.
    """
    if not fitted:
        return []
    best, exchanged = max(fitted, key=lambda j: j.evidence), []
    level, scatter = best.best
    for k, effect in enumerate(best.hypothesis.effects):
        for other in effects:
            events = all(any(p.per_run for p in e.declared) for e in (effect, other))
            if events and effect.exclusive and other.exclusive == effect.exclusive and other.name != effect.name:
                starts = _exchanged(best.hypothesis, k, other)
                made = max((likelihood.improve(h, level, scatter, 3) for h in starts), key=lambda found: found[1])[0]
                exchanged.append(refine(likelihood, made, level, scatter))
    known = {frozenset(j.names) for j in fitted}
    several = len(best.hypothesis.effects) > 1
    for fewer in (best.hypothesis.without(k) for k in range(len(best.hypothesis.effects)) if several):
        if frozenset(fewer.names) not in known:
            exchanged.append(refine(likelihood, fewer, level, scatter))
    of_each: dict[frozenset[str], FittedHypothesis] = {}
    for j in sorted([*fitted, *exchanged], key=lambda j: -j.evidence):
        of_each.setdefault(frozenset(j.names), j)
    return list(of_each.values())


def _exchanged(h: Hypothesis, number: int, other: Effect) -> Iterator[Hypothesis]:
    """A hypothesis with one effect in another form, at the values that both have and at each start of the rest."""
    known = {p.name: h.values[number][:, j] for j, p in enumerate(h.effects[number].declared)}
    for start in product(*[(0.0,) if p.name in known else p.starts for p in other.declared]):
        columns = [
            known.get(p.name, np.full(len(h.values[number]), s)) for p, s in zip(other.declared, start, strict=True)
        ]
        effects, values = list(h.effects), list(h.values)
        effects[number], values[number] = other, np.stack(columns, axis=1)
        yield replace(h, effects=tuple(effects), values=tuple(values))


def _same_thing(first: FittedHypothesis, second: FittedHypothesis) -> bool:
    """Whether two different effects of both are one thing in two forms: winds are one wind, however it blows."""
    effects = {e.name: e.exclusive for j in (first, second) for e in j.hypothesis.effects if e.exclusive}
    return len(effects) > len(set(effects.values()))
