"""The hypothesis that something acts which the shelf does not have.

It is calm water with everything loose that a name would tie down: a coloured force of any size, coefficients that are
off by more than the published scatter, and a short formula in the motion, the rudder, the heading and the instruments.
It wins where the misfit is real, repeats, and no name fits. Channels whose error is neither white nor a constant, a
scale or a lever arm are a fault of a sensor that the shelf does not have.
"""

from itertools import product

import numpy as np

from manoeuvre_nn.diagnosis.bench import LATENCY_SPREAD, Bench
from manoeuvre_nn.diagnosis.court import Court
from manoeuvre_nn.diagnosis.formula import Found
from manoeuvre_nn.diagnosis.hypothesis import Judged
from manoeuvre_nn.diagnosis.regression import log_sum, regress
from manoeuvre_nn.diagnosis.runs import CHANNELS

COLOURED = 4.0
"""Variance factor of a channel's slow errors from which its sensor is not trusted."""
SENSOR_PER_RUN = 12.0
"""Log evidence for a strange sensor of every run in which its error is coloured so."""


def unknown_evidence(court: Court, none: Judged, formula: Found | None) -> float:
    """Log evidence of something unknown.

    Args:
        court: The runs.
        none: Calm water, for the levels to look at.
        formula: The best short formula.

    Returns:
        Log evidence, summed over levels and over what is loose.
    """
    bench = court.bench
    side = round(np.sqrt(len(bench.levels)))
    row, column = divmod(none.best[0], side)
    near = [r * side + c for r, c in product(range(side), range(side)) if abs(r - row) <= 1 and abs(c - column) <= 1]
    near = sorted({*near, min(row + 2, side - 1) * side + column, row * side + min(column + 2, side - 1)})
    gram, norm = (np.stack([getattr(bench.at(g), part) for g in near]) for part in ("base_gram", "norm"))
    prior = np.ones(len(bench.coefficients) + len(bench.places))
    prior[len(bench.coefficients) :] = LATENCY_SPREAD
    loose = regress(gram, norm, len(bench.coefficients), np.eye(bench.size)[0], prior).by_level
    found = [log_sum(loose - np.log(len(bench.levels) * loose.shape[1]))]
    if formula is not None:
        found.append(formula.evidence)
    return log_sum(np.array(found) - np.log(2)) + strange_sensors(bench)[1]


def strange_sensors(bench: Bench) -> tuple[list[str], float]:
    """Channels whose error no candidate has, and the evidence for them.

    The smoother allows a stream, a compass error, a log error, a rate-gyro error and an antenna off its place: what
    stays coloured is something else.

    Args:
        bench: The runs.

    Returns:
        Names of the channels, log evidence.
    """
    factors = np.stack([p.inflation for p in bench.places])[:, : len(CHANNELS) - 1]
    coloured = (factors > COLOURED).sum(axis=0)
    named = [CHANNELS[k] for k in np.flatnonzero(2 * coloured >= len(factors))]
    return named, SENSOR_PER_RUN * float(max(coloured.max(), 0)) if named else 0.0
