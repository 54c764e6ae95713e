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

from dataclasses import replace
from math import comb, inf, log

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from manoeuvre_nn.diagnosis.decision import PRIOR_NONE, PRIOR_OF_SIZE, PRIOR_UNKNOWN
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.diagnosis.unknown import random_force
from manoeuvre_nn.estimation.corrections import USUAL_SCATTER
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, log_prior_levels
from manoeuvre_nn.estimation.relinearise import beside

MIN_GAIN_OF_ANOTHER = 7.0
"""Log Bayes factor from which the ship is called in question: of the right one fewer than one set in a thousand."""
USUAL_LEVELS = int(np.searchsorted(COEFFICIENT_SD_LEVELS, 2 * USUAL_SCATTER))
"""Number of the levels of the coefficients' standard deviation that are usual; those behind are another ship's."""
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
        # A search stops beside the best, and beside it a force without a rule is a course of its own.
        gain = accounts.completed().gain(random_force(tried.likelihood, tried.none, USUAL_LEVELS).evidence)
    usual, wide = (100 * COEFFICIENT_SD_LEVELS[k] for k in (USUAL_LEVELS - 1, -1))
    passed = gain <= MIN_GAIN_OF_ANOTHER
    off = f"would have to be off by some {wide:.0f} %, not by {usual:.0f} % at most as usual"
    text = f"whatever else acts, the coefficients {f'are not off by {wide:.0f} %' if passed else off}"
    return Check(RIGHT_SHIP, passed, f"{text}: log evidence {gain:+.0f}")


class _Accounts:
    """All hypotheses that were tried, to be weighed with usual and with unusual coefficients."""

    def __init__(self, tried: SearchResult, formula: FittedHypothesis | None) -> None:
        """Take the hypotheses with their base rates."""
        self.tried, self.formula = tried, formula
        effects = len({name for j in tried.fitted for name in j.names})
        of_size = [share / max(comb(effects, k), 1) for k, share in enumerate(PRIOR_OF_SIZE, 1)]
        self.weighed = [(tried.none, PRIOR_NONE), *((j, of_size[len(j.names) - 1]) for j in tried.fitted)]

    def gain(self, random: float = -inf) -> float:
        """Log Bayes factor of a ship with unusual coefficients over the named one.

        Args:
            random: Log evidence of a random force on the named ship, if it is known.

        Returns:
            The factor.
        """
        data_set = self.tried.likelihood.data_set
        prior = log_prior_levels(data_set, PROCESS_PRIOR)
        named, other = (
            [log(share) + self._evidence(j, prior, levels) for j, share in self.weighed]
            for levels in (slice(0, USUAL_LEVELS), slice(USUAL_LEVELS, None))
        )
        # Something unknown on the named ship: any force, one without a rule, or a formula.
        free = np.broadcast_to(logsumexp(prior, axis=0), prior.shape)[:, :USUAL_LEVELS]
        at_will = logsumexp(self.tried.none.by_level[:, :USUAL_LEVELS] + free) - logsumexp(free)
        ruled = -inf if self.formula is None else self._evidence(self.formula, prior, slice(0, USUAL_LEVELS))
        unknown = log(PRIOR_UNKNOWN / 3) + np.array([at_will, random, ruled])
        return float(logsumexp(other) - logsumexp([*named, *unknown]))

    @staticmethod
    def _evidence(fitted: FittedHypothesis, prior: Float[np.ndarray, "g s"], levels: slice) -> float:
        """Log evidence with coefficients off by one of some levels; what its choice costs is taken off as before."""
        cost = fitted.evidence - logsumexp(fitted.by_level + prior)
        return float(logsumexp((fitted.by_level + prior)[:, levels]) - logsumexp(prior[:, levels]) + cost)

    def completed(self) -> "_Accounts":
        """The same with the best hypotheses at every level of the process noise."""
        prior = log_prior_levels(self.tried.likelihood.data_set, PROCESS_PRIOR)
        best = {
            id(j)
            for levels in (slice(0, USUAL_LEVELS), slice(USUAL_LEVELS, None))
            for j in sorted(self.tried.fitted, key=lambda j: -self._evidence(j, prior, levels))[:MAX_COMPLETED]
        }
        fitted = [self._everywhere(j) if id(j) in best and not j.random else j for j in self.tried.fitted]
        formula = None if self.formula is None else self._everywhere(self.formula)
        return _Accounts(replace(self.tried, none=self._everywhere(self.tried.none), fitted=fitted), formula)

    def _everywhere(self, fitted: FittedHypothesis) -> FittedHypothesis:
        """A hypothesis with its evidence at every level; its own evidence changes by what the new ones add."""
        there = beside(self.tried.likelihood, fitted.hypothesis)
        lin = there.columns(fitted.hypothesis) if fitted.hypothesis.effects else None
        by_level = np.stack([there.posterior(lin, g).evidence for g in range(len(fitted.by_level))])
        prior = log_prior_levels(there.data_set, PROCESS_PRIOR)
        added = logsumexp(by_level + prior) - logsumexp(fitted.by_level + prior)
        return replace(fitted, by_level=by_level, evidence=fitted.evidence + added)
