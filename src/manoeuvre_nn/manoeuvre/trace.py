"""A recorded trial as its reader sees it: from the execute on, turned so that the first rudder is positive."""

from dataclasses import dataclass
from math import nan

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE

LEAST_RUDDER = 1.0 * DEGREE
"""Rudder movement below which a recording holds no execute [rad]."""

Samples = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Trace:
    """Heading, rudder and motion relative to those at the execute; positive towards the side of the first rudder.

    Attributes:
        time: Sample times [s].
        execute: Time at which the rudder first left the angle of the approach [s].
        side: +1 if it went to starboard, -1 to port.
        base: Rudder angle of the approach, positive to starboard [rad].
        turn: Change of heading as a cubic through heading and yaw rate [rad].
        rate: Yaw rate [rad/s].
        rudder: Rudder angle less that of the approach [rad].
        ahead: Distance along the approach course [m], None if the recording has no positions.
        abeam: Distance to the side of the first rudder [m], None likewise.
        u: Forward speed [m/s].
        v: Sway velocity to the side of the first rudder [m/s].
    """

    time: Samples
    execute: float
    side: int
    base: float
    turn: CubicHermiteSpline
    rate: Samples
    rudder: Samples
    ahead: CubicHermiteSpline | None
    abeam: CubicHermiteSpline | None
    u: Samples
    v: Samples

    @property
    def speed(self) -> Samples:
        """Speed through the samples [m/s]."""
        return np.hypot(self.u, self.v)

    @property
    def approach_speed(self) -> float:
        """Mean speed up to the execute [m/s]."""
        return float(self.speed[self.time <= max(self.execute, self.time[0])].mean())

    def time_at(self, turn: float) -> float:
        """Time when the heading first has changed by an angle [rad] after the execute; NaN if it never did."""
        times = self.turn.solve(turn, extrapolate=False)
        return float(min(times[times >= self.execute], default=nan))

    def peak(self, start: float, end: float, side: int) -> float:
        """Largest change of heading to one side within a time, if the ship swung back from it.

        Args:
            start: First time [s].
            end: Last time [s].
            side: +1 for the side of the first rudder, -1 for the other.

        Returns:
            That change of heading, positive to the side of the first rudder [rad]; NaN if the heading was still
            growing.
        """
        times = self.turn.derivative().roots(extrapolate=False)
        times = times[(times > start) & (times < end)]
        inside = self.time[(self.time >= start) & (self.time <= end)]
        if not len(times) or not len(inside):
            return nan
        peak = float((side * self.turn(times)).max())
        return side * peak if peak >= (side * self.turn(inside)).max() - 1e-9 else nan

    def distance(self, start: float, end: float) -> float:
        """Distance sailed [m] between two times [s], through the water or over ground, whichever the velocities are."""
        steps = 0.5 * (self.speed[1:] + self.speed[:-1]) * np.diff(self.time)
        sailed = np.concatenate([[0.0], np.cumsum(steps)])
        return float(np.interp(end, self.time, sailed) - np.interp(start, self.time, sailed))


def trace(recording: Recording) -> Trace | None:
    """Find the execute of a recording and turn everything to it.

    Samples with gaps are left out. The recording may begin before the execute; the rudder of the approach is taken off.

    Args:
        recording: A trial with u, v, r, psi and delta, and x and y if there are positions.

    Returns:
        The trace; None if the rudder never moves or there are too few samples.
    """
    names = [k for k in ("u", "v", "r", "psi", "delta", "x", "y") if k in recording.channels]
    whole = np.isfinite(recording.stacked(*names)).all(axis=-1)
    if whole.sum() < 4:
        return None
    time = recording.time[whole]
    c = {k: recording[k][whole] for k in names}
    found = _execute(time, c["delta"])
    if found is None:
        return None
    execute, base, side = found
    heading = CubicHermiteSpline(time, c["psi"], c["r"])
    course = float(heading(execute))
    ahead = abeam = None
    if "x" in c and "y" in c:
        north, east = body_to_earth(c["u"], c["v"], c["psi"])
        track = CubicHermiteSpline(time, np.stack([c["x"], c["y"]], 1), np.stack([north, east], 1))
        cos, sin = np.cos(course), np.sin(course)
        position = np.stack([c["x"], c["y"]], 1) - track(execute)
        ahead = CubicHermiteSpline(time, position @ [cos, sin], north * cos + east * sin)
        abeam = CubicHermiteSpline(time, side * position @ [-sin, cos], side * (east * cos - north * sin))
    turn = CubicHermiteSpline(time, side * (c["psi"] - course), side * c["r"])
    rudder = side * (c["delta"] - base)
    return Trace(time, execute, side, base, turn, side * c["r"], rudder, ahead, abeam, c["u"], side * c["v"])


def _execute(time: Samples, delta: Samples) -> tuple[float, float, int] | None:
    """Time of the first rudder movement, rudder of the approach [rad] and side of the movement."""
    base = float(delta[0])
    for _ in range(2):  # the second time with the middle value of the whole approach
        away = np.abs(delta - base)
        if away.max() < LEAST_RUDDER:
            return None
        middle = int(np.argmax(away > 0.5 * away.max()))
        side = 1 if delta[middle] > base else -1
        held = side * (delta[middle:] - base) > 0.5 * away.max()
        end = middle + (int(np.argmin(held)) if not held.all() else len(held))
        when = max(left_angle(time, delta, middle, base, float(np.median(delta[middle:end]))), float(time[0]))
        base = float(np.median(delta[time <= when + 1e-6]))
    return when, base, side


def left_angle(time: Samples, delta: Samples, middle: int, held: float, new: float) -> float:
    """When the rudder began to leave an angle: the line through its way to the next one, followed back.

    A rudder turns at an even rate, so that this finds the moment between two samples.

    Args:
        time: Sample times [s].
        delta: Rudder angle [rad].
        middle: A sample on the way or just after it.
        held: Angle that was held [rad].
        new: Angle that it went to [rad].

    Returns:
        Time [s].
    """
    share = (delta - held) / (new - held)
    behind, beyond = np.flatnonzero(share[: middle + 1] <= 0.1), np.flatnonzero(share[middle:] >= 0.9)
    leave = int(behind[-1]) if len(behind) else 0
    arrive = middle + int(beyond[0]) if len(beyond) else len(delta)
    if arrive - leave - 1 < 2:
        return float(time[leave])
    slope, offset = np.polyfit(time[leave + 1 : arrive] - time[leave], share[leave + 1 : arrive], 1)
    # A rudder that creeps gives no line worth following back.
    return float(min(time[leave] - offset / slope, time[leave + 1])) if slope > 0 else float(time[leave])
