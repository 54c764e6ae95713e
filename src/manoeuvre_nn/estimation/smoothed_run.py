"""The motion behind a recording: smoothed with a force of any kind allowed, and the noise of every channel with it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter, uniform_filter1d

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.effect.common import TIGHT_TURN
from manoeuvre_nn.estimation.linear_run import Columns, joined
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, integrated, linearise
from manoeuvre_nn.estimation.measurement_noise import MIN_SAMPLES, measured_noise
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.recording.preparation import measured, without_samples

KINEMATIC_ERROR_SD = np.array([1.0, 1.0, 0.03, 0.08, 1e-3, 0.3, 4.0, 4.0])
"""Prior s.d. of kinematic errors: stream north and east [m/s], compass [rad], log [-], rate gyro [rad/s] and its scale
factor [-], antenna forward and to starboard [m]: little, for while any force is allowed it looks like a drift of the
ship; but the heading tells the scale of the gyro, which may be anything."""
KINEMATIC_ERROR_POWERS = (0.5, 0.5, 0.0, 0.0, -0.5, 0.0, 1.0, 1.0)
"""Exponents of length with which it goes."""
LINEARISATIONS, MAX_LINEARISATIONS = 4, 12
"""How often the equations are linearised and solved; and at most, where steps are cut short."""
MAX_STEP = 0.5
"""Longest step of u and v over the mean speed: hydrodynamic forces go with their second and third powers, so further
off the linear equations are those of another motion (and a ship that lies still has no solution)."""
MAX_LAGS = 30
"""Samples over which the correlation of a channel's errors is summed up."""
MAX_LEVERAGE = 0.9
"""Leverage of a sample at most: where a few samples alone tell a state, their residuals say nothing of their noise."""
WHOLE = 0.01
"""How far from a whole number of steps a rounded value may be, over the step."""
LOG, SHAFT = 6, 7
"""Channels of the speed log, and of the shaft speed: no state explains it, so its misfit is no outlier."""
MAX_SWAY = 2 * TIGHT_TURN["v"]
"""Largest sway velocity over the approach speed that the smoother begins with: more over ground is a stream, through
which no calm-water model sails sideways."""
MIN_SURGE = 1 - 2 * TIGHT_TURN["u"]
"""Least forward speed over the usual one over ground that the smoother begins with where no log shows it: a head stream
brings a ship to a stop over ground, not through the water, and drift angles near 90 deg are beyond any model."""
MOTION_POWERS = (0.5, 0.5, -0.5, 1.0, 1.0, 0.0)
"""Exponents of length with which u, v, r, x, y, psi go by Froude's law."""


def first_guess(run: Recording, own: Sequence[str] = ()) -> Float[np.ndarray, "n k"]:
    """Channels smoothed one by one: a start for the smoother.

    Args:
        run: The run.
        own: Own states of the model: those that were not recorded begin with 0.

    Returns:
        u, v, r, x, y, psi, own states.
    """
    recorded = measured(run, (*MEASURED, *own))
    filled = np.empty_like(recorded)
    for k in range(recorded.shape[1]):
        good = np.isfinite(recorded[:, k])
        values = np.interp(run.time, run.time[good], recorded[good, k]) if good.any() else np.zeros(len(run))
        filled[:, k] = uniform_filter1d(median_filter(values, 5, mode="nearest"), 5, mode="nearest")
    x, y, vn, ve, psi, r, log = filled[:, :7].T
    u, v = earth_to_body(vn, ve, psi)
    has_log = np.isfinite(recorded[:, 6]).any()
    return np.stack([log if has_log else u, v, r, x, y, psi, *filled[:, len(MEASURED) :].T], axis=-1)


def smooth(
    run: Recording,
    rate: Rate,
    noise: Float[np.ndarray, " c"],
    least: Float[np.ndarray, " c"],
    process_sd: Float[np.ndarray, " p"],
    ship: Particulars,
) -> tuple[LinearisedRun, Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, "n p"]]:
    """Find the states by an iterated smoother in which any force, a stream, and compass and log errors are possible.

    Args:
        run: The run.
        rate: Rates of the calm-water model.
        noise: First idea of the channels' noise.
        least: What the channels' noise is never taken to be less than.
        process_sd: Prior standard deviation of the process noise, wide: any force is possible.
        ship: The ship, for usual sizes and times.

    Returns:
        Equations about the smooth track, outliers being gaps in their run; standard deviation of every channel; factor
        on its variance for its correlation in time; process noise that the states need.
    """
    kept, channels = rate.states, rate.states.channels
    shaft = measured(run)[:, SHAFT]
    run = run.with_channels(**{MEASURED[SHAFT]: np.full(len(run), np.nan)})
    track, states, sigma = first_guess(run, kept.own), np.zeros((len(run), kept.size)), noise
    if not np.isfinite(measured(run, channels)[:, LOG]).any():
        over_ground = min(float(np.median(np.hypot(track[:, 0], track[:, 1]))), ship.speed)
        track[:, 0] = np.maximum(track[:, 0], MIN_SURGE * over_ground)
    track[:, 1] = np.clip(track[:, 1], -MAX_SWAY * ship.speed, MAX_SWAY * ship.speed)
    inflation = np.ones(len(channels))
    start_sd = np.r_[ship.sized([2.0, 2.0, 0.01, 20.0, 20.0, 0.2], MOTION_POWERS), kept.own_start_sd(ship)]
    error_sd = ship.sized(KINEMATIC_ERROR_SD, KINEMATIC_ERROR_POWERS)
    whole = 0
    for _ in range(MAX_LINEARISATIONS):
        share = step_share(track, states)
        moved = track + share * states[:, : kept.count]
        there = linearise(run, rate, moved)
        if states.any() and not there.sails:
            break  # the model's equations are not for such a state: the one before stays
        whole += share == 1.0
        track, linearised = moved, there
        solved = integrated(linearised, sigma * np.sqrt(inflation), process_sd, ship.time_unit, start_sd)
        columns = joined([linearised.data, _kinematic_errors(linearised)])
        embedded = solved.embed(columns)
        g = embedded.dot(embedded)
        left = np.append(1.0, -posterior(g, 0.0, error_sd, np.eye(len(g))[0]).mean())
        states = solved.states(embedded.combined(left))[..., 0]
        if share < 1.0:  # what is left is not noise alone
            continue
        residual = columns.measured @ left - np.einsum("kci,ki->kc", linearised.observed, states)
        variance = np.einsum("kci,kij,kcj->kc", linearised.observed, solved.covariances[0], linearised.observed)
        # The states follow a sample by its leverage, their variance over the sample's: its residual is so much smaller.
        leverage = np.clip(variance / (sigma * np.sqrt(inflation)) ** 2, 0.0, MAX_LEVERAGE)
        sigma, weights = measured_noise(residual**2 / (1 - leverage), linearised.present, sigma, least, "cut")
        e = residual * weights / sigma
        # Of instruments better than the least noise that is assumed, slow errors are as small as they are.
        inflation = np.where(sigma > least, _long_run(e), np.maximum(_long_run(e) * _mean_square(e), 1.0))
        run = without_samples(run, weights == 0, channels)
        if whole == LINEARISATIONS:
            break
    # With any force allowed the misfit should be one per sample; what it is more, the medians missed.
    misfit = float(g[0] @ left) / max(np.isfinite(measured(linearised.run, channels)).sum(), 1)
    sigma = sigma * np.sqrt(np.clip(misfit, 1.0, 1.5))
    run = run.with_channels(**{MEASURED[SHAFT]: shaft})
    return linearise(run, rate, track), sigma, inflation, states[:, kept.count :]


def rounding_step(values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, " c"]:
    """The step to which a channel was rounded; 0 where its values are not whole numbers of the least difference."""
    found = np.zeros(values.shape[1])
    for k, column in enumerate(values.T):
        there = column[np.isfinite(column)]
        steps = np.diff(np.unique(there))
        steps = steps[steps > 1e-9 * np.abs(there).max(initial=1.0)]
        if len(steps) > 1 and np.abs(steps / steps.min() - np.rint(steps / steps.min())).max() < WHOLE:
            found[k] = steps.min()
    return found


def step_share(track: Float[np.ndarray, "n k"], step: Float[np.ndarray, "n s"]) -> float:
    """The share of a Gauss-Newton step of the states that the linear equations can be trusted with.

    Args:
        track: States that the equations are linearised about.
        step: Their change by the linear equations.

    Returns:
        1, or less where u or v would change by more than :data:`MAX_STEP` of the mean speed.
    """
    longest = float(np.abs(step[:, :2]).max(initial=0.0))
    return min(1.0, MAX_STEP * float(np.hypot(track[:, 0], track[:, 1]).mean()) / longest) if longest else 1.0


def _kinematic_errors(linearised: LinearisedRun) -> Columns:
    """Columns of a uniform stream and of compass, log, rate gyro and antenna errors."""
    n, (r, psi) = len(linearised.run), (linearised.track[:, 2], linearised.track[:, 5])
    cos, sin = np.cos(psi), np.sin(psi)
    states = linearised.states
    c = Columns(np.zeros((n, len(states.channels), 8)), np.zeros((n - 1, states.count, 8)))
    c.measured[:, 5, 4], c.measured[:, 5, 5] = 1.0, r
    c.measured[:, 0, 6], c.measured[:, 1, 6] = cos, sin
    c.measured[:, 2, 6], c.measured[:, 3, 6] = -r * sin, r * cos
    c.measured[:, 0, 7], c.measured[:, 1, 7] = -sin, cos
    c.measured[:, 2, 7], c.measured[:, 3, 7] = -r * cos, -r * sin
    c.measured[:, 2, 0] = c.measured[:, 3, 1] = c.measured[:, 4, 2] = 1.0
    c.measured[:, 6, 3] = linearised.track[:, 0]
    c.moved[:, 3, 0] = c.moved[:, 4, 1] = linearised.run.step
    return c


def _mean_square(e: Float[np.ndarray, "n c"]) -> Float[np.ndarray, " c"]:
    """Mean square over the samples that there are, 1 at most."""
    return np.minimum((e**2).sum(axis=0) / np.maximum(np.count_nonzero(e, axis=0), 1), 1.0)


def _long_run(e: Float[np.ndarray, "n c"]) -> Float[np.ndarray, " c"]:
    """Variance of slow averages over that of white noise; at least 1, and 1 of channels with few samples."""
    factors = np.ones(e.shape[1])
    for k in np.flatnonzero(np.count_nonzero(e, axis=0) >= MIN_SAMPLES):
        c = e[:, k] - e[:, k].mean()
        power = float(c @ c) or 1.0
        for lag in range(1, min(MAX_LAGS, len(c) - 1)):
            correlation = float(c[:-lag] @ c[lag:]) / power
            if correlation < 0.05:  # sum up to the first negative value: Geyer 1992's initial positive sequence
                break
            factors[k] += 2 * correlation
    return np.clip(factors, 1.0, 20.0)
