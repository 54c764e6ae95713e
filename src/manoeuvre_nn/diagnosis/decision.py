"""From evidence to a verdict: probabilities of every effect, of none, and of something unknown."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from manoeuvre_nn.diagnosis.alarm import MIN_GAIN_OF_NAMED, MIN_GAIN_OF_SECOND, MIN_GAIN_OF_UNKNOWN, raised
from manoeuvre_nn.diagnosis.formula import FoundFormula, short_formula
from manoeuvre_nn.diagnosis.search import SearchResult, at_rest
from manoeuvre_nn.diagnosis.unknown import unknown_evidence
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis

PRIOR = {"none": 0.25, "single": 0.53, "pair": 0.12, "unknown": 0.10}
"""Declared base rates: calm water holds, one effect, two, or something that the shelf does not have."""
MAX_PROCESS_OF_FITTED_MODEL = 0.1
"""Coloured force over the resistance and over 20 deg of rudder that a model fitted to other recordings may lack by
itself; more is something that it never met."""
MIN_CALM_WITHOUT_ALARM = 0.6
"""Least probability of calm water as long as no alarm is raised."""
MAX_DEFICIT_IN_RACE, MAX_IN_RACE = 5.0, 3
"""Log evidence by which a hypothesis may lie behind the best to be linearised about its own states; how many are."""


@dataclass(frozen=True)
class Decision:
    """Probabilities.

    Attributes:
        named: Whether the best named hypothesis beats calm water by more than chance.
        strange: Whether something unknown does.
        none: That calm water explains the recordings.
        unknown: That something acts which the shelf does not have.
        effects: Of every effect being present.
        best: The most probable hypothesis with a name; None if there is none.
        bayes: Log Bayes factor of the best hypothesis of every effect over calm water.
        unmodelled: Log Bayes factor of something unknown over calm water.
        formula: The best short formula for something unknown; None if no term is worth its choice.
    """

    named: bool
    strange: bool
    none: float
    unknown: float
    effects: Mapping[str, float]
    best: FittedHypothesis | None
    bayes: Mapping[str, float]
    unmodelled: float = 0.0
    formula: FoundFormula | None = None


def settled(result: SearchResult) -> SearchResult:
    """The search with the hypotheses that are still in the race linearised about their own states until these rest.

    They are those within :data:`MAX_DEFICIT_IN_RACE` of the best; with one alone there is no race. All were linearised
    about the same states before.

    Args:
        result: What was fitted.

    Returns:
        The same with their evidence about their own states.
    """
    # Of gusts the course is integrated out about the states of the steady wind.
    named = [j for j in result.fitted if _worth_its_size(result, j) and "wind_gusty" not in j.names]
    race = [j for j in named if j.evidence > named[0].evidence - MAX_DEFICIT_IN_RACE][:MAX_IN_RACE]
    if len(race) < 2 or race[0].evidence < result.none.evidence + MIN_GAIN_OF_NAMED:
        return result
    evidence = {id(j): at_rest(result.likelihood.data_set, j)[1].evidence for j in race}
    fitted = [replace(j, evidence=evidence.get(id(j), j.evidence)) for j in result.fitted]
    return replace(result, fitted=sorted(fitted, key=lambda j: -j.evidence))


def decide(result: SearchResult, temperature: float = 1.0) -> Decision:
    """Weigh all hypotheses.

    Args:
        result: What was fitted.
        temperature: Log evidences are divided by it: more than 1 where they were found too sure of themselves.

    Returns:
        The verdict.
    """
    formula = short_formula(result.likelihood, result.none)
    # A fitted model has errors that a formula takes up: to raise the alarm it must hold on other runs first.
    data_set = result.likelihood.data_set
    unmodelled = unknown_evidence(result.likelihood, result.none, None if is_fitted(data_set.dynamics) else formula)
    fitted = [j for j in result.fitted if _worth_its_size(result, j)]
    names = sorted({n for j in result.fitted for n in j.names})
    singles, pairs = len(names), max(len(names) * (len(names) - 1) / 2, 1)
    weights: list[tuple[tuple[str, ...], float, float]] = [((), result.none.evidence, PRIOR["none"])]
    weights.append((("unknown",), unmodelled, PRIOR["unknown"]))
    for j in fitted:
        prior = PRIOR["single"] / singles if len(j.names) == 1 else PRIOR["pair"] / pairs
        weights.append((j.names, j.evidence, prior))
    log_weight = np.array([evidence / temperature + np.log(prior) for _, evidence, prior in weights])
    share = np.exp(log_weight - log_weight.max())
    share /= share.sum()
    best = fitted[int(log_weight[2:].argmax())] if fitted else None
    named, strange = raised(result, best), unmodelled - result.none.evidence > MIN_GAIN_OF_UNKNOWN
    strange |= is_fitted(data_set.dynamics) and bool(
        data_set.levels[result.none.best[0]].max() > MAX_PROCESS_OF_FITTED_MODEL
    )
    if named or strange:
        if share[0] > 1 - MIN_CALM_WITHOUT_ALARM:
            share[1:] *= MIN_CALM_WITHOUT_ALARM / share[1:].sum()
            share[0] = 1 - MIN_CALM_WITHOUT_ALARM
    elif share[0] < MIN_CALM_WITHOUT_ALARM:
        share[1:] *= (1 - MIN_CALM_WITHOUT_ALARM) / share[1:].sum()
        share[0] = MIN_CALM_WITHOUT_ALARM
    effects = {n: float(sum(p for (has, *_), p in zip(weights, share, strict=True) if n in has)) for n in names}
    bayes = {n: max(j.evidence for j in result.fitted if n in j.names) - result.none.evidence for n in names}
    return Decision(
        named,
        strange,
        float(share[0]),
        float(share[1]),
        effects,
        best,
        bayes,
        unmodelled - result.none.evidence,
        formula,
    )


def _worth_its_size(result: SearchResult, fitted: FittedHypothesis) -> bool:
    """A second effect must add more than chance does."""
    if len(fitted.names) < 2:
        return True
    parts = [j.evidence for j in result.fitted if len(j.names) == 1 and j.names[0] in fitted.names]
    return fitted.evidence > max(parts, default=-np.inf) + MIN_GAIN_OF_SECOND
