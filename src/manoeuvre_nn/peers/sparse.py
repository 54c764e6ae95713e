"""Sparse regression of what calm water leaves over on a library of terms, by pySINDy, and how much each group explains.

The equations are fed with instruments that a mistake in position or course cannot reach: log, rate gyro and a sway speed
that the calm-water model makes of these and of the rudder. Then the misfits fall apart by place: surge and yaw miss a
force; ``drift``, the sway speed over ground less the model's, misses a lateral force or the water moves; log, gyro and
shaft are misfits that need no model of forces.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.columns import coefficient_columns
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.peers.residual import Smooth

ROWS = ("X", "N", "drift", "log", "gyro", "shaft")
"""Surge and yaw equations, sway speed, log, heading rate less gyro, shaft."""
GROUPS = {
    "bias": ("1", "u"),
    "even": ("rr", "dd"),
    "hull": ("r", "rrr"),
    "rudder": ("d", "ud", "ddd"),
    "gear": ("rate", "play"),
    "head1": ("cos", "sin"),
    "head2": ("cos2", "sin2"),
}
"""Terms of the library by what they stand for."""
TERMS = tuple(term for terms in GROUPS.values() for term in terms)
MIRROR = ("even", "hull", "rudder")
"""Groups that a ship with a plane of symmetry has."""
LIBRARY = {
    "X": ("bias", "even", "head1"),
    "N": ("bias", "hull", "rudder", "gear", "head1", "head2"),
    "drift": ("bias", "hull", "rudder", "gear", "head1", "head2"),
    "log": ("bias", "hull", "head1", "head2"),
    "gyro": ("bias", "hull", "head1", "head2"),
    "shaft": ("bias",),
}
"""Groups that make sense in a row: surge is even in sway, yaw and rudder, instruments know no rudder."""
MODELS, CHUNK = 30, 4
"""Resampled models of the ensemble, and averages that are resampled together."""
THRESHOLD, RIDGE = 3.0, 0.05
"""Of sequentially thresholded least squares, for columns of norm one and errors of variance one."""
SCATTER = 0.06
"""Relative error of every coefficient that calls for no explanation."""
KEPT = 0.5
"""Share of the ensemble's models in which a term must stand."""
AVERAGE = 1.4
"""Window of the averages over L/U0."""
STARTUP = 60.0
"""Time after which the model's sway speed has forgotten its start [s]."""


@dataclass(frozen=True)
class Corrections:
    """What was found wrong with instruments.

    Attributes:
        rate: Bias of the rate gyro [rad/s].
        log: Factor of the log.
    """

    rate: float = 0.0
    log: float = 1.0


@dataclass(frozen=True)
class Sparse:
    """What sparse regression found.

    Attributes:
        coefficients: Of each term in each row, rows in units of their noise.
        explained: Sum of squares, in units of the noise, by row and group, less what usual errors of coefficients do.
        left: Misfits that remain, averaged, in units of their noise.
        library: Terms, averaged.
        times: Middle of every average [s].
        parts: Averages of each run.
    """

    coefficients: Mapping[str, Mapping[str, float]]
    explained: Mapping[str, Mapping[str, float]]
    left: Float[np.ndarray, "b 6"]
    library: Float[np.ndarray, "b t"]
    times: Float[np.ndarray, " b"]
    parts: list[slice]

    def energy(self, row: str, *terms: str) -> float:
        """Sum of squares that terms explain in a row.

        Args:
            row: The row.
            terms: The terms.

        Returns:
            In units of the noise.
        """
        at = [TERMS.index(t) for t in terms]
        return float(((self.library[:, at] @ [self.coefficients[row][t] for t in terms]) ** 2).sum())


def sparse(dynamics: Dynamics, tracks: list[Smooth], corrections: Corrections) -> Sparse:
    """Regress all misfits on the library.

    Args:
        dynamics: Calm-water model.
        tracks: The runs.
        corrections: What is known to be wrong with instruments.

    Returns:
        What was found.

    Raises:
        InputError: If pySINDy is not installed.
    """
    made = [_rows(dynamics, t, corrections) for t in tracks]
    target, library, usual, times = (np.concatenate(part) for part in zip(*made, strict=True))
    ends = np.cumsum([0, *(len(y) for y, *_ in made)])
    parts = [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]
    noise = _noise(target, parts)
    scaled = target / noise
    coefficients = _ensemble(library, scaled, parts)
    allowed = ((SCATTER * usual / noise) ** 2).sum(axis=0)
    table = {row: dict(zip(TERMS, coefficients[k].tolist(), strict=True)) for k, row in enumerate(ROWS)}
    found = Sparse(table, {}, scaled - library @ coefficients.T, library, times, parts)
    explained = {row: _explained(found, row, float(allowed[k])) for k, row in enumerate(ROWS)}
    return replace(found, explained=explained)


def _explained(found: Sparse, row: str, usual: float) -> dict[str, float]:
    """Sum of squares by group; those that a symmetric ship has share what is more than usual of their sum."""
    energies = {group: found.energy(row, *terms) for group, terms in GROUPS.items()}
    together = found.energy(row, *(t for group in MIRROR for t in GROUPS[group]))
    apart = sum(energies[group] for group in MIRROR)
    share = max(together - usual, 0.0) / apart if apart else 0.0
    return {group: e * share if group in MIRROR else e for group, e in energies.items()}


def _rows(dynamics: Dynamics, track: Smooth, corrections: Corrections) -> tuple[np.ndarray, ...]:
    """Averaged misfits, library, usual size of what the model says, and times of one run, its first minute left out."""
    c, d, run = track.channels, track.slopes, track.run
    vn, ve, psi = c[:, 2], c[:, 3], c[:, 4]
    r, u = c[:, 5] - corrections.rate, c[:, 6] / corrections.log
    v = _sway(track, u, r)
    cos, sin = np.cos(psi), np.sin(psi)
    with torch.no_grad():
        nu = torch.tensor(np.stack([u, v, r], axis=-1))
        delta, shaft = track.situation.delta, track.situation.shaft
        calm = track.rate(nu, delta, shaft).numpy()
    udot = d[:, 6] / corrections.log
    misfit = [udot - calm[:, 0], d[:, 5] - calm[:, 2], ve * cos - vn * sin - v, vn * cos + ve * sin - u]
    misfit += [d[:, 4] - r, c[:, 7] - 1]
    unit = track.unit[[0, 2, 3, 3, 4, 5]]
    y = np.stack(misfit, axis=-1) / unit
    usual = np.sqrt((_of_coefficients(dynamics, track) ** 2).sum(axis=-1)) / unit
    speed, rate = track.unit[3], track.unit[4]
    library = _library(u / speed - 1, r / rate, run.delta, psi, run.step * rate)
    window = max(4, round(AVERAGE / (run.step * rate)))
    times = track.averaged(run.time[:, None], window)[:, 0]
    late = times >= STARTUP
    return *(track.averaged(a, window)[late] for a in (y, library, usual)), times[late]


def _of_coefficients(dynamics: Dynamics, track: Smooth) -> Float[np.ndarray, "n 6 c"]:
    """What every coefficient that is wrong by all of itself does to the misfits."""
    columns, names = coefficient_columns(dynamics, track.line, track.situation)
    push = track.pushed(columns)[..., ["+" not in name for name in names]]
    with torch.no_grad():
        nu = torch.tensor([[track.unit[3], 0.0, 0.0]] * 2) + torch.tensor([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
        slope = track.rate(nu, 0 * nu[:, 0], 1 + 0 * nu[:, 0])[:, 1]
    settling = 0.1 / abs(float(slope[0] - slope[1]))
    none = np.zeros_like(push[:, 0])
    return np.stack([push[:, 0], push[:, 2], settling * push[:, 1], none, none, none], axis=1)


def _library(u: np.ndarray, r: np.ndarray, d: np.ndarray, psi: np.ndarray, step: float) -> Float[np.ndarray, "n t"]:
    """All terms at all samples, in prime variables."""
    turning = np.gradient(d, step)
    moves = np.abs(turning) > 0.02 / step * 0.05
    last = np.maximum.accumulate(np.where(moves, np.arange(len(d)), 0))
    play = np.where(moves, np.sign(turning), 0.0)[last]
    z = {"u": u, "r": r, "d": d}
    made = {t: np.prod([z[letter] for letter in t], axis=0) for t in TERMS if set(t) <= set("urd")}
    made |= {"1": np.ones_like(u), "rate": turning, "play": play}
    made |= {"cos": np.cos(psi), "sin": np.sin(psi), "cos2": np.cos(2 * psi), "sin2": np.sin(2 * psi)}
    return np.stack([made[t] for t in TERMS], axis=-1)


def _sway(track: Smooth, u: Float[np.ndarray, " n"], r: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Sway speed by the calm-water model with forward speed and yaw rate as measured [m/s]."""
    delta, shaft, step = track.situation.delta, track.situation.shaft, track.run.step
    nu = torch.tensor(np.stack([u, np.zeros_like(u), r], axis=-1))
    with torch.no_grad():
        for k in range(len(u) - 1):
            here = track.rate(nu[k : k + 1], delta[k : k + 1], shaft[k : k + 1])[0, 1]
            ahead = nu[k + 1 : k + 2].clone()
            ahead[0, 1] = nu[k, 1] + step * here
            there = track.rate(ahead, delta[k + 1 : k + 2], shaft[k + 1 : k + 2])[0, 1]
            nu[k + 1, 1] = nu[k, 1] + 0.5 * step * (here + there)
    return nu[:, 1].numpy()


def _noise(target: Float[np.ndarray, "b 6"], parts: list[slice]) -> Float[np.ndarray, " 6"]:
    """Standard deviation of what is not straight over three averages that do not overlap."""
    bends = np.concatenate([target[p][4:] - 2 * target[p][2:-2] + target[p][:-4] for p in parts])
    return 1.4826 * np.median(np.abs(bends), axis=0) / np.sqrt(6.0) + 1e-6


def _ensemble(
    library: Float[np.ndarray, "b t"], target: Float[np.ndarray, "b 6"], parts: list[slice]
) -> Float[np.ndarray, "6 t"]:
    """Coefficients: medians over models of resampled stretches; terms that stand in few models are dropped."""
    try:
        import pysindy
    except ImportError:
        raise InputError("method=sindy needs pySINDy: write pip install manoeuvre-nn[peers]") from None
    rng = np.random.default_rng(0)
    starts = np.concatenate([np.arange(p.start, max(p.stop - CHUNK, p.start) + 1) for p in parts])
    draws = rng.choice(starts, (MODELS, max(len(target) // CHUNK, 1)))[:, :, None] + np.arange(CHUNK)
    result = np.zeros((len(ROWS), len(TERMS)))
    for k, row in enumerate(ROWS):
        terms = [t for group in LIBRARY[row] for t in GROUPS[group]]
        at = [TERMS.index(t) for t in terms]
        found = []
        for rows in np.minimum(draws.reshape(MODELS, -1), len(target) - 1):
            optimizer = pysindy.STLSQ(threshold=THRESHOLD, alpha=RIDGE, normalize_columns=True, unbias=False)
            model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                model.fit(library[rows][:, at], t=1.0, x_dot=target[rows][:, [k]], feature_names=terms)
            found.append(np.asarray(model.coefficients())[0])
        stands = np.mean([c != 0 for c in found], axis=0) > KEPT
        result[k, at] = np.where(stands, np.median(found, axis=0), 0.0)
    return result
