"""All channels of a recording smoothed at once: the motion that most likely gave them, with its errors.

A filter that takes each channel for itself knows nothing of ``psidot = r`` nor of the track that u, v and psi make.
Here the states of all samples are solved for together (:mod:`.closed_loop`), tied by these kinematics
and by process noise of which only the size is estimated; so are the noise of every channel and, if asked for,
what sensors are late by and off by. Nothing is known of the ship.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicHermiteSpline

from manoeuvre_nn.core.channels import ACCELERATION, UNITS
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.measurement_noise import GAUSSIAN
from manoeuvre_nn.estimation.prime_recordings import PACE, averaged
from manoeuvre_nn.estimation.problem import (
    CHANNELS,
    DELAY,
    MOTION,
    Estimate,
    EstimationProblem,
    SensorFault,
    sensor_faults,
)  # fmt: skip

ACCELERATION_TIME = 1.0
"""Correlation time of the accelerations over L/U0."""
MAX_DELAY_ROUNDS, DELAY_AT_REST = 5, 0.2
"""How often channels are shifted by the delays that were found, at most, and what is left of a delay over its error."""
MAX_PASSES, STEP_AT_REST = 40, 1e-3
"""Passes at most, and where the solution rests (:func:`.solve`)."""
MIN_ACCELERATION_SD = 1e-4
"""Least standard deviation of the accelerations to start from, in U0^2/L."""
STATES = (*CHANNELS, *ACCELERATION)
"""What is estimated at every sample; each has its standard deviation in a channel of that name with ``_sd``."""

Units = Float[np.ndarray, " 9"]
"""What the estimation's numbers are multiplied by: u, v, r, x, y, psi, udot, vdot, rdot [SI]."""


def smoothed_jointly(recording: Recording, delays: Sequence[str] = (), offsets: Sequence[str] = ()) -> Recording:
    """Motion and accelerations with standard deviations, from all channels together.

    Samples closer than :data:`PACE` are averaged first: it costs less, and noise that is correlated from sample to
    sample is nearly white after it. Times may be uneven. x, y, psi may be missing, and channels of ``meta["derived"]``
    count as missing.

    Args:
        recording: u, v, r, as they were recorded, and what there is of x, y, psi; ``meta["time_unit"]`` is L/U0 [s].
        delays: Channels whose sensor may be late, by about .1 L/U0.
        offsets: Channels whose sensor may be off.

    Returns:
        The recording, at the same times, with smoothed channels in place of the recorded ones, with the accelerations
        udot, vdot [m/s^2], rdot [rad/s^2], and with ``u_sd`` to ``rdot_sd``, the standard deviations of all of them.
        ``meta`` has ``sensor_noise`` (channel -> standard deviation [SI and radians], of averages where samples were
        averaged), ``delays`` (channel -> delay and its standard error [s]) and ``offsets`` (the same in SI).

    Raises:
        InputError: If L/U0 is not known, or a sensor is named that was not recorded.
    """
    second = recording.meta.get("time_unit")
    if second is None:
        raise InputError(
            f"recording {recording.name} does not say its ship's L/U0 (meta time_unit), which accelerations=joint "
            "needs: write accelerations=smoother"
        )
    given = [k for k in CHANNELS if k in recording.channels and k not in recording.derived]
    for setting, names in (("delays", delays), ("offsets", offsets)):
        for name in (k for k in names if k not in given):
            raise InputError(f"data.{setting}: recording {recording.name} has no sensor of {name}: leave {name} out")
    u, t = float(np.sqrt(np.mean(recording["u"] ** 2 + recording["v"] ** 2))) or 1.0, second
    units = np.array([u, u, 1 / t, u * t, u * t, 1.0, u / t, u / t, 1 / t**2])
    late, faults = dict.fromkeys(delays, 0.0), sensor_faults(delays, offsets)
    whole = _complete(recording)
    for _ in range(MAX_DELAY_ROUNDS):
        coarse = averaged(_without(whole, late), PACE * second)
        found = _solved(_prime(coarse, units, second, given), faults)
        step, error = found.values[: len(late)], np.sqrt(np.diag(found.covariance))[: len(late)]
        if (np.abs(step) <= DELAY_AT_REST * error).all():
            break
        late = {k: tau + float(s) * second for (k, tau), s in zip(late.items(), step, strict=True)}
    told = {**recording.meta, **_sensors(found, units, second, given, faults, late)}
    return replace(recording.with_channels(**_read_off(recording, coarse.time, found, units)), meta=told)


def sensors_in_words(recordings: Sequence[Recording]) -> str:
    """What was found of sensors that may be late or off.

    Returns:
        A sentence, with a blank before it; empty where nothing was asked for.
    """
    words = ""
    for kind, wrong in (("delays", "late"), ("offsets", "off")):
        told = [
            f"{run.name} {k} {value:.2g} {'s' if kind == 'delays' else UNITS[k]} ({error:.1g})"
            for run in recordings
            for k, (value, error) in run.meta.get(kind, {}).items()
        ]
        words += f" Sensors are {wrong} by: {', '.join(told)}." if told else ""
    return words


def _without(recording: Recording, late: dict[str, float]) -> Recording:
    """With channels moved back by what they are late by [s]; NaN where nothing was written yet."""
    time = recording.time
    moved = {k: np.interp(time + tau, time, recording[k], np.nan, np.nan) for k, tau in late.items() if tau}
    return recording.with_channels(**moved)


def _solved(recording: Recording, faults: Sequence[SensorFault]) -> Estimate:
    """The estimate; it starts from as much acceleration as local cubics show."""
    problem = EstimationProblem(
        [recording], None, np.zeros(0), np.zeros(0), ACCELERATION_TIME, faults=faults, learn_process=True,
        smooth=True,
    )  # fmt: skip
    slopes = np.gradient(first(problem).states[0][:, :3], recording.time, axis=0)
    process_sd = np.maximum(slopes.std(0), MIN_ACCELERATION_SD)
    return solve(problem, first(problem, process_sd=tuple(process_sd)), passes=MAX_PASSES, enough=STEP_AT_REST)


def _sensors(
    found: Estimate,
    units: Units,
    second: float,
    given: Sequence[str],
    faults: Sequence[SensorFault],
    late: dict[str, float],
) -> dict[str, Any]:
    """What is found of the sensors, for ``meta``."""
    scale = dict(zip(CHANNELS, units[:MOTION], strict=True))
    noise = {k: float(GAUSSIAN * s * scale[k]) for k, s in zip(CHANNELS, found.noise, strict=True) if k in given}
    told: dict[str, Any] = {"sensor_noise": noise, "delays": {}, "offsets": {}}
    errors = np.sqrt(np.diag(found.covariance))
    for fault, value, error in zip(faults, found.values, errors, strict=True):
        k = fault.channel
        if fault.kind == DELAY:
            told["delays"][k] = (late[k] + float(value * second), float(error * second))
        else:
            told["offsets"][k] = (float(value * scale[k]), float(error * scale[k]))
    return told


def _complete(recording: Recording) -> Recording:
    """With the heading and the track that its velocities make, from 0 on, where it has none."""
    time, c = recording.time, recording.channels
    psi = c.get("psi", cumulative_trapezoid(c["r"], time, initial=0.0))
    rates = body_to_earth(c["u"], c["v"], psi)
    x, y = (c.get(k, cumulative_trapezoid(rate, time, initial=0.0)) for k, rate in zip("xy", rates, strict=True))
    return recording.with_channels(psi=psi, x=x, y=y)


def _prime(recording: Recording, units: Units, second: float, given: Sequence[str]) -> Recording:
    """Without units."""
    channels = dict(zip(CHANNELS, (recording.stacked(*CHANNELS) / units[:MOTION]).T, strict=True))
    meta = {"derived": [k for k in CHANNELS if k not in given]}
    return Recording(recording.name, (recording.time - recording.time[0]) / second, channels, meta=meta)


def _read_off(
    recording: Recording, nodes: Float[np.ndarray, " m"], found: Estimate, units: Units
) -> dict[str, Float[np.ndarray, " n"]]:
    """States and standard deviations at the recording's times: cubics through values and rates, lines for the rest."""
    (state,), (covariance,) = found.states, found.state_covariance
    state = state[:, : len(STATES)] * units
    spread = np.sqrt(covariance[:, range(len(STATES)), range(len(STATES))]) * units
    north, east = body_to_earth(state[:, 0], state[:, 1], state[:, 5])
    rates = np.column_stack([state[:, MOTION:], north, east, state[:, 2]])
    motion = CubicHermiteSpline(nodes, state[:, :MOTION], rates)(recording.time)
    told = dict(zip(CHANNELS, motion.T, strict=True))
    told |= {k: np.interp(recording.time, nodes, state[:, i]) for i, k in enumerate(ACCELERATION, MOTION)}
    told |= {f"{k}_sd": np.interp(recording.time, nodes, spread[:, i]) for i, k in enumerate(STATES)}
    known = {*recording.channels, *ACCELERATION}
    return {k: values for k, values in told.items() if k.removesuffix("_sd") in known}
