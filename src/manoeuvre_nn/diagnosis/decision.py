"""From evidence to a verdict: probabilities of every effect, of none, and of something unknown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb, log

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.formula import short_formula
from manoeuvre_nn.diagnosis.search import (
    MIN_GAIN_OF_SINGLE,
    MIN_GAIN_TO_RELINEARISE,
    SearchResult,
    worth_its_size,
)
from manoeuvre_nn.diagnosis.unknown import random_force, receiver_wander, unknown_by_receiver, unknown_evidence
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prior_average import gain_by_coefficient_priors
from manoeuvre_nn.estimation.relinearise import beside

PRIOR_NONE, PRIOR_UNKNOWN, PRIOR_OF_SIZE = 0.25, 0.10, (0.53, 0.10, 0.02)
"""Declared base rates: calm water holds, something that the shelf does not have, and one effect, two, three."""
MIN_GAIN_OF_UNKNOWN = 7.0
"""Least log Bayes factor in the fitted runs of something unknown, which has no formula to be tied to."""
MAX_PROCESS_OF_FITTED_MODEL = 0.1
"""Coloured force over the resistance and over 20 deg of rudder that a model fitted to other recordings may lack by
itself; more is something that it never met."""
MIN_CALM = 0.6
"""Least probability of calm water as long as nothing is likelier and nothing unknown acts."""
MAX_DEFICIT_IN_RACE, MAX_IN_RACE, MAX_SETTLED = 5.0, 3, 9
"""Log evidence by which a hypothesis may lie behind the best to be linearised about its own states; how many are at
once, and in all."""
MAX_UNPROVED, MIN_UNKNOWN = 0.49, 0.6
"""Probability of what was found but not proved, at most; of something unknown that is claimed, at least."""


@dataclass(frozen=True)
class Decision:
    """What the recordings say of every cause, and what may be claimed.

    Attributes:
        named: Whether the best hypothesis with a name is likelier than calm water: it is put to the proof.
        strange: Whether something unknown beats calm water by :data:`MIN_GAIN_OF_UNKNOWN`.
        none: Probability that calm water explains the recordings.
        unknown: That something acts which the shelf does not have.
        effects: Of every effect being present.
        best: The most probable hypothesis with a name; None if there is none.
        bayes: Log Bayes factor of the best hypothesis of every effect over calm water.
        unmodelled: Log Bayes factor of something unknown over calm water.
        claims: Hypotheses that may be claimed, in this order, if runs that were not used are predicted better.
        formula: A short formula for something unknown, whether it may be claimed or not.
        lead: Log odds by which something unknown is likelier than a best hypothesis that is put to the proof; 0 if it
            is not.
        without_rule: Log Bayes factor of something unknown over calm water without its short formula.
    """

    named: bool
    strange: bool
    none: float
    unknown: float
    effects: Mapping[str, float]
    best: FittedHypothesis | None
    bayes: Mapping[str, float]
    unmodelled: float = 0.0
    claims: Sequence[FittedHypothesis] = ()
    formula: FittedHypothesis | None = None
    lead: float = 0.0
    without_rule: float = np.inf

    def mismatch(self, chosen: FittedHypothesis) -> bool:
        """Whether a claim was proved, calm water being none, or something unknown beats calm water."""
        return bool(chosen.names) or self.strange

    def probability(self, name: str, chosen: FittedHypothesis) -> float:
        """Of an effect or ``unknown`` once it is known which claim was proved: what was not stays below one half."""
        if name == "unknown":
            probability = self.unknown if self.strange else min(self.unknown, MAX_UNPROVED)
            at_work = Formula.name in chosen.names or (self.strange and not chosen.names)
            return max(probability, MIN_UNKNOWN) if at_work else probability
        unproved = name not in chosen.names and (self.named or self.strange)
        if name in chosen.names:
            return max(self.effects[name], MIN_UNKNOWN)
        return min(self.effects[name], MAX_UNPROVED) if unproved else self.effects[name]

    def with_held_out(self, best: float, formula: float = -np.inf) -> "Decision":
        """The same once held-out runs have been weighed, where something unknown leads a hypothesis with a name.

        Nobody foretells a force without a rule: by something unknown held-out runs are as likely as by calm water, as
        far as it is its formula as by that.

        Args:
            best: Log evidence that the best hypothesis adds to calm water's in the held-out runs.
            formula: What the short formula adds; minus infinity without one.

        Returns:
            The best hypothesis is the first claim if all runs together make it likelier than something unknown.
        """
        there = max(0.0, formula)
        if self.without_rule < self.unmodelled:
            by_rule = self.unmodelled + np.log1p(-np.exp(self.without_rule - self.unmodelled))
            there = float(np.logaddexp(self.without_rule, by_rule + formula)) - self.unmodelled
        odds = best - there - self.lead
        if self.best is None or self.lead <= 0 or odds <= 0:
            return self
        both = self.unknown + min(self.effects[name] for name in self.best.names)
        share = both / (1 + np.exp(-odds))
        return replace(
            self,
            unknown=float(both - share),
            effects={n: max(p, float(share)) if n in self.best.names else p for n, p in self.effects.items()},
            claims=[self.best, *self.claims],
        )

    @property
    def rests_on_formula(self) -> bool:
        """Whether something unknown beats calm water by its short formula alone."""
        return self.strange and self.formula is not None and self.without_rule <= MIN_GAIN_OF_UNKNOWN

    def without_formula(self) -> "Decision":
        """The same once held-out runs have refuted the short formula that something unknown rests on.

        Returns:
            Something unknown is as likely as it is without a rule; the best hypothesis with a name, if one is likelier
            than calm water, is the claim.
        """
        unknown = self.unknown * float(np.exp(min(self.without_rule - self.unmodelled, 0.0)))
        total = max(1 - self.unknown + unknown, 1e-12)
        return replace(
            self,
            strange=False,
            none=self.none / total,
            unknown=unknown / total,
            effects={name: min(p / total, 1.0) for name, p in self.effects.items()},
            claims=[self.best] if self.best is not None and self.named else [],
        )

    def with_calm_water(self) -> "Decision":
        """The same once held-out runs made calm water likelier than the best hypothesis with a name.

        Returns:
            Nothing is left of it.
        """
        calm = max(self.none, MIN_CALM)
        share = (1 - calm) / max(1 - self.none, 1e-12)
        effects = {name: share * p for name, p in self.effects.items()}
        return replace(self, named=False, none=calm, unknown=share * self.unknown, effects=effects)

    def without_calm_water(self, result: SearchResult, named: bool = True) -> "Decision":
        """The same once calm water has missed the recordings by more than is unknown about it and its coefficients.

        Args:
            result: The search.
            named: Whether free runs missed them, which a weak effect may do; not that the coefficients are another
                ship's, which no effect on the shelf took up.

        Returns:
            Something acts; the best hypotheses with a name may be claimed if there is any evidence for them.
        """
        calm = min(self.none, 1 - MIN_CALM)
        share = (1 - calm) / max(1 - self.none, 1e-12)
        least = result.none.evidence + MIN_GAIN_OF_SINGLE
        likely = [j for j in plausible(result) if named and j.evidence > least][:MAX_IN_RACE]
        return replace(
            self,
            strange=True,
            none=calm,
            unknown=share * self.unknown,
            effects={name: min(share * p, 1.0) for name, p in self.effects.items()},
            claims=likely + ([] if self.formula is None else [self.formula]),
        )


def decide(result: SearchResult) -> Decision:
    """Weigh all hypotheses, and say what may be claimed."""
    there, calm = beside(result.likelihood, result.none.hypothesis), result.calm_gain
    formula, none, data_set = _formula(result, there), result.none.evidence, result.likelihood.data_set
    # A fitted model has errors that a formula takes up: to be claimed it must hold on other runs first.
    trained = is_fitted(data_set.dynamics)
    worthy, names = plausible(result), effects_tried(result)
    best = max(worthy, key=lambda j: weight(j, len(names)), default=None)
    # An event may be no more than the greatest push of a random force, whose course no other effect can follow.
    event = best is not None and not trained and any(e.timed for e in best.hypothesis.effects)
    random = random_force(there, result.none) if event else None
    any_force = unmodelled = unknown_evidence(there, result.none, None if trained else formula, calm, random)
    seen = _by_usual_receiver(replace(result, likelihood=there), best, unmodelled)
    none, unmodelled = none + seen[0], unmodelled + seen[1]
    result = replace(result, none=replace(result.none, evidence=none))
    log_weight = _log_weights(none, unmodelled, worthy, len(names))
    shares = np.exp(log_weight - log_weight.max())
    shares /= shares.sum()
    lacked = data_set.levels[result.none.best[0]].max()
    named = best is not None and likelier_than_calm_water(result, best)
    strange = unmodelled - none > MIN_GAIN_OF_UNKNOWN or bool(trained and lacked > MAX_PROCESS_OF_FITTED_MODEL)
    ruled = strange and formula is not None and not trained
    rule = any_force - unknown_evidence(there, result.none, None, calm, random) if ruled else -np.inf
    least = 0.0 if named or strange else MIN_CALM
    most = 1 - MIN_CALM if strange else 1.0
    if not least <= shares[0] <= most:
        calm = float(np.clip(shares[0], least, most))
        shares = np.r_[calm, shares[1:] * ((1 - calm) / shares[1:].sum())]
    return Decision(
        named=named,
        strange=strange,
        none=float(shares[0]),
        unknown=float(shares[1]),
        effects={n: float(sum(p for j, p in zip(worthy, shares[2:], strict=True) if n in j.names)) for n in names},
        best=best,
        bayes={n: max(j.evidence for j in result.fitted if n in j.names) - none for n in names},
        unmodelled=unmodelled - none,
        without_rule=unmodelled - none - rule,
        claims=_claims(result, best if named and shares[1] < 0.5 else None, formula, strange),
        formula=formula,
        lead=float(log_weight[1] - log_weight[2:].max()) if named and shares[1] >= 0.5 else 0.0,
    )


def _formula(result: SearchResult, there: MarginalLikelihood) -> FittedHypothesis | None:
    """A short formula for something unknown, about the states of calm water or, if clearly likelier, the smoothed ones.

    Those of calm water, and of what led the search, are far from what happened where an instrument was far off.

    Returns:
        It, weighed as the search is; None without one.
    """
    here = _weighed_formula(there, result.none, result.calm_gain)
    smoothed = _weighed_formula(*result.smoothed, result.calm_gain) if result.smoothed else None
    if here is None or smoothed is None:
        return here or smoothed
    return smoothed if smoothed.evidence > here.evidence + MIN_GAIN_TO_RELINEARISE else here


def _weighed_formula(
    likelihood: MarginalLikelihood, none: FittedHypothesis, calm_gain: float | None
) -> FittedHypothesis | None:
    """A short formula beside calm water, its evidence with any prior of coefficients if calm water's gain is known."""
    found = short_formula(likelihood, none)
    return None if found is None else weighed_beyond(likelihood, found, calm_gain)


def weighed_beyond(there: MarginalLikelihood, fitted: FittedHypothesis, calm_gain: float | None) -> FittedHypothesis:
    """A hypothesis with what it gains beyond calm water by any prior of coefficients; as it is if that is None."""
    if calm_gain is None:
        return fitted
    gain = gain_by_coefficient_priors(beside(there, fitted.hypothesis).data_set, fitted)
    return replace(fitted, evidence=fitted.evidence + gain - calm_gain)


def by_any_coefficient_prior(result: SearchResult) -> SearchResult:
    """The search with what all hypotheses gain beyond calm water where no prior of coefficients is preferred.

    That of the runs was chosen for calm water, or for what led by much when the search was half done.

    Args:
        result: The search, settled.

    Returns:
        It, what lies behind the first few gaining the least of these; calm water keeps its evidence. As it was where
        calm water is likeliest.
    """
    if max((j.evidence for j in result.fitted), default=-np.inf) <= result.none.evidence:
        return result

    def gain(j: FittedHypothesis) -> float:
        return gain_by_coefficient_priors(beside(result.likelihood, j.hypothesis).data_set, j)

    near, rest = result.fitted[:MAX_SETTLED], result.fitted[MAX_SETTLED:]
    # Gusts are no column of their own: a gusty wind gains what the steady one does.
    by_names, ways = {frozenset(j.names): j for j in result.fitted}, [_without_gusts(j) for j in near]
    calm = gain(result.none)
    more = {way: gain(by_names[way]) - calm for way in set(ways) if way in by_names}
    least = min(more.values(), default=0.0)
    weighed = [replace(j, evidence=j.evidence + more.get(way, least)) for j, way in zip(near, ways, strict=True)]
    weighed += [replace(j, evidence=j.evidence + least) for j in rest]
    return replace(result, fitted=sorted(weighed, key=lambda j: -j.evidence), calm_gain=calm)


def _by_usual_receiver(result: SearchResult, best: FittedHypothesis | None, unmodelled: float) -> tuple[float, float]:
    """What calm water and something unknown gain if half of either is seen by a receiver that wanders as usual ones do.

    Returns:
        Both gains in log evidence, less what the best hypothesis with a name gains if it is seen by one; 0 where calm
        water has none or is likeliest anyway.
    """
    none, likelihood = result.none, result.likelihood
    named = best is not None and likelier_than_calm_water(result, best)
    if not named and unmodelled < none.evidence + MIN_GAIN_OF_UNKNOWN:
        return 0.0, 0.0
    calm = float(np.logaddexp(none.evidence, receiver_wander(likelihood, none).evidence)) - log(2) - none.evidence
    if calm < 0:
        return 0.0, 0.0
    of_unknown = float(np.logaddexp(unmodelled, unknown_by_receiver(likelihood, none))) - log(2)
    unknown = max(of_unknown - unmodelled, 0.0)
    # The smoother took for noise what no usual receiver has: with less of it all are likelier, the name, too.
    if best is None:
        return calm, unknown
    by_name = max(receiver_wander(beside(likelihood, best.hypothesis), best).evidence - best.evidence, 0.0)
    return calm - by_name, unknown - by_name


def _log_weights(
    none: float, unmodelled: float, worthy: Sequence[FittedHypothesis], effects: int
) -> Float[np.ndarray, " h"]:
    """Evidence times base rate of calm water, of something unknown, and of the hypotheses with names."""
    prior = [PRIOR_NONE, PRIOR_UNKNOWN, *(base_rate(len(j.names), effects) for j in worthy)]
    return np.array([none, unmodelled, *(j.evidence for j in worthy)]) + np.log(prior)


def effects_tried(result: SearchResult) -> list[str]:
    """Names of all effects in a search."""
    return sorted({n for j in result.fitted for n in j.names})


def likelier_than_calm_water(result: SearchResult, fitted: FittedHypothesis) -> bool:
    """Whether a hypothesis of a search is likelier than calm water in the fitted runs, base rates counted."""
    odds = base_rate(len(fitted.names), len(effects_tried(result))) / PRIOR_NONE
    return fitted.evidence + log(odds) > result.none.evidence


def weight(fitted: FittedHypothesis, effects: int) -> float:
    """Log evidence and base rate of a hypothesis with a name, of so many effects that are tried."""
    return fitted.evidence + log(base_rate(len(fitted.names), effects))


def base_rate(size: int, effects: int) -> float:
    """Prior probability of one hypothesis with so many of the effects that are tried."""
    return PRIOR_OF_SIZE[size - 1] / max(comb(effects, size), 1)


def _claims(
    result: SearchResult, best: FittedHypothesis | None, formula: FittedHypothesis | None, strange: bool
) -> list[FittedHypothesis]:
    """What others may yet tell of one effect more, the best with a name, it without gusts, rivals, parts, a formula."""
    claims = [] if best is None else [best]
    for size in range(len(best.names) - 1 if best else 0, 0, -1):
        fewer = [j for j in result.fitted if len(j.names) == size and set(j.names) < set(claims[0].names)]
        claims += fewer if size > 1 else fewer[:1]
    steady = [j for j in result.fitted if best and is_without_gusts(j, best)][:1]
    near = [j for j in plausible(result) if best and are_rivals(best, j) and not is_without_gusts(j, best)]
    rivals = near[: MAX_IN_RACE - 1]
    claims[1:1] = [*steady, *rivals]
    # What the last effect of a rival adds is told beside the best of its parts, too.
    for several in rivals:
        parts = [j for j in result.fitted if has_one_less(j, several)]
        claims += [j for j in parts[:1] if all(j is not other for other in claims)]
    claims[:0] = _nearly(result, best)[:MAX_IN_RACE] if best else []
    if formula is not None and (strange or formula.evidence > result.none.evidence + MIN_GAIN_OF_UNKNOWN):
        claims.append(formula)
    return claims


def _nearly(result: SearchResult, best: FittedHypothesis) -> list[FittedHypothesis]:
    """Hypotheses with one effect more that base rates make likelier: by too little, but held-out runs may add to it."""
    effects, size = len(effects_tried(result)), len(best.names)
    least = log(base_rate(size, effects) / base_rate(size + 1, effects)) if size < len(PRIOR_OF_SIZE) else np.inf
    more = [j for j in result.fitted if len(j.names) == size + 1 and set(best.names) < set(j.names)]
    return [j for j in more if j.evidence > best.evidence + least and not _event_on_bound(j.hypothesis)]


def are_rivals(leading: FittedHypothesis, other: FittedHypothesis) -> bool:
    """Whether the fitted runs alone do not settle it: as many effects, not the same ones, and hardly less evidence."""
    close = other.evidence > leading.evidence - MAX_DEFICIT_IN_RACE
    return close and len(other.names) == len(leading.names) and set(other.names) != set(leading.names)


def is_simpler(fewer: FittedHypothesis, several: FittedHypothesis) -> bool:
    """Whether a hypothesis has one effect less than another one, whichever, or no gusts where that has."""
    one_less = len(fewer.names) == len(several.names) - 1 and Formula.name not in fewer.names
    return one_less or is_without_gusts(fewer, several)


def has_one_less(fewer: FittedHypothesis, several: FittedHypothesis) -> bool:
    """Whether a hypothesis is another one without one of its effects, or without its gusts."""
    is_part = len(fewer.names) == len(several.names) - 1 and set(fewer.names) < set(several.names)
    return is_part or is_without_gusts(fewer, several)


def is_without_gusts(steady: FittedHypothesis, gusty: FittedHypothesis) -> bool:
    """Whether a hypothesis is another one with a steady wind in place of a gusty one."""
    return set(steady.names) == _without_gusts(gusty) != set(gusty.names)


def _without_gusts(fitted: FittedHypothesis) -> frozenset[str]:
    """Names of a hypothesis' effects, of a steady wind in place of a gusty one."""
    return frozenset(e.variant_of if e.random else e.name for e in fitted.hypothesis.effects)


def plausible(result: SearchResult) -> list[FittedHypothesis]:
    """Hypotheses of which no effect is there by chance and no event is where it cannot be, best first."""
    known = {frozenset(j.names): j.evidence for j in reversed(result.fitted)}
    return [j for j in result.fitted if worth_its_size(j, known) and not _event_on_bound(j.hypothesis)]


def _event_on_bound(hypothesis: Hypothesis) -> bool:
    """Whether a force that acts for a time is of a size or at a place that is just possible."""
    # Windows may be laid around the stretches of any small random moment: the lever then runs to the end of its range.
    return any(hypothesis.effects[f.effect].timed for f, _ in hypothesis.on_bounds())
