"""A recording: channels over time, simulated or measured; nothing downstream knows which."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError

MOTION = ("u", "v", "r", "x", "y", "psi", "delta")
"""Channels that a manoeuvre is judged by: m/s, m/s, rad/s, m, m, rad, rad."""
ACCELERATION = ("udot", "vdot", "rdot")
"""Channels of known accelerations [m/s^2, m/s^2, rad/s^2]; only simulations have them."""
UNITS = {
    "t": "s", "u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad",
    "delta_order": "rad", "udot": "m/s^2", "vdot": "m/s^2", "rdot": "rad/s^2", "n": "1/s",
    "vn": "m/s", "ve": "m/s", "u_log": "m/s", "shaft": "-", "phi": "rad", "theta": "rad", "p": "rad/s",
    "thrust": "N", "torque": "N m", "wind_speed": "m/s", "wind_from": "rad", "wind_speed_relative": "m/s",
    "wind_from_relative": "rad",
}  # fmt: skip
UNITS |= {f"{k}_sd": UNITS[k] for k in ("u", "v", "r", "x", "y", "psi", "udot", "vdot", "rdot")}
"""Unit of every channel that the program knows; others are kept as they come. Wind directions say where it comes from,
true ones clockwise from north, relative ones from the bow; they are continuous as psi is. ``_sd``: standard deviations
that a smoother states."""


@dataclass(frozen=True)
class Recording:
    """Channels over time with units: the one form of manoeuvring data in the program.

    Attributes:
        name: What it is called in tables and figures.
        time: Sample times [s], increasing, shape (n,).
        channels: Channel name -> samples (n,) in SI and radians. psi is continuous (never wrapped).
        status: ``ok``, or why a simulation was ended early.
        meta: Whatever else is known (ship, manoeuvre, source file, ...).

    Raises:
        InputError: If lengths differ, times do not increase or a channel is missing that is asked for.
    """

    name: str
    time: Float[np.ndarray, " n"]
    channels: Mapping[str, Float[np.ndarray, " n"]]
    status: str = "ok"
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check lengths and times once, so that inner code may trust them."""
        for name, values in self.channels.items():
            if values.shape != self.time.shape:
                raise InputError(
                    f"recording {self.name}: channel {name} has shape {values.shape}, time has {self.time.shape}"
                )
        if len(self.time) < 2 or not np.all(np.diff(self.time) > 0):
            raise InputError(f"recording {self.name}: time must have at least 2 samples and increase throughout")

    def __getitem__(self, channel: str) -> Float[np.ndarray, " n"]:
        """Samples of one channel.

        Args:
            channel: Its name.

        Returns:
            Samples in SI and radians, shape (n,).

        Raises:
            InputError: If the recording lacks the channel.
        """
        if channel not in self.channels:
            raise InputError(f"recording {self.name} has no channel {channel}; it has: {', '.join(self.channels)}")
        return self.channels[channel]

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def stacked(self, *names: str) -> Float[np.ndarray, "n k"]:
        """Several channels side by side.

        Args:
            names: Channel names.

        Returns:
            Samples, one column a channel.
        """
        return np.stack([self[name] for name in names], axis=-1)

    def between(self, start: float, end: float) -> "Recording":
        """Cut out a time window; times are kept as they are.

        Args:
            start: First time [s].
            end: Last time [s].

        Returns:
            The window.

        Raises:
            InputError: If fewer than two samples lie in it.
        """
        keep = (self.time >= start - 1e-9) & (self.time <= end + 1e-9)
        if keep.sum() < 2:
            raise InputError(
                f"recording {self.name}: window {start:g}..{end:g} s holds {keep.sum()} samples; "
                f"it runs from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        return replace(self, time=self.time[keep], channels={k: c[keep] for k, c in self.channels.items()})

    def resampled(self, times: Float[np.ndarray, " m"]) -> "Recording":
        """Read the recording off at other times by linear interpolation.

        Args:
            times: New sample times [s] within the recording.

        Returns:
            The recording at those times.

        Raises:
            InputError: If a time lies outside the recording.
        """
        if times[0] < self.time[0] - 1e-9 or times[-1] > self.time[-1] + 1e-9:
            raise InputError(f"recording {self.name} ends at {self.time[-1]:g} s, asked for {times[-1]:g} s")
        return replace(self, time=times, channels={k: np.interp(times, self.time, c) for k, c in self.channels.items()})

    def with_channels(self, **channels: Float[np.ndarray, " n"]) -> "Recording":
        """The same recording with channels added or replaced.

        Args:
            channels: Name = samples (n,).

        Returns:
            A new recording.
        """
        return replace(self, channels={**self.channels, **channels})

    def to_csv(self, path: Path) -> None:
        """Write time and all channels, SI and radians, unit in the heading.

        Args:
            path: File to write.
        """
        named = {f"{k} [{UNITS.get(k, '-')}]": c for k, c in {"t": self.time, **self.channels}.items()}
        pd.DataFrame(named).to_csv(path, index=False, float_format="%.9g")
