"""A recording: channels over time, simulated or measured; nothing downstream knows which."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.channels import UNITS
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import draft_of

CAMPAIGN = "campaign"
"""What a recording's ``meta`` calls the day, load or speed that it belongs to."""


@dataclass(frozen=True, repr=False)
class Recording:
    """Channels over time with units: the one form of manoeuvring data in the program.

    Attributes:
        name: What it is called in tables and figures.
        time: Sample times [s], increasing, shape (n,).
        channels: Channel name -> samples (n,) in SI and radians, see ``core.channels``; psi is continuous (never
            wrapped). NaN is a gap in a measured channel.
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

    def __repr__(self) -> str:
        """Name, size and channels with their units."""
        channels = ", ".join(f"{name} [{UNITS.get(name, '-')}]" for name in self.channels)
        ended = "" if self.status == "ok" else f", {self.status}"
        size = f"{len(self)} samples over {self.duration:.4g} s, step {self.step:.4g} s"
        return f"<Recording {self.name}: {size}; {channels}{ended}>"

    @cached_property
    def step(self) -> float:
        """Usual time between samples [s]; where samples are even, exactly that of the first two."""
        first, usual = float(self.time[1] - self.time[0]), float(np.median(np.diff(self.time)))
        return first if abs(first - usual) < 1e-6 * usual else usual

    @property
    def is_simulated(self) -> bool:
        """Whether it was simulated here and now, and not read."""
        return "manoeuvre" in self.meta

    @property
    def derived(self) -> frozenset[str]:
        """Channels that were computed from others, as ``meta`` says."""
        return frozenset(self.meta.get("derived", ()))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def filled(self, channel: str) -> Float[np.ndarray, " n"]:
        """A channel with its gaps filled by straight lines, and its first and last value held before and after."""
        values = self[channel]
        good = np.isfinite(values)
        return np.interp(self.time, self.time[good], values[good])

    def ordered_rudder(self, rate: float) -> Float[np.ndarray, " n"] | None:
        """Where a gear of this rate [rad/s] has the rudder by the recorded orders [rad]; None if none was recorded."""
        if "delta_order" not in self.channels or "delta_order" in self.derived:
            return None
        if rate not in self._followed:
            self._followed[rate] = followed(self.time, self.filled("delta_order"), rate)
        return self._followed[rate]

    @cached_property
    def _followed(self) -> dict[float, Float[np.ndarray, " n"]]:
        """Rudders behind the orders by the rate of their gear: asked for at every value of a delay."""
        return {}

    def stacked(self, *names: str) -> Float[np.ndarray, "n k"]:
        """Several channels side by side, one column each."""
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

    def rows(self, keep: slice) -> "Recording":
        """Some of the samples, at least two; times are kept as they are."""
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
        """The same recording with channels of shape (n,) added or replaced."""
        return replace(self, channels={**self.channels, **channels})

    def to_csv(self, path: Path) -> None:
        """Write time and all channels, SI and radians, unit in the heading."""
        named = {f"{k} [{UNITS.get(k, '-')}]": c for k, c in {"t": self.time, **self.channels}.items()}
        with draft_of(path) as draft:
            pd.DataFrame(named).to_csv(draft, index=False, float_format="%.9g")


def followed(
    time: Float[np.ndarray, " n"], order: Float[np.ndarray, " n"], rate: float, start: float | None = None
) -> Float[np.ndarray, " n"]:
    """The rudder of a steering gear that goes evenly towards its order.

    An order that differs from that of the sample before came at an unknown time between the two, on average midway:
    until then the old one stands. Unless it is said where the rudder begins it is taken to stand at the first
    order already: a record had better begin before the rudder is moved. Where no order was recorded, the angle is not
    known.

    Args:
        time: Sample times [s].
        order: Ordered angle [rad].
        rate: Rate of the steering gear [rad/s].
        start: Angle at the first sample [rad]; None is the first order.

    Returns:
        Rudder angle [rad]; NaN where there is no order.
    """
    known = np.isfinite(order)
    if not known.any():
        return np.full(len(order), np.nan)
    standing = order[np.maximum.accumulate(np.where(known, np.arange(len(order)), known.argmax()))]
    angle = float(standing[0] if start is None else start)
    result = [angle]
    halves = (0.5 * rate * np.diff(time)).tolist()
    for old, new, reach in zip(standing[:-1].tolist(), standing[1:].tolist(), halves, strict=True):
        for wanted in (old, new):
            angle += min(max(wanted - angle, -reach), reach)
        result.append(angle)
    return np.where(known, result, np.nan)
