"""The motion behind a recording: smoothed with a force of any kind allowed, and the noise of every channel with it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter, uniform_filter1d

from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.diagnosis.linear import Columns, Linearised, Noise, Rate, Whitened, linearise
from manoeuvre_nn.diagnosis.runs import COUNT, MOTION_POWERS, Run

SLACK = np.array([1.0, 1.0, 0.03, 0.08, 1e-3, 4.0, 4.0])
"""Prior s.d. of the kinematic slack: stream north and east [m/s], compass [rad], log [-], rate gyro [rad/s], antenna
forward and to starboard [m]: little, for while any force is allowed it looks like a drift of the ship."""
SLACK_POWERS = (0.5, 0.5, 0.0, 0.0, -0.5, 1.0, 1.0)
"""Exponents of length with which it goes."""
SHAFT = 7
"""Channel of the shaft speed: no state explains it, so its misfit is no outlier."""
OUTLIER = 5.0
"""Samples further off than this many standard deviations are left out."""


@dataclass(frozen=True)
class Reference:
    """A smooth track and what surrounds it.

    Attributes:
        line: The equations about the track.
        noise: Standard deviation of every channel.
        inflation: Variance factor of each channel's noise for its correlation in time.
        force: Coloured accelerations that the track needs.
    """

    line: Linearised
    noise: Float[np.ndarray, " 8"]
    inflation: Float[np.ndarray, " 8"]
    force: Float[np.ndarray, "n 3"]


def first_guess(run: Run) -> Float[np.ndarray, "n 6"]:
    """Channels smoothed one by one: a start for the smoother.

    Args:
        run: The run.

    Returns:
        u, v, r, x, y, psi.
    """
    filled = np.empty_like(run.measured)
    for k in range(COUNT):
        good = np.isfinite(run.measured[:, k])
        values = np.interp(run.time, run.time[good], run.measured[good, k]) if good.any() else np.zeros(len(run))
        filled[:, k] = uniform_filter1d(median_filter(values, 5, mode="nearest"), 5, mode="nearest")
    x, y, vn, ve, psi, r, log = filled[:, :7].T
    v = -vn * np.sin(psi) + ve * np.cos(psi)
    u = vn * np.cos(psi) + ve * np.sin(psi)
    has_log = np.isfinite(run.measured[:, 6]).any()
    return np.stack([log if has_log else u, v, r, x, y, psi], axis=-1)


def smooth(run: Run, rate: Rate, noise: Float[np.ndarray, " 8"], force: Float[np.ndarray, " 3"], force_time: float,
           ship: Particulars, passes: int = 4, least: Float[np.ndarray, " 8"] | None = None) -> Reference:  # fmt: skip
    """Find the track by an iterated smoother in which any force, a stream, and compass and log errors are possible.

    Args:
        run: The run.
        rate: Accelerations of the calm-water model.
        noise: First idea of the channels' standard deviations.
        force: Prior s.d. of the coloured accelerations, wide.
        force_time: Their correlation time [s].
        ship: The ship, for usual sizes.
        passes: Number of linearisations.
        least: What the channels' standard deviations are never taken to be less than; None takes a fifth of ``noise``.

    Returns:
        Track, noise and force; outliers are marked in the run of its equations.
    """
    shaft = run.measured[:, SHAFT]
    run = replace(run, measured=np.where(np.arange(COUNT) == SHAFT, np.nan, run.measured))
    track, sigma, original = first_guess(run), noise.copy(), run
    inflation = np.ones(COUNT)
    spread = ship.sized([2.0, 2.0, 0.01, 20.0, 20.0, 0.2], MOTION_POWERS)
    least = 0.2 * noise if least is None else least
    slackness = ship.sized(SLACK, SLACK_POWERS)
    for last in [False] * (passes - 1) + [True]:
        line = linearise(run, rate, track, force_time)
        white = Whitened(line, Noise(sigma * np.sqrt(inflation), force, force_time), spread)
        slack = _slack(line)
        both = Columns(
            np.concatenate([line.data.measured, slack.measured], -1), np.concatenate([line.data.moved, slack.moved], -1)
        )
        embedded = white.embed(both)
        g = embedded.dot(embedded)
        values = np.linalg.solve(g[1:, 1:] + np.diag(slackness**-2), g[1:, 0])
        left = Columns(
            (line.data.measured[..., 0] - slack.measured @ values)[..., None],
            (line.data.moved[..., 0] - slack.moved @ values)[..., None],
        )
        states = white.states(left)[..., 0]
        residual = left.measured[..., 0] - np.einsum("kci,ki->kc", line.observed, states)
        run, sigma, inflation = _judged(original, run, line, residual, sigma, least)
        if not last:
            track = track + states[:, :6]
    # With any force allowed the misfit should be one per sample; what it is more, the medians missed.
    misfit = (g[0, 0] - g[0, 1:] @ values) / max(np.isfinite(line.run.measured).sum(), 1)
    sigma = sigma * np.sqrt(np.clip(misfit, 1.0, 1.5))
    run = replace(run, measured=np.where(np.arange(COUNT) == SHAFT, shaft[:, None], run.measured))
    return Reference(linearise(run, rate, track, force_time), sigma, inflation, states[:, 6:])


def _slack(line: Linearised) -> Columns:
    """Columns of a uniform stream and of compass, log, rate gyro and antenna errors."""
    n, (r, psi) = len(line.run), (line.track[:, 2], line.track[:, 5])
    cos, sin = np.cos(psi), np.sin(psi)
    c = Columns(np.zeros((n, COUNT, 7)), np.zeros((n - 1, 6, 7)))
    c.measured[:, 5, 4] = 1.0
    c.measured[:, 0, 5], c.measured[:, 1, 5] = cos, sin
    c.measured[:, 2, 5], c.measured[:, 3, 5] = -r * sin, r * cos
    c.measured[:, 0, 6], c.measured[:, 1, 6] = -sin, cos
    c.measured[:, 2, 6], c.measured[:, 3, 6] = -r * cos, -r * sin
    c.measured[:, 2, 0] = c.measured[:, 3, 1] = c.measured[:, 4, 2] = 1.0
    c.measured[:, 6, 3] = line.track[:, 0]
    c.moved[:, 3, 0] = c.moved[:, 4, 1] = line.run.step
    return c


def _judged(original: Run, run: Run, line: Linearised, residual: np.ndarray, sigma: np.ndarray, floor: np.ndarray):  # type: ignore[no-untyped-def]
    """Outliers marked, and each channel's noise and its correlation measured on the rest."""
    raw = np.where(np.isfinite(original.measured), residual, np.nan)
    new, inflation = sigma.copy(), np.ones(COUNT)
    # The residual of samples that were left out before is not in `residual`: recompute from the track.
    bad = np.zeros_like(raw, dtype=bool)
    for k in range(COUNT):
        values = raw[:, k]
        good = np.isfinite(values) & np.isfinite(run.measured[:, k])
        if good.sum() < 10 or k == SHAFT:
            continue
        new[k] = max(1.4826 * np.median(np.abs(values[good])), floor[k])
        bad[:, k] = np.isfinite(values) & (np.abs(values) > OUTLIER * new[k])
        inflation[k] = _long_run(np.where(good & ~bad[:, k], values, 0.0) / new[k])
    return run.without(bad), new, inflation


def _long_run(e: Float[np.ndarray, " n"], lags: int = 30) -> float:
    """Variance of slow averages over that of white noise; at least 1."""
    e = e - e.mean()
    power = float(e @ e) or 1.0
    rho = [float(e[:-k] @ e[k:]) / power for k in range(1, min(lags, len(e) - 1))]
    total = 1.0
    for value in rho:  # Sum up to the first negative value: Geyer 1992's initial positive sequence
        if value < 0.05:
            break
        total += 2 * value
    return float(np.clip(total, 1.0, 20.0))
