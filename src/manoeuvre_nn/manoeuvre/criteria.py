"""The standard criteria, read off any recording: simulated or measured, from the execute on."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import nan, pi

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicHermiteSpline

from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE

LEAST_RUDDER = 1.0 * DEGREE
"""Rudder movement below which a recording holds no execute [rad]."""
INITIAL_TURN = 10 * DEGREE
"""Change of heading that the initial turning ability is judged by [rad]."""
STEADY = 0.02
"""Largest change of speed and of yaw rate over the last 90 deg of a steady turn [-]."""

Samples = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class _Trace:
    """A recorded trial as its reader sees it: from the execute on, turned so that the first rudder is positive.

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

    def peak_time(self, start: float, end: float, side: int) -> float:
        """When the heading went furthest to one side within a time, if the ship swung back from it.

        Args:
            start: First time [s].
            end: Last time [s].
            side: +1 for the side of the first rudder, -1 for the other.

        Returns:
            Time [s]; NaN if the heading was still growing.
        """
        times = self.turn.derivative().roots(extrapolate=False)
        times = times[(times > start) & (times < end)]
        inside = self.time[(self.time >= start) & (self.time <= end)]
        if not len(times) or not len(inside):
            return nan
        peak = float(times[(side * self.turn(times)).argmax()])
        return peak if side * self.turn(peak) >= (side * self.turn(inside)).max() - 1e-9 else nan

    def place_at(self, time: float) -> tuple[float, float]:
        """Distances ahead of the execute along the approach course, and to the side of the first rudder [m]."""
        assert self.ahead is not None and self.abeam is not None
        return float(self.ahead(time)), float(self.abeam(time))

    def distance(self, start: float, end: float) -> float:
        """Distance sailed [m] between two times [s], through the water or over ground, whichever the velocities are."""
        steps = 0.5 * (self.speed[1:] + self.speed[:-1]) * np.diff(self.time)
        sailed = np.concatenate([[0.0], np.cumsum(steps)])
        return float(np.interp(end, self.time, sailed) - np.interp(start, self.time, sailed))


def criteria(recording: Recording, kind: str, length: float) -> dict[str, float]:
    """Read the standard criteria off a recording.

    Everything is relative to the execute, the moment at which the rudder first leaves the angle of the approach, and
    positive for turns to either side. What a recording is too short for is not in the result.

    Args:
        recording: u, v, r, psi, delta, and x, y for what needs positions.
        kind: Family of the manoeuvre; one without criteria (``random_rudder``, or empty for unknown) has none.
        length: L [m].

    Returns:
        Name with unit -> value. ``turning_circle``: advance_L, transfer_L, tactical_diameter_L, steady_diameter_L,
        steady_u_m_s, steady_r_deg_s, steady_drift_deg, speed_loss. ``zigzag``: reversals, overshoot_1_deg, ...,
        period_s, initial_turning_L, initial_turning_time_s. ``pull_out``: residual_rate_deg_s, half_time_s.
        ``spiral``: neutral_rudder_deg, loop_width_deg, loop_height_deg_s. ``straight``: speed_change, drift_L,
        heading_change_deg.

    Source:
        IMO MSC.137(76) and MSC/Circ.1053; SNAME 1989, Guide for Sea Trials, for the spiral and the pull-out.
    """
    if kind == "straight":
        return _straight(recording, length)
    reader = READERS.get(kind)
    seen = trace(recording) if reader else None
    found = reader(seen, length) if reader and seen else {}
    return {name: float(value) for name, value in found.items() if not np.isnan(value)}


def _turning_circle(seen: _Trace, length: float) -> dict[str, float]:
    """Advance and transfer at 90 deg, tactical diameter at 180 deg, and the steady turn."""
    found: dict[str, float] = {}
    if seen.ahead is not None and seen.abeam is not None:
        (advance, transfer), (_, diameter) = (seen.place_at(seen.time_at(turn)) for turn in (0.5 * pi, pi))
        found = {"advance_L": advance, "transfer_L": transfer, "tactical_diameter_L": diameter}
        found = {name: distance / length for name, distance in found.items()}
    start = float(seen.turn(seen.time[-1])) - 0.5 * pi
    last = (seen.turn(seen.time) > start) & (seen.time > seen.execute)
    if start < pi or not _is_steady(seen, last):
        return found
    u, v, r = (float(_end(seen.time[last], c[last])) for c in (seen.u, seen.v, seen.rate))
    speed = float(np.hypot(u, v))
    return found | {
        "steady_diameter_L": 2 * speed / r / length,
        "steady_u_m_s": u,
        "steady_r_deg_s": r / DEGREE,
        "steady_drift_deg": float(np.arctan2(-v, u)) / DEGREE,
        "speed_loss": 1 - speed / seen.approach_speed,
    }


def _is_steady(seen: _Trace, last: Bool[np.ndarray, " n"]) -> bool:
    """Whether speed and yaw rate hardly change over the last part of a turn."""
    if last.sum() < 3:
        return False
    time = seen.time[last]
    slopes = [np.polyfit(time - time[0], c[last], 1)[0] / c[last].mean() for c in (seen.speed, seen.rate)]
    return bool(np.abs(slopes).max() * (time[-1] - time[0]) < STEADY)


def _end(time: Samples, values: Samples) -> float:
    """Mean over the last fifth of a stretch in time."""
    return float(values[time >= time[-1] - 0.2 * (time[-1] - time[0])].mean())


def _zigzag(seen: _Trace, length: float) -> dict[str, float]:
    """Overshoots beyond the heading at which the rudder was reversed, period and initial turning."""
    reversals, end = reversal_times(seen)
    found = {"reversals": float(len(reversals))}
    for k, (start, stop) in enumerate(pairwise([*reversals, end])):
        side = (-1) ** k
        peak = float(seen.turn(seen.peak_time(start, stop, side)))
        found[f"overshoot_{k + 1}_deg"] = side * (peak - float(seen.turn(start))) / DEGREE
    if len(reversals) > 2:  # from rudder to rudder of the same side; the first half-swing starts from a straight course
        found["period_s"] = reversals[2] - reversals[0]
    turned = seen.time_at(INITIAL_TURN)
    found["initial_turning_L"] = seen.distance(seen.execute, turned) / length
    found["initial_turning_time_s"] = turned - seen.execute
    return found


def reversal_times(seen: _Trace) -> tuple[list[float], float]:
    """When the helmsman of a zigzag reversed the rudder.

    Args:
        seen: The trial.

    Returns:
        Times at which the rudder began to go to the other side [s], and the time at which the last such rudder was
        given up or the recording ends [s].
    """
    level = seen.rudder / np.abs(seen.rudder).max()
    side = np.where(level > 0.3, 1, np.where(level < -0.3, -1, 0))
    index = np.maximum.accumulate(np.where(side != 0, np.arange(len(side)), 0))
    changes = (np.flatnonzero(np.diff(side[index]) * (side[index][:-1] != 0)) + 1).tolist()
    bounds = [int(np.argmax(side != 0)), *changes, len(side)]
    held = [held_angle(seen.rudder[a:b]) for a, b in pairwise(bounds)]
    times = [left_angle(seen.time, seen.rudder, k, *pair) for k, pair in zip(changes, pairwise(held), strict=True)]
    over = bounds[-2] + int(np.argmax(np.abs(level[bounds[-2] :]) > 0.6))
    given_up = np.flatnonzero(np.abs(level[over:]) < 0.3)
    return times, float(seen.time[over + given_up[0]] if len(given_up) else seen.time[-1])


def held_angle(rudder: Samples) -> float:
    """The angle that the rudder was held at between two movements."""
    return float(np.median(rudder[np.abs(rudder) >= 0.9 * np.abs(rudder).max()]))


def _pull_out(seen: _Trace, length: float) -> dict[str, float]:
    """The yaw rate that remains with the rudder amidships, and how fast the rest dies out."""
    level = seen.rudder / np.abs(seen.rudder).max()
    over = int(np.argmax(level > 0.9))
    given_up = np.flatnonzero(level[over:] < 0.5)
    if not len(given_up):
        return {}
    middle = over + int(given_up[0])
    held, amidships = held_angle(seen.rudder[:middle]), float(np.median(seen.rudder[middle:]))
    start = left_angle(seen.time, seen.rudder, middle, held, amidships)
    after = seen.time >= start
    time, rate = seen.time[after], seen.rate[after]
    if len(time) < 4:
        return {}
    residual = _end(time, rate)
    found = {"residual_rate_deg_s": residual / DEGREE}
    first = float(np.interp(start, seen.time, seen.rate))
    fallen = np.flatnonzero(rate - residual <= 0.5 * (first - residual))
    if first > residual and len(fallen) and fallen[0] > 0:
        pair = slice(fallen[0] - 1, fallen[0] + 1)
        found["half_time_s"] = float(np.interp(-0.5 * (first + residual), -rate[pair], time[pair])) - start
    return found


def _spiral(seen: _Trace, length: float) -> dict[str, float]:
    """Where the two branches of yaw rate over rudder cross zero, and how far they are apart."""
    loop = spiral_loop(seen)
    if loop is None:
        return {}
    (there, back), (above, below) = loop
    return {
        "neutral_rudder_deg": 0.5 * (there + back) / DEGREE,
        "loop_width_deg": abs(there - back) / DEGREE,
        "loop_height_deg_s": abs(above - below) / DEGREE,
    }


def spiral_loop(seen: _Trace) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Where the branches of a spiral, there and back, cross the axes.

    Args:
        seen: The trial.

    Returns:
        Rudder angles of no yaw [rad] and yaw rates with the rudder amidships [rad/s]; None if there are few holds.
    """
    holds = spiral_holds(seen)
    if len(holds) < 4:
        return None
    turning = int(np.argmin(seen.side * holds[:, 0]))
    branches = (holds[: turning + 1].T, holds[turning:].T)
    there, back = (_at_zero(rate, rudder) for rudder, rate in branches)
    above, below = (_at_zero(rudder, rate) for rudder, rate in branches)
    return (there, back), (above, below)


def spiral_holds(seen: _Trace) -> Float[np.ndarray, "holds 2"]:
    """Rudder angle of every hold of a spiral and the yaw rate at its end, positive to starboard [rad, rad/s]."""
    starts, level, count = [0], seen.rudder[0], 1
    for k, angle in enumerate(seen.rudder[1:], start=1):
        if abs(angle - level) > LEAST_RUDDER:
            starts, level, count = [*starts, k], angle, 0
        count += 1
        level += (angle - level) / count
    pieces = [(seen.time[a:b], seen.rudder[a:b], seen.rate[a:b]) for a, b in pairwise([*starts, len(seen.rudder)])]
    longest = max(time[-1] - time[0] for time, _, _ in pieces)
    # On its way from one hold to the next the rudder is nowhere for long.
    held = [(t, rudder, rate) for t, rudder, rate in pieces if t[-1] - t[0] > 0.3 * longest]
    steady = [[np.median(rudder[len(rudder) // 2 :]), _last_fitted(t, rate)] for t, rudder, rate in held]
    return seen.side * np.array(steady) + [seen.base, 0.0]


def _last_fitted(time: Samples, values: Samples) -> float:
    """Value at the end of a stretch by a line through its last tenth."""
    last = time >= time[-1] - 0.1 * (time[-1] - time[0])
    if last.sum() < 3:
        return float(values[-1])
    slope, offset = np.polyfit(time[last] - time[-1], values[last], 1)
    return float(offset)


def _at_zero(along: Samples, values: Samples) -> float:
    """Value where a sampled curve first crosses ``along = 0``, by a straight line; NaN if it does not."""
    crossed = np.flatnonzero((along[:-1] * along[1:] <= 0) & (along[:-1] != along[1:]))
    if not len(crossed):
        return nan
    k = int(crossed[0])
    share = along[k] / (along[k] - along[k + 1])
    return float(values[k] + share * (values[k + 1] - values[k]))


def _straight(recording: Recording, length: float) -> dict[str, float]:
    """Change of speed, drift to starboard of the first heading, and change of heading."""
    speed = np.hypot(recording["u"], recording["v"])
    first, last = _end(-recording.time[::-1], speed[::-1]), _end(recording.time, speed)
    found = {
        "speed_change": last / first - 1,
        "heading_change_deg": float(recording["psi"][-1] - recording["psi"][0]) / DEGREE,
    }
    if "x" in recording.channels and "y" in recording.channels:
        north, east = (recording[k] - recording[k][0] for k in ("x", "y"))
        _, starboard = earth_to_body(north, east, np.full(len(recording), recording["psi"][0]))
        found["drift_L"] = float(starboard[-1]) / length
    return found


READERS: dict[str, Callable[[_Trace, float], dict[str, float]]] = {
    "turning_circle": _turning_circle,
    "zigzag": _zigzag,
    "pull_out": _pull_out,
    "spiral": _spiral,
}
"""Family of manoeuvres -> what reads its criteria."""


def trace(recording: Recording) -> _Trace | None:
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
        began, along = track(execute), np.full(len(time), course)
        passed, speed = earth_to_body(c["x"] - began[0], c["y"] - began[1], along), earth_to_body(north, east, along)
        ahead = CubicHermiteSpline(time, passed[0], speed[0])
        abeam = CubicHermiteSpline(time, side * passed[1], side * speed[1])
    turn = CubicHermiteSpline(time, side * (c["psi"] - course), side * c["r"])
    rudder = side * (c["delta"] - base)
    return _Trace(time, execute, side, base, turn, side * c["r"], rudder, ahead, abeam, c["u"], side * c["v"])


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
