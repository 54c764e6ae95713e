"""When a misfit is worth an alarm: how much evidence chance alone produces on clean recordings of this kind."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.search import MIN_GAIN_OF_SECOND, SearchResult
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

DRAWS = 2000
"""Clean sets of recordings that are drawn."""
FALSE_ALARMS = 0.01
"""Share of clean sets that may raise an alarm."""
MIN_GAIN_OF_NAMED = 8.0
"""Least log Bayes factor over calm water of a named effect, in fitted and held-out runs together: with some 25
candidates fewer than 1 % of clean cases reach it, whatever the errors of the model (Markov's inequality)."""
MIN_GAIN_TO_TRY = 5.0
"""Least log Bayes factor in the fitted runs from which on it is put to the held-out ones."""
MIN_GAIN_OF_UNKNOWN = 7.0
"""The same for something unknown, which has no formula to be tied to."""


def threshold(result: SearchResult) -> float:
    """Log Bayes factor that the best of all candidates exceeds by chance with probability ``FALSE_ALARMS``.

    Clean recordings of the same ship, manoeuvres, channels and noise are drawn where every candidate is linear: there
    the score of a candidate is Gaussian with its information matrix, coefficients, latency and process noise
    integrated out. Candidates are drawn independently of each other, which errs to the safe side.

    Returns:
        The threshold.
    """
    rng = np.random.default_rng(0)
    best = np.full(DRAWS, -np.inf)
    for fitted in result.fitted:
        if len(fitted.names) == 1:
            information, prior = _information(result, fitted.hypothesis)
            best = np.maximum(best, _drawn(rng, information, prior))
    return float(np.quantile(best, 1 - FALSE_ALARMS))


def _information(
    result: SearchResult, hypothesis: Hypothesis
) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, " m"]]:
    """Information on a candidate's numbers under calm water, nuisance integrated out, and their prior spreads."""
    level, scatter = result.none.best
    data_set = result.likelihood.data_set
    lin, n = result.likelihood.columns(hypothesis), data_set.size
    g = data_set.gram(level, data_set.embedded(level, lin.columns), lin.index, lin.count)
    nuisance = g[1:n, 1:n] + np.diag(data_set.nuisance_sd(scatter, len(data_set.runs)) ** -2.0)
    cross = g[1:n, n + 1 :]
    information = g[n + 1 :, n + 1 :] - cross.T @ np.linalg.solve(nuisance, cross)
    at_null = [f.prior_sd(f.mean(v)) for f, v in zip(hypothesis.unknowns(), hypothesis.vector(), strict=True)]
    return information, np.array(at_null)


def _drawn(
    rng: np.random.Generator, information: Float[np.ndarray, "m m"], spread: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " draws"]:
    """Log Bayes factors of a candidate over calm water when calm water is right."""
    a = information * spread[:, None] * spread[None, :]
    values = np.clip(np.linalg.eigvalsh(0.5 * (a + a.T)), 0.0, None)  # the statistic depends on nothing else
    z = rng.standard_normal((DRAWS, len(values)))
    return 0.5 * (z**2 * values / (1 + values)).sum(axis=1) - 0.5 * np.log1p(values).sum()


def least_gain(claim: FittedHypothesis) -> float:
    """Least log Bayes factor over calm water that a claim must have in fitted and held-out runs together."""
    return MIN_GAIN_OF_NAMED + MIN_GAIN_OF_SECOND * (len(claim.names) - 1)


def raised(result: SearchResult, best: FittedHypothesis | None) -> bool:
    """Whether the best named hypothesis, if there is one, beats calm water by so much that it is worth a proof."""
    if best is None:
        return False
    least = max(threshold(result), MIN_GAIN_TO_TRY) + MIN_GAIN_OF_SECOND * (len(best.names) - 1)
    return best.evidence - result.none.evidence > least
