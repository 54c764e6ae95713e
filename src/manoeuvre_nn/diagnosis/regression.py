"""Bayesian linear regression in the metric of the samples: evidence and estimates at every level of noise."""

from dataclasses import dataclass
from math import log

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.bench import SCATTER_LEVELS, Bench
from manoeuvre_nn.diagnosis.calibrated import USUAL_SCATTER

FORCE_PRIOR = 0.03
"""Scale of the half-normal prior of the coloured force's levels when physics is named: little may stay unexplained."""
SCATTER_PRIOR = USUAL_SCATTER
"""Scale of the half-normal prior of the coefficients' relative error: published scatter is 3 to 6 %."""


def log_prior_levels(bench: Bench, force_prior: float | None) -> Float[np.ndarray, "g s"]:
    """Log prior of the grid of force and scatter levels.

    It is flat where the model was fitted: by how much such a model is wrong in other runs than its own is not known
    beforehand, least of all in other weather.

    Args:
        bench: The runs.
        force_prior: Scale of the half-normal prior of the force levels; None is flat over the levels.

    Returns:
        Normalised over the grid.
    """
    force, scatter = np.zeros(len(bench.levels)), np.zeros(len(SCATTER_LEVELS))
    if force_prior is not None and not bench.dynamics.fitted:
        force = -0.5 * np.square(bench.levels / force_prior).sum(axis=1)
    if not bench.dynamics.fitted:
        scatter = -0.5 * np.square(np.array(SCATTER_LEVELS) / SCATTER_PRIOR)
    total = force[:, None] + scatter[None, :]
    return total - log_sum(total)


def log_sum(x: np.ndarray) -> float:
    """Log of the sum of exponentials.

    Args:
        x: Logs.

    Returns:
        The log of their sum.
    """
    top = float(x.max())
    return top + log(float(np.exp(x - top).sum()))


@dataclass(frozen=True)
class Posterior:
    """Result of the linear algebra at one grid of levels."""

    by_level: Float[np.ndarray, "g s"]
    mean: Float[np.ndarray, "g s m"]
    covariance: Float[np.ndarray, "g s m m"]
    misfit: Float[np.ndarray, "g s"]


def regress(
    gram: Float[np.ndarray, "g p p"],
    norm: Float[np.ndarray, " g"],
    coefficients: int,
    data: Float[np.ndarray, " p"],
    prior: Float[np.ndarray, " m"],
) -> Posterior:
    """Bayesian linear regression in the metric of the samples, at every level of force and coefficient scatter.

    Args:
        gram: Inner products of all columns at each force level.
        norm: Log normaliser at each force level.
        coefficients: Number of coefficient columns; they stand first among the unknowns.
        data: The data as a combination of all columns.
        prior: Prior standard deviations of the unknowns, coefficients in units of the scatter.

    Returns:
        Evidence without the levels' prior, and mean and covariance of the unknowns.
    """
    m = len(prior)
    unknown = gram[:, -m:, -m:]
    right = gram[:, -m:, :] @ data
    power = np.einsum("p,gpq,q->g", data, gram, data)
    shape = (len(gram), len(SCATTER_LEVELS))
    evidence, misfit = np.empty(shape), np.empty(shape)
    mean, covariance = np.empty((*shape, m)), np.empty((*shape, m, m))
    for s, scatter in enumerate(SCATTER_LEVELS):
        sd = prior.copy()
        sd[:coefficients] *= scatter
        scaled = unknown * sd[:, None] * sd[None, :] + np.eye(m)
        inverse = np.linalg.inv(scaled)
        z = np.einsum("gij,gj->gi", inverse, right * sd)
        misfit[:, s] = power - np.einsum("gi,gi->g", z, right * sd)
        evidence[:, s] = norm - 0.5 * misfit[:, s] - 0.5 * np.linalg.slogdet(scaled)[1]
        mean[:, s] = z * sd
        covariance[:, s] = inverse * sd[:, None] * sd[None, :]
    return Posterior(evidence, mean, covariance, misfit)
