"""Gusts along a steady wind: a random wind speed whose variance is estimated from what the steady wind leaves."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.peers.fit import Fit
from manoeuvre_nn.peers.stand import Stand

TIME = 40.0
"""Correlation time of gusts [s]."""
ROUNDS = 200
"""Steps of expectation and maximisation."""


def with_gusts(stand: Stand, found: Fit, gusty: GustyWind) -> Fit:
    """A fit with a steady wind, its wind made gusty.

    In every average the forces are off by their derivative by the wind speed times a random speed; against that stand
    forces of any direction in constant proportions. Both variances are found by expectation and maximisation.

    Args:
        stand: The runs.
        found: With ``wind_steady`` among its effects.
        gusty: Prototype of the gusty wind.

    Returns:
        The fit with ``wind_gusty`` in its place and its criterion.

    Source:
        Dempster, Laird & Rubin 1977, a random coefficient.
    """
    guess = found.guess
    k = guess.names.index("wind_steady")
    column = next(m for m, (e, _, p) in enumerate(guess.free) if e == k and p.name == "speed")
    slope = stand.evaluate(guess)[1][:, :3, column]
    variance, gain = variance_along(found.left[:, :3], slope)
    sd = float(np.sqrt(variance / _kept(stand)))
    effects, values = list(guess.effects), list(guess.values)
    effects[k], values[k] = gusty, _values(gusty, guess.effects[k].declared, values[k], sd)
    count = np.log(len(found.left))
    return replace(found, guess=replace(guess, effects=tuple(effects), values=tuple(values)),
                   criterion=found.criterion - gain + count)  # fmt: skip


def variance_along(left: Float[np.ndarray, "b 3"], slope: Float[np.ndarray, "b 3"]) -> tuple[float, float]:
    """Variance of a random factor on given directions in noise of constant covariance.

    Args:
        left: Samples.
        slope: Direction of the factor in each.

    Returns:
        Variance of the factor, and what it gains in twice the log likelihood.
    """
    n = len(left)
    covariance = left.T @ left / n + 1e-10 * np.eye(3)
    alone = n * (np.linalg.slogdet(covariance)[1] + 3)
    variance = 0.3 * float(np.mean((left * slope).sum(1) ** 2 / ((slope**2).sum(1) ** 2 + 1e-12)))
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(covariance)
        spread = 1 / (1 / max(variance, 1e-12) + np.einsum("bi,ij,bj->b", slope, inverse, slope))
        mean = spread * np.einsum("bi,ij,bj->b", slope, inverse, left)
        rest = left - mean[:, None] * slope
        covariance = (rest.T @ rest + (spread[:, None] * slope).T @ slope) / n + 1e-10 * np.eye(3)
        variance = float(np.mean(mean**2 + spread))
    total = covariance + variance * slope[:, :, None] * slope[:, None, :]
    square = np.einsum("bi,bij,bj->b", left, np.linalg.inv(total), left)
    return variance, float(alone - (np.linalg.slogdet(total)[1] + square).sum())


def _kept(stand: Stand) -> float:
    """Share of the variance of gusts that an average over a window keeps."""
    track = stand.tracks[0]
    weight = np.hanning(track.window + 2)[1:-1]
    weight /= weight.sum()
    lag = np.abs(np.subtract.outer(np.arange(len(weight)), np.arange(len(weight)))) * track.run.step
    return float(weight @ np.exp(-lag / TIME) @ weight)


def _values(gusty: GustyWind, steady: tuple, values: Float[np.ndarray, "runs p"], sd: float) -> np.ndarray:
    """Values of a steady wind as those of a gusty one."""
    known = {p.name: values[:, c] for c, p in enumerate(steady)} | {"gust_sd": sd, "gust_time_s": TIME}
    return np.stack([np.broadcast_to(known[p.name], len(values)) for p in gusty.declared], axis=-1)
