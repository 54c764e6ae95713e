"""Hypotheses near the best about their own states, before they are weighed: all were linearised about the same ones."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import log

import numpy as np
from scipy.special import logsumexp

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.decision import (
    MAX_DEFICIT_IN_RACE,
    MAX_IN_RACE,
    MAX_SETTLED,
    PRIOR_NONE,
    by_any_coefficient_prior,
    effects_tried,
    has_one_less,
    likelier_than_calm_water,
    plausible,
    weighed_beyond,
    weight,
)
from manoeuvre_nn.diagnosis.fits import at_rest, refine
from manoeuvre_nn.diagnosis.search import Progress, SearchResult, search
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import (
    PROCESS_PRIOR,
    USUAL_LEVELS,
    MarginalLikelihood,
    log_prior_levels,
)
from manoeuvre_nn.estimation.relinearise import beside


def searched(
    data_set: WhitenedDataSet, effects: Sequence[Effect], progress: Progress = lambda _: None, workers: int = 1
) -> SearchResult:
    """Search, weigh, settle; where the leading hypothesis needs a ship with other coefficients, without such ships too.

    Coefficients that may be anything take up the greater part of several strong effects, so that the search follows
    none of them. With those as they usually are it does, beginning with what led, too; what it finds so is weighed with
    any coefficients.

    Args:
        data_set: The fitted runs.
        effects: Prototypes of the candidates.
        progress: Is told which candidate is under test.
        workers: Processes among which the fits are shared out.

    Returns:
        The one of both in which the leading hypothesis is likelier, base rates counted.
    """
    found = settled(by_any_coefficient_prior(search(data_set, effects, progress, workers)), workers)
    leading = _leading(found)[1]
    if is_fitted(data_set.dynamics) or leading.best[1] < USUAL_LEVELS:
        return found
    progress("all again with coefficients as usual")
    prior = data_set.coefficient_prior._replace(usual=True)
    usual = settled(search(data_set.with_prior(prior), effects, progress, workers, leading), workers)
    again = by_any_coefficient_prior(_with_any_coefficients(usual))
    return again if _leading(again)[0] > _leading(found)[0] else found


def _leading(result: SearchResult) -> tuple[float, FittedHypothesis]:
    """What leads, and its log evidence and base rate; calm water if nothing else does."""
    effects, calm = len(effects_tried(result)), result.calm_gain or 0.0
    weighed = [(weight(j, effects) + calm, j) for j in result.fitted]
    return max([(result.none.evidence + calm + log(PRIOR_NONE), result.none), *weighed], key=lambda one: one[0])


def _with_any_coefficients(usual: SearchResult) -> SearchResult:
    """A search in which coefficients were as usual with its hypotheses weighed with any."""
    known = usual.likelihood.data_set
    data_set = _of_any_coefficients(known)
    before, now = (log_prior_levels(one, PROCESS_PRIOR) for one in (known, data_set))

    def weighed(j: FittedHypothesis) -> FittedHypothesis:
        more = float(logsumexp(j.by_level + now) - logsumexp(j.by_level + before))
        best = np.unravel_index(int((j.by_level + now).argmax()), now.shape)
        return replace(j, evidence=j.evidence + more, best=(int(best[0]), int(best[1])))

    likelihood = MarginalLikelihood(data_set)
    none = beside(likelihood, usual.none.hypothesis).evaluate(usual.none.hypothesis, around=usual.none.best[0])
    fitted = sorted(map(weighed, usual.fitted), key=lambda j: -j.evidence)
    smoothed = usual.smoothed
    if smoothed is not None:
        smoothed = MarginalLikelihood(_of_any_coefficients(smoothed[0].data_set)), smoothed[1]
    return SearchResult(none, fitted, likelihood, smoothed=smoothed)


def _of_any_coefficients(data_set: WhitenedDataSet) -> WhitenedDataSet:
    """Runs of a ship whose coefficients may be anything."""
    return data_set.with_prior(data_set.coefficient_prior._replace(usual=False))


def settled(result: SearchResult, workers: int = 1) -> SearchResult:
    """The search with the hypotheses that are still in the race linearised about their own states until these rest.

    They are those within :data:`MAX_DEFICIT_IN_RACE` of the best, base rates counted, and of several effects the best
    with one of them less: what the last one adds about common states it need not add about its own, nor beside the
    same without it about these. Where these lose, the next best come in their place. One effect alone is in no race.
    All were linearised about the same states before; what is never in the race loses what the best loses.

    Args:
        result: Of the search.
        workers: Processes among which they are shared out.

    Returns:
        The same with their evidence about their own states.
    """
    known, lost = dict[tuple[str, ...], float](), 0.0
    while len(known) < MAX_SETTLED:
        race = _race(result)
        new = {j.names for j in race} - known.keys()
        if not new:
            break
        # What has rested does so again only if a part of it is new.
        parts = {j.names: [part for part in race if has_one_less(part, j)] for j in race}
        asked = [j for j in race if j.names in new or any(part.names in new for part in parts[j.names])]
        steps = [partial(_rested, result.likelihood.data_set, j, parts[j.names], result.calm_gain) for j in asked]
        first, leading = not known, race[0]
        for found, beside_it in shared_out(steps, workers):
            for rested in (found, *beside_it):
                known[rested.names] = max(known.get(rested.names, -np.inf), rested.evidence)
        # What was not looked at is not credited with what the best gains.
        lost = max(leading.evidence - known[leading.names], 0.0) if first else lost
        result = _with_evidence(result, known)
    return _with_evidence(result, known, lost)


def _with_evidence(result: SearchResult, known: Mapping[tuple[str, ...], float], lost: float = 0.0) -> SearchResult:
    """The search with log evidence that is known by now; all others lose some."""
    fitted = [replace(j, evidence=known.get(j.names, j.evidence - lost)) for j in result.fitted]
    return replace(result, fitted=sorted(fitted, key=lambda j: -j.evidence))


def _rested(
    data_set: WhitenedDataSet, fitted: FittedHypothesis, parts: Sequence[FittedHypothesis], calm_gain: float | None
) -> tuple[FittedHypothesis, list[FittedHypothesis]]:
    """A hypothesis about its own states, and others about these states, weighed as the search is."""
    there, found = at_rest(data_set, fitted)
    likelihood = MarginalLikelihood(there)
    others = [refine(beside(likelihood, p.hypothesis), p.hypothesis, *p.best) for p in parts]
    fewer = [weighed_beyond(likelihood, j, calm_gain) for j in others]
    # What stayed as it was has been weighed so before.
    return (fitted if found.evidence == fitted.evidence else weighed_beyond(likelihood, found, calm_gain)), fewer


def _race(result: SearchResult) -> list[FittedHypothesis]:
    """What :func:`settled` settles, the best first."""
    # Of gusts the course is integrated out about the states of the steady wind.
    steady = [j for j in result.fitted if not any(e.random for e in j.hypothesis.effects)]
    worthy, effects = {j.names for j in plausible(result)}, len(effects_tried(result))
    named = sorted((j for j in steady if j.names in worthy), key=lambda j: -weight(j, effects))
    if not named or not likelier_than_calm_water(result, named[0]):
        return []
    race = [j for j in named if weight(j, effects) > weight(named[0], effects) - MAX_DEFICIT_IN_RACE][:MAX_IN_RACE]
    for several in race[:]:
        fewer = [j for j in steady if has_one_less(j, several)]
        race += [j for j in fewer[:1] if all(j.names != other.names for other in race)]
    return race if len(race) > 1 else []
