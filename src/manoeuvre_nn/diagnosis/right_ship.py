"""Is this the right ship? Whether recordings ask for coefficients that are no longer those of the named ship.

Two accounts of the same recordings are compared, each a mixture over everything that was tried, calm water included:
the named ship, whose coefficients are off by no more than their usual scatter, with anything acting, known or not; and
a ship whose coefficients are off by more, with nothing acting but what is known. A few effects never take up all that
another ship does otherwise; what they leave is asked of the coefficients.

Source:
    Kass & Raftery 1995 (Journal of the American Statistical Association 90:773) for the comparison; Markov's inequality
    for its threshold: where the named ship sailed, a Bayes factor for the other account exceeds b with a probability of
    1/b at most.
"""

from collections.abc import Collection
from dataclasses import replace
from math import inf, log

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from manoeuvre_nn.diagnosis.decision import PRIOR_NONE, PRIOR_UNKNOWN, base_rate, effects_tried
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.diagnosis.unknown import random_force, receiver_wander
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, USUAL_LEVELS, log_prior_levels
from manoeuvre_nn.estimation.posterior import Posterior
from manoeuvre_nn.estimation.relinearise import beside

MIN_GAIN_OF_ANOTHER = 7.0
"""Log Bayes factor from which the ship is called in question: of the right one fewer than one set in a thousand."""
OTHER_SD = np.array([0.2, 0.5, 1.0, 2.0])
"""Relative errors of the coefficients that are another ship's."""
MAX_COMPLETED = 2
"""Hypotheses of each account that are looked at with all process noise before the ship is called in question."""


def right_ship_check(tried: SearchResult, formula: FittedHypothesis | None) -> Check:
    """Test whether the coefficients that the recordings ask for are still those of the named ship, whatever acts.

    Args:
        tried: The search.
        formula: A short formula for something unknown, if there is one.

    Returns:
        The test; the text says by how much the coefficients are off.
    """
    accounts = _Accounts(tried, formula)
    gain = accounts.gain()
    if gain > MIN_GAIN_OF_ANOTHER:
        # A search stops beside the best, and a force without a rule, or a receiver that wanders, has its own course.
        accounts, of_runs = accounts.completed(), (tried.likelihood, tried.none, USUAL_LEVELS)
        gain = accounts.gain(max(random_force(*of_runs).evidence, receiver_wander(*of_runs).evidence))
    passed, usual = gain <= MIN_GAIN_OF_ANOTHER, COEFFICIENT_SD_LEVELS[USUAL_LEVELS - 1]
    off = f"would have to be off by some {100 * accounts.size:.0f} %, not by {100 * usual:.0f} % at most as usual"
    text = f"whatever else acts, the coefficients {'are off by no more than usual' if passed else off}"
    return Check(RIGHT_SHIP, passed, f"{text}: log evidence {gain:+.0f}")


class _Accounts:
    """All hypotheses that were tried, to be weighed with usual and with unusual coefficients.

    Attributes:
        size: Relative error of the coefficients that is likeliest among those that are not usual.
    """

    def __init__(self, tried: SearchResult, formula: FittedHypothesis | None, everywhere: Collection[int] = ()) -> None:
        """Take the hypotheses with their base rates; of some, by their ids, all unusual errors are looked at.

        Of calm water they are in any case, of the others at first the least alone, which the search has looked at.
        """
        self.tried, self.formula = tried, formula
        effects = len(effects_tried(tried))
        self.weighed = [(tried.none, PRIOR_NONE), *((j, base_rate(len(j.names), effects)) for j in tried.fitted)]
        self.prior = log_prior_levels(tried.likelihood.data_set, PROCESS_PRIOR)
        looked_at = {id(tried.none), *everywhere}
        self.other = [
            self._unusual(j) if id(j) in looked_at else np.append(self._evidence(j, slice(-1, None)), [-inf] * 3)
            for j, _ in self.weighed
        ]
        self.size = float(OTHER_SD[np.argmax(self.other) % len(OTHER_SD)])

    def gain(self, random: float = -inf) -> float:
        """Log Bayes factor of a ship with unusual coefficients over the named one.

        Args:
            random: Log evidence of a random force on the named ship, or of a receiver that wanders, if it is known.

        Returns:
            The factor.
        """
        usual, shares = slice(0, USUAL_LEVELS), np.log([share for _, share in self.weighed])
        named = shares + [self._evidence(j, usual) for j, _ in self.weighed]
        other = shares + logsumexp(self.other, axis=1) - log(len(OTHER_SD))
        # Something unknown on the named ship: any force, one without a rule, or a formula.
        free = np.broadcast_to(logsumexp(self.prior, axis=0), self.prior.shape)[:, usual]
        at_will = logsumexp(self.tried.none.by_level[:, usual] + free) - logsumexp(free)
        ruled = -inf if self.formula is None else self._evidence(self.formula, usual)
        unknown = log(PRIOR_UNKNOWN / 3) + np.array([at_will, random, ruled])
        return float(logsumexp(other) - logsumexp([*named, *unknown]))

    def _evidence(self, fitted: FittedHypothesis, levels: slice) -> float:
        """Log evidence with coefficients off by one of some levels."""
        weighted = (fitted.by_level + self.prior)[:, levels]
        return float(logsumexp(weighted) - logsumexp(self.prior[:, levels])) + self._cost(fitted)

    def _cost(self, fitted: FittedHypothesis) -> float:
        """What bounds, and the choice of terms, add to the evidence of the levels: the same at all of them."""
        return fitted.evidence - float(logsumexp(fitted.by_level + self.prior))

    def _unusual(self, fitted: FittedHypothesis) -> Float[np.ndarray, " s"]:
        """Log evidence with each of the unusual errors, at the levels of process noise that were looked at."""
        process = logsumexp(self.prior, axis=1)
        seen = np.flatnonzero(np.isfinite(fitted.by_level).any(axis=1)).tolist()
        found = [self._posterior(fitted, g).evidence_at(OTHER_SD) + process[g] for g in seen]
        return logsumexp(found, axis=0) + self._cost(fitted)

    def _posterior(self, fitted: FittedHypothesis, level: int) -> Posterior:
        there = beside(self.tried.likelihood, fitted.hypothesis)
        return there.posterior(there.columns(fitted.hypothesis) if fitted.hypothesis.effects else None, level)

    def completed(self) -> "_Accounts":
        """The same with the best hypotheses at all levels of process noise that matter, and at all unusual errors."""
        named = [self._evidence(j, slice(0, USUAL_LEVELS)) for j, _ in self.weighed]
        orders = (np.argsort(named)[::-1], np.argsort(np.max(self.other, axis=1))[::-1])
        best = {id(self.weighed[k][0]) for order in orders for k in order[:MAX_COMPLETED]} | {id(self.tried.none)}
        made = {id(j): self._everywhere(j) for j, _ in self.weighed if id(j) in best and not j.random}
        fitted = [made.get(id(j), j) for j in self.tried.fitted]
        tried = replace(self.tried, none=made[id(self.tried.none)], fitted=fitted)
        formula = None if self.formula is None else self._everywhere(self.formula)
        return _Accounts(tried, formula, {id(j) for j in made.values()})

    def _everywhere(self, fitted: FittedHypothesis) -> FittedHypothesis:
        """A hypothesis also at the levels where unusual errors, and any force, are likeliest, with what these add."""
        by_level, process = fitted.by_level.copy(), logsumexp(self.prior, axis=1)

        def of_other_ship(level: int) -> float:
            return float(self._posterior(fitted, level).evidence_at(OTHER_SD).max() + process[level])

        def of_any_force(level: int) -> float:
            return float(self._posterior(fitted, level).evidence[:USUAL_LEVELS].max())

        levels = self.tried.likelihood.data_set.levels
        for score in (of_other_ship, of_any_force):
            for level in levels.uphill(fitted.best[0], score):
                by_level[level] = self._posterior(fitted, level).evidence
        added = logsumexp(by_level + self.prior) - logsumexp(fitted.by_level + self.prior)
        return replace(fitted, by_level=by_level, evidence=fitted.evidence + added)
