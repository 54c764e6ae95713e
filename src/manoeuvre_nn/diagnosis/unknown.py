"""The hypothesis that something acts which the shelf does not have.

It is calm water with everything loose that a name would tie down: a coloured force of any size, coefficients that are
off by more than the published scatter, and smooth forces that calm water cannot have: other in port than in starboard
turns, or turning with the compass. It wins where the misfit is real, repeats, and no name fits. Channels whose error is
neither white nor a constant, a scale or a lever arm are a fault of a sensor that the shelf does not have.
"""

from itertools import product

import numpy as np
import torch

from manoeuvre_nn.diagnosis.bench import LATENCY_SPREAD, Bench, Place
from manoeuvre_nn.diagnosis.columns import moved_by
from manoeuvre_nn.diagnosis.court import Court
from manoeuvre_nn.diagnosis.hypothesis import Judged
from manoeuvre_nn.diagnosis.linear import Columns
from manoeuvre_nn.diagnosis.regression import log_sum, regress
from manoeuvre_nn.diagnosis.runs import CHANNELS

AMPLITUDES = (0.03, 0.1, 0.3)
"""Size of the smooth forces over the resistance and the force of 20 deg of rudder."""
COLOURED = 4.0
"""Variance factor of a channel's slow errors from which its sensor is not trusted."""
SENSOR_PER_RUN = 12.0
"""Log evidence for a strange sensor of every run in which its error is coloured so."""


def unknown_evidence(court: Court, none: Judged) -> float:
    """Log evidence of something unknown.

    Args:
        court: The runs.
        none: Calm water, for the levels to look at.

    Returns:
        Log evidence, summed over levels and amplitudes.
    """
    bench = court.bench
    columns = [_smooth(bench, place) for place in bench.places]
    count = columns[0].count
    index = [np.arange(count)] * len(columns)
    side = round(np.sqrt(len(bench.levels)))
    row, column = divmod(none.best[0], side)
    near = [r * side + c for r, c in product(range(side), range(side)) if abs(r - row) <= 1 and abs(c - column) <= 1]
    near = sorted({*near, min(row + 2, side - 1) * side + column, row * side + min(column + 2, side - 1)})
    gram = np.stack([bench.gram(g, columns, index, count) for g in near])
    norm = np.array([bench.at(g).norm for g in near])
    base = np.ones(len(bench.coefficients) + len(bench.places))
    base[len(bench.coefficients) :] = LATENCY_SPREAD
    data = np.eye(gram.shape[1])[0]
    found = []
    for size in AMPLITUDES:
        prior = np.concatenate([base, np.full(count, size)])
        found.append(regress(gram, norm, len(bench.coefficients), data, prior).by_level)
    n = bench.size
    found.append(regress(gram[:, :n, :n], norm, len(bench.coefficients), data[:n], base).by_level)
    total = np.stack(found)
    flat = np.log(len(bench.levels) * total.shape[0] * total.shape[2])
    return log_sum(total - flat) + strange_sensors(bench)[1]


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


def _smooth(bench: Bench, place: Place) -> Columns:
    """Forces that break the symmetry of port and starboard, and forces that turn with the compass."""
    p, s = bench.dynamics.particulars, place.situation
    r = s.r * p.length / p.speed / 0.7
    v, d, u = s.v / p.speed / 0.25, s.delta / 0.35, (s.u / p.speed - 1) / 0.3
    still = torch.ones_like(r)
    lateral = [still, r.abs(), v.abs(), d.abs(), u]
    surge = [r, v, d]
    turning = [f(k * s.psi) for k in (1, 2, 3) for f in (torch.cos, torch.sin)]
    turning += [r * r.abs() * f(k * s.psi) for k in (1, 2, 3) for f in (torch.cos, torch.sin)]
    made = []
    for equation, own in ((0, surge), (1, lateral), (2, lateral)):
        for shape in (*own, *turning):
            a = torch.zeros_like(s.nu)
            a[:, equation] = shape * bench.unit[equation]
            made.append(a)
    stacked = torch.stack(made)
    moved = moved_by(stacked, stacked.new_zeros(*stacked.shape[:2], 2), place.line).permute(1, 2, 0).numpy()
    return Columns(np.zeros((len(s.psi), len(CHANNELS), len(made))), moved)
