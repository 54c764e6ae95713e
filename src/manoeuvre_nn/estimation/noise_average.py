"""Values and standard errors averaged over what is not known of the model's errors.

These are level and correlation time of the process noise, and how the errors of coefficients go together.

Source:
    Hoeting, Madigan, Raftery & Volinsky 1999, Bayesian Model Averaging: A Tutorial, Statistical Science 14(4).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import softmax

from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.posterior import mixture
from manoeuvre_nn.estimation.prior_average import over_coefficient_priors

TIMES = (0.5, 1.0, 2.0)
"""Correlation times of the process noise over the time in which the ship sails its length."""


def averaged(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> FittedHypothesis:
    """A fitted hypothesis with values and covariance averaged over process noise and priors of coefficients.

    The usual correlation time and the likeliest prior of coefficients are one of many: that suffices to compare
    hypotheses, but standard errors at the nearest of them may be too small.

    Args:
        data_set: The runs about the states of the hypothesis.
        fitted: What was found there.

    Returns:
        The same evidence; other values, covariance, corrections and latencies. Gusts, of which the course is random,
        are averaged over elsewhere.
    """
    found = [_at_time(data_set, fitted, factor * data_set.process_time) for factor in TIMES]
    return weighted_mean(fitted, found)[0]


def weighted_mean(
    fitted: FittedHypothesis, parts: Sequence[FittedHypothesis]
) -> tuple[FittedHypothesis, Float[np.ndarray, " n"]]:
    """A fitted hypothesis with the values of several fits of it, weighed by their evidence.

    Args:
        fitted: It.
        parts: The same, fitted with other noise.

    Returns:
        It with mean values, corrections and latencies and the covariance of the mixture; the weights.
    """
    weights, h = softmax([one.evidence for one in parts]), fitted.hypothesis
    steps = np.array([_step(h, one.hypothesis) for one in parts])
    mean, covariance = mixture(weights, steps, [one.covariance for one in parts])
    mixed = replace(
        fitted,
        hypothesis=h.within_bounds(h.vector() + mean),
        covariance=covariance,
        corrections=weights @ np.array([one.corrections for one in parts]),
        latencies=weights @ np.array([one.latencies for one in parts]),
    )
    return mixed, weights


def with_time(data_set: WhitenedDataSet, time: float) -> WhitenedDataSet:
    """The same runs about the same states with another correlation time [s] of the process noise."""
    return WhitenedDataSet(data_set.dynamics, data_set.whole, data_set.coefficient_prior, data_set.levels, time)


def _at_time(data_set: WhitenedDataSet, fitted: FittedHypothesis, time: float) -> FittedHypothesis:
    """The hypothesis at one correlation time [s] of the process noise, over its levels and priors of coefficients."""
    there = with_time(data_set, time)
    found = MarginalLikelihood(there).evaluate(fitted.hypothesis, around=fitted.best[0])
    found = over_coefficient_priors(there, found, fitted.hypothesis)
    there.release()
    return found


def _step(before: Hypothesis, after: Hypothesis) -> Float[np.ndarray, " m"]:
    """From the values of one to those of the other, directions the shorter way round."""
    steps = after.vector() - before.vector()
    periods = [f.parameter.period for f in before.unknowns()]
    return np.array([x - (p * round(x / p) if p else 0.0) for x, p in zip(steps.tolist(), periods, strict=True)])
