"""What a sensor would have written down: noise, and another sampling rate."""

from collections.abc import Mapping
from dataclasses import replace
from zlib import crc32

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.recording import Recording


def add_noise(recording: Recording, sd: Mapping[str, float], seed: int = 0) -> Recording:
    """Add white Gaussian noise to some channels.

    Every channel has a random stream of its own, drawn from the seed and the channel's name: whether v carries noise
    does not change the noise of u. Velocities over ground north and east carry the noise of u and v, turned by the
    heading; a speed log has noise as large as that of u, drawn for itself.

    Args:
        recording: What happened.
        sd: Channel -> standard deviation [SI and radians].
        seed: Seed.

    Returns:
        What was written down.

    Raises:
        InputError: If a standard deviation is negative, or a channel is not recorded.
    """
    noisy = {}
    for name, value in sd.items():
        if not value >= 0:
            raise InputError(f"noise of {name} is {value}; expected a standard deviation in SI units, 0 or more")
        if name not in recording.channels:
            has = ", ".join(recording.channels)
            raise InputError(f"noise of {name}: recording {recording.name} has no such channel; it has: {has}")
        stream = np.random.default_rng([seed, crc32(name.encode())])
        noisy[name] = recording[name] + value * stream.standard_normal(len(recording))
    return replace(
        recording.with_channels(**noisy, **_other_velocities(recording, noisy, sd, seed)),
        meta={**recording.meta, "noise": dict(sd)},
    )


def _other_velocities(
    recording: Recording, noisy: Mapping[str, Float[np.ndarray, " n"]], sd: Mapping[str, float], seed: int
) -> dict[str, Float[np.ndarray, " n"]]:
    """Velocities over ground and through the water beside noisy u and v, where they are recorded and have no noise."""
    found: dict[str, Float[np.ndarray, " n"]] = {}
    ahead, aside = (noisy[k] - recording[k] if k in noisy else np.zeros(len(recording)) for k in ("u", "v"))
    if {"vn", "ve", "psi"} <= set(recording.channels) and not {"vn", "ve"} & set(sd) and (ahead.any() or aside.any()):
        north, east = body_to_earth(ahead, aside, recording["psi"])
        found |= {"vn": recording["vn"] + north, "ve": recording["ve"] + east}
    if "u_log" in recording.channels and "u_log" not in sd and sd.get("u"):
        stream = np.random.default_rng([seed, crc32(b"u_log")])
        found["u_log"] = recording["u_log"] + sd["u"] * stream.standard_normal(len(recording))
    return found


def resample(recording: Recording, rate_hz: float) -> Recording:
    """Read a recording off at another, even rate by linear interpolation.

    Nothing is averaged: smooth a noisy recording before its rate is reduced.

    Args:
        recording: The recording.
        rate_hz: Samples per second [1/s].

    Returns:
        The recording at even times from its first sample on.

    Raises:
        InputError: If the rate is not positive or higher than that of the recording, or leaves fewer than 2 samples.
    """
    own = 1 / recording.step
    if not 0 < rate_hz <= 1.01 * own:
        raise InputError(
            f"rate_hz={rate_hz:g}; recording {recording.name} has {own:.4g} samples a second: write that or less"
        )
    count = int(recording.duration * rate_hz + 1e-6) + 1
    if count < 2:
        raise InputError(
            f"rate_hz={rate_hz:g} leaves {count} sample of recording {recording.name}: write a higher rate"
        )
    times = recording.time[0] + np.arange(count) / rate_hz
    return recording.resampled(np.minimum(times, recording.time[-1]))  # the last may be a rounding beyond the end
