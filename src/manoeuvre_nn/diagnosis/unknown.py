"""The hypothesis that something acts which the shelf does not have.

It is calm water with everything loose that a name would tie down: a coloured force of any size, coefficients that are
off by more than the published scatter, and a short formula in the motion, the rudder, the heading and the instruments.
It wins where the misfit is real, repeats, and no name fits. Channels whose error is neither white nor a constant, a
scale or a lever arm are a fault of a sensor that the shelf does not have.
"""

from itertools import product

import numpy as np
from scipy.special import logsumexp

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

COLOURED = 4.0
"""Variance factor of a channel's slow errors from which its sensor is not trusted."""
SENSOR_PER_RUN = 12.0
"""Log evidence for a strange sensor of every run in which its error is coloured so."""


def unknown_evidence(likelihood: MarginalLikelihood, none: FittedHypothesis, formula: FittedHypothesis | None) -> float:
    """Log evidence of something unknown, summed over levels near those of calm water and over what is loose."""
    data_set = likelihood.data_set
    side = round(np.sqrt(len(data_set.levels)))
    row, column = divmod(none.best[0], side)
    near = [r * side + c for r, c in product(range(side), range(side)) if abs(r - row) <= 1 and abs(c - column) <= 1]
    near = sorted({*near, min(row + 2, side - 1) * side + column, row * side + min(column + 2, side - 1)})
    loose = np.stack([likelihood.posterior(None, g).evidence for g in near])
    found = [logsumexp(loose - np.log(len(data_set.levels) * loose.shape[1]))]
    if formula is not None:
        found.append(formula.evidence)
    return float(logsumexp(np.array(found) - np.log(2))) + _strange_sensors(data_set)


def _strange_sensors(data_set: WhitenedDataSet) -> float:
    """Evidence for channels whose error no candidate has: more than a stream or a sensor error of the smoother."""
    # A velocity that was taken from positions is no sensor's: the error of neighbouring samples is alike by making.
    sensed = [~np.isin(MEASURED[:-1], p.linearised.run.meta.get("derived", ())) for p in data_set.runs]
    factors = np.stack([p.inflation for p in data_set.runs])[:, : len(MEASURED) - 1] * np.array(sensed)
    coloured = (factors > COLOURED).sum(axis=0)
    return SENSOR_PER_RUN * float(coloured.max()) if 2 * coloured.max() >= len(factors) else 0.0
