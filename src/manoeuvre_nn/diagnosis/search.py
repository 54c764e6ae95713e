"""The model search: every candidate, then combinations of two and three, fitted to all recordings together."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf

import numpy as np

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.fits import (
    PUBLISHED_SD_LEVEL,
    at_rest,
    exchanged,
    fitted_at_rest,
    refine,
    single,
)
from manoeuvre_nn.diagnosis.gusts import fitted_gusts
from manoeuvre_nn.diagnosis.partners import MAX_BUILT_UPON, Progress, extended
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import USUAL_LEVELS, MarginalLikelihood
from manoeuvre_nn.estimation.prior_average import with_likely_coefficient_prior
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.estimation.relinearise import beside

MIN_GAIN_TO_RELINEARISE = 12.0
"""Evidence of the best effect over calm water from which all is linearised again about its states, not calm water's."""
MAX_EFFECTS = 3
"""Effects in a hypothesis."""
MIN_GAIN_OF_SINGLE = 3.0
"""Evidence of an effect over calm water from which it is combined with others."""
MIN_GAIN_OF_VARIANT = 3.0
"""Log evidence that a current which changes must add to a steady one to be told: odds of 20 to 1."""
MIN_GAIN_OF_SECOND = 6.0
"""Least log evidence that a second or third effect must add, beyond the best without it and what one must have."""


@dataclass(frozen=True)
class SearchResult:
    """All hypotheses that were fitted, so far or at the end.

    Attributes:
        none: Calm water alone.
        fitted: Everything else, best first.
        likelihood: Where they were fitted.
        calm_gain: What calm water gains in log evidence where no prior of the coefficients is preferred, if all others
            have been weighed by what they gain beyond that; None if they have the prior of the runs.
        smoothed: The runs about the states found with any force allowed, and calm water there; None if not known.
    """

    none: FittedHypothesis
    fitted: list[FittedHypothesis] = field(repr=False)
    likelihood: MarginalLikelihood = field(repr=False)
    calm_gain: float | None = None
    smoothed: tuple[MarginalLikelihood, FittedHypothesis] | None = field(default=None, repr=False)


def search(
    data_set: WhitenedDataSet,
    effects: Sequence[Effect],
    progress: Progress = lambda _: None,
    workers: int = 1,
    known: FittedHypothesis | None = None,
) -> SearchResult:
    """Fit calm water, every effect, and combinations of two and three.

    Args:
        data_set: The fitted runs.
        effects: Prototypes of the candidates.
        progress: Is told which candidate is under test.
        workers: Processes among which the fits are shared out.
        known: What leads among any coefficients where these are to be as usual: it is built upon, too.

    Returns:
        The result.
    """
    # A gusty wind is a variant of what a steady wind explains, a tidal current of what a current does.
    plain, variants = [e for e in effects if not e.variant_of], [e for e in effects if e.variant_of]
    so_far = _alone(_calm_water(data_set), plain, progress, workers)
    if so_far.fitted:
        progress("second linearisation")
        none, best = so_far.none, so_far.fitted[0]
        clear = best.evidence > none.evidence + MIN_GAIN_TO_RELINEARISE
        so_far = _again(so_far, best if clear else none, workers)
    so_far = replace(so_far, fitted=_with_other_forms(so_far.likelihood, so_far.fitted, plain, workers))
    so_far = _combined(so_far, plain, progress, workers, known)
    fitted = [*so_far.fitted, *_varied(so_far, variants, progress, workers)]
    return replace(so_far, fitted=sorted(fitted, key=lambda j: -j.evidence))


def _calm_water(data_set: WhitenedDataSet) -> SearchResult:
    """Calm water, the errors of its coefficients going together as the runs make most likely."""
    likelihood = MarginalLikelihood(data_set)
    none = likelihood.evaluate(Hypothesis((), ()))
    likelihood = MarginalLikelihood(with_likely_coefficient_prior(data_set, none))
    data_set.release()
    none = likelihood.evaluate(Hypothesis((), ()), around=none.best[0])
    return SearchResult(none, [], likelihood, smoothed=(likelihood, none))


def _alone(calm: SearchResult, effects: Sequence[Effect], progress: Progress, workers: int) -> SearchResult:
    """Every effect alone, best first, and calm water, about its own states where it is far off."""
    everywhere = [(calm.likelihood, calm.none), *_about_calm_water(calm.likelihood, calm.none)]
    singles = []
    for found in shared_out([partial(single, there, e, none) for there, none in everywhere for e in effects], workers):
        progress(found.names[0])
        singles.append(found)
    if len(everywhere) > 1:
        singles = _about_own_states([there.data_set for there, _ in everywhere], singles, workers)
        calm.likelihood.data_set.release()
    likelihood, none = everywhere[-1]
    return replace(calm, none=none, likelihood=likelihood, fitted=sorted(singles, key=lambda j: -j.evidence))


def _combined(
    so_far: SearchResult,
    effects: Sequence[Effect],
    progress: Progress,
    workers: int,
    known: FittedHypothesis | None = None,
) -> SearchResult:
    """Two effects together, then three, each built upon the best few with one less."""
    leading = [s for s in so_far.fitted if s.evidence > so_far.none.evidence + MIN_GAIN_OF_SINGLE][:MAX_BUILT_UPON]
    published = _beside_published(so_far.none, so_far.fitted)
    leading += published
    for size in range(2, MAX_EFFECTS + 1):
        singles = [j for j in so_far.fitted if len(j.names) == 1]
        there, anew = so_far.likelihood, bool(published)
        more = list(extended(there, leading, singles, anew, progress, workers))
        if known is not None and len(known.names) == size - 1:
            # For itself: as long as its partner lacks, it does worse with usual coefficients than others do.
            usual = refine(there, known.hypothesis, known.best[0], min(known.best[1], USUAL_LEVELS - 1))
            more += extended(there, [usual], singles, anew, progress, workers)
        if more:
            so_far = _with_more(so_far, more, effects, progress, workers)
        told = {frozenset(j.names): j.evidence for j in so_far.fitted}
        leading = [j for j in so_far.fitted if len(j.names) == size and worth_its_size(j, told)][:MAX_BUILT_UPON]
    return so_far


def _with_more(
    so_far: SearchResult,
    more: Sequence[FittedHypothesis],
    effects: Sequence[Effect],
    progress: Progress,
    workers: int,
) -> SearchResult:
    """What larger hypotheses add, all linearised again about the states of the best where that gains much."""
    gained = max(j.evidence for j in more) - max((j.evidence for j in so_far.fitted), default=-inf)
    fitted = _with_other_forms(so_far.likelihood, [*so_far.fitted, *more], effects, workers)
    so_far = replace(so_far, fitted=fitted)
    if gained <= MIN_GAIN_TO_RELINEARISE:
        return so_far
    progress(f"linearisation about {' + '.join(fitted[0].names)}")
    so_far = _again(so_far, fitted[0], workers)
    fewer = shared_out(_without_each(so_far.likelihood, so_far.fitted), workers)
    return replace(so_far, fitted=_best_of_each([*so_far.fitted, *fewer]))


def _varied(
    so_far: SearchResult, variants: Sequence[Effect], progress: Progress, workers: int
) -> Iterator[FittedHypothesis]:
    """The best hypotheses with a steady wind or current, with a gusty or a tidal one in its place."""
    for variant in variants:
        steady = variant.variant_of
        with_it = [j for j in so_far.fitted[:MAX_BUILT_UPON] if steady in j.names]
        leading = [j for j in with_it if j.evidence > so_far.none.evidence]
        # Alone too: beside a steady wind gusts are taken for another effect. On ponds the mean may not show at all.
        on_pond = so_far.likelihood.data_set.dynamics.particulars.is_model
        likely = [j for j in so_far.fitted if j.names == (steady,) and (on_pond or j.evidence > so_far.none.evidence)]
        # Where gusts are strong, they are taken for others before they are taken for the mean wind.
        pairs = [j for j in so_far.fitted if steady in j.names and len(j.names) == 2]
        beside = [j for j in pairs[:1] if variant.random and j.evidence > so_far.none.evidence]
        asked = leading[:3] + [j for j in (*likely, *beside) if j not in leading[:3]]
        fit = fitted_gusts if variant.random else _with_variant
        made = shared_out([partial(fit, so_far.likelihood, j, variant) for j in asked], workers)
        for j, found in zip(asked, made, strict=True):
            progress(" + ".join(j.names).replace(steady, variant.name))
            # Where runs do not tell how it changes, it is as likely as what does not change: that is told.
            if variant.random or found.evidence > j.evidence + MIN_GAIN_OF_VARIANT:
                yield found


def _with_variant(likelihood: MarginalLikelihood, steady: FittedHypothesis, variant: Effect) -> FittedHypothesis:
    """A hypothesis with one effect as it changes in time."""
    return exchanged(likelihood, steady, steady.names.index(variant.variant_of), variant)


def _about_calm_water(
    likelihood: MarginalLikelihood, none: FittedHypothesis
) -> list[tuple[MarginalLikelihood, FittedHypothesis]]:
    """The runs about the states of calm water, and it there; nothing where it gains little by them."""
    # Where calm water is far off, so are the states that were found with any force allowed: linearised about them
    # nothing may explain the recordings.
    data_set, calm = at_rest(likelihood.data_set, none)
    if calm.evidence > none.evidence + MIN_GAIN_TO_RELINEARISE:
        return [(MarginalLikelihood(data_set), calm)]
    if data_set is not likelihood.data_set:
        data_set.release()
    return []


def _about_own_states(
    data_sets: Sequence[WhitenedDataSet], singles: Sequence[FittedHypothesis], workers: int
) -> list[FittedHypothesis]:
    """Fits of every effect, made about the states of each data set in turn: one an effect, the best about its own."""
    count = len(singles) // len(data_sets)
    followed, others = [], []
    for k, data_set in enumerate(data_sets):
        made = sorted(singles[k * count : (k + 1) * count], key=lambda j: -j.evidence)
        followed += [partial(fitted_at_rest, data_set, j) for j in made[:MAX_BUILT_UPON]]
        others += made[MAX_BUILT_UPON:]
    return _best_of_each([*shared_out(followed, workers), *others])


def _beside_published(none: FittedHypothesis, singles: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """What pairs are built upon, too, where calm water needs worse coefficients than are published.

    Coefficients that may be anything explain two strong effects better than one of the two does.

    Returns:
        The best effects with published coefficients; none where calm water does with these.
    """
    at = PROCESS_LEVELS.quiet(none.best[0]), PUBLISHED_SD_LEVEL
    if none.best[1] <= PUBLISHED_SD_LEVEL + 1:
        return []
    ranked = sorted(singles, key=lambda s: -float(s.by_level[:, : PUBLISHED_SD_LEVEL + 1].max()))
    return [replace(s, best=at) for s in ranked[:MAX_BUILT_UPON]]


def _again(so_far: SearchResult, about: FittedHypothesis, workers: int) -> SearchResult:
    """The best few and calm water about the states of one of them; the others keep their place between these two."""
    data_set, leading = at_rest(so_far.likelihood.data_set, about)
    there = MarginalLikelihood(with_likely_coefficient_prior(data_set, leading))
    for followed in (data_set, so_far.likelihood.data_set):
        followed.release()
    calm = beside(there, so_far.none.hypothesis).evaluate(so_far.none.hypothesis, around=so_far.none.best[0])
    anew = [partial(refine, there, j.hypothesis, *j.best) for j in so_far.fitted[:MAX_BUILT_UPON]]
    best = list(shared_out(anew, workers))
    leading = next((j for j in best if j.names == about.names), calm)
    rest = _between((so_far.none, calm), (about, leading), so_far.fitted[MAX_BUILT_UPON:])
    return replace(so_far, none=calm, fitted=sorted(best + rest, key=lambda j: -j.evidence), likelihood=there)


def _between(
    calm: tuple[FittedHypothesis, FittedHypothesis],
    leading: tuple[FittedHypothesis, FittedHypothesis],
    others: Sequence[FittedHypothesis],
) -> list[FittedHypothesis]:
    """Hypotheses that were fitted about other states than calm water and the leading one are by now.

    What does as well as either still does: where calm water misses much, its log evidence changes by more than what
    parts the leading ones, and where it changes by less they gain nothing on it.

    Args:
        calm: Calm water there, and here.
        leading: The leading one there, and here.
        others: As they were fitted there.

    Returns:
        Each with what both gain, weighed by how far it stands from calm water towards the leading one.
    """
    (low, of_calm), (top, of_leading) = (
        (there.evidence, here.evidence - there.evidence) for there, here in (calm, leading)
    )
    shares = [float(np.clip((j.evidence - low) / (top - low), 0.0, 1.0)) if top > low else 1.0 for j in others]
    more = [(1 - share) * of_calm + share * of_leading for share in shares]
    return [replace(j, evidence=j.evidence + gained) for j, gained in zip(others, more, strict=True)]


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


def _with_other_forms(
    likelihood: MarginalLikelihood, fitted: Sequence[FittedHypothesis], effects: Sequence[Effect], workers: int = 1
) -> list[FittedHypothesis]:
    """Hypotheses with different effects, the best also with each event exchanged for every other one and without each.

    Placed on its own, another event may have stopped at other times: that would judge the times and not the effect.
    And what an effect adds can only be told beside the same without it.

    Returns:
        The same and the new ones, the most evidence first.
    """
    if not fitted:
        return []
    best = max(fitted, key=lambda j: j.evidence)
    present, more = best.hypothesis.effects, _without_each(likelihood, fitted)
    for k, effect in enumerate(present):
        beside_it = {e.exclusive for e in present if e is not effect and e.exclusive}
        for other in effects:
            if effect.timed and other.timed and other.name not in best.names and other.exclusive not in beside_it:
                more.append(partial(exchanged, likelihood, best, k, other))
    return _best_of_each([*fitted, *shared_out(more, workers)])


def _without_each(
    likelihood: MarginalLikelihood, fitted: Sequence[FittedHypothesis]
) -> list[Callable[[], FittedHypothesis]]:
    """The best hypothesis without each of its effects, if it has several.

    Beside another an effect may have found the values or times that it missed alone.

    Returns:
        Fits to be done.
    """
    best = max(fitted, key=lambda j: j.evidence)
    count = len(best.hypothesis.effects)
    without = [best.hypothesis.without(k) for k in range(count if count > 1 else 0)]
    return [partial(refine, likelihood, fewer, *best.best) for fewer in without]


def _best_of_each(fitted: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """The best fit of each set of effects, the most evidence first."""
    of_each: dict[frozenset[str], FittedHypothesis] = {}
    for j in sorted(fitted, key=lambda j: -j.evidence):
        of_each.setdefault(frozenset(j.names), j)
    return list(of_each.values())
