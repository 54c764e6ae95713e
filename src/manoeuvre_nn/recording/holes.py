"""Holes of a recording: times of seconds or minutes in which nothing, or not the rudder, was written down.

What nobody measured needs no samples: the equations of motion bridge a hole, and what they leave uncertain grows by
itself. Two things must be known for that: by how many whole turns the heading went on, and the rudder. Where the rudder
is not known the equations are cut: the ship may come out of the hole in any state.
"""

import numpy as np
from jaxtyping import Bool, Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording, followed
from manoeuvre_nn.core.units import DEGREE

MIN_HOLE_S = 5.0
"""Shorter gaps are bridged by straight lines [s]: a steering gear moves by no more than a zigzag's order meanwhile."""
MIN_HOLE_STEPS = 5
"""The same over the time between samples."""
RUDDER_PLAY = 1.0 * DEGREE
"""Rudder angles before and after a hole that differ by less are the same [rad]."""
MAX_HEADING_OFF = 0.25, 5 * DEGREE
"""How far the heading may be from where the yaw rates at both ends of a hole would have brought it if the rudder was
held: a share of the turn, and at least so much [rad]."""
ENDS = 5
"""Samples at either end of a hole that say what was there."""
MOTION_SENSORS = tuple(name for name in MEASURED if name != "shaft_recorded")
"""Channels that say how the ship moves."""

Span = tuple[float, float]
Series = Float[np.ndarray, " n"]


def holes(time: Series, there: Bool[np.ndarray, " n"], step: float) -> list[Span]:
    """Times without samples between two samples.

    Args:
        time: Sample times [s].
        there: Whether something was written down at each.
        step: Usual time between samples [s].

    Returns:
        Time of the last sample before each hole and of the first after it [s].
    """
    known = time[there]
    long = np.flatnonzero(np.diff(known) > _least(step))
    return [(float(known[k]), float(known[k + 1])) for k in long]


def _least(step: float) -> float:
    """Shortest hole [s]."""
    return max(MIN_HOLE_S, MIN_HOLE_STEPS * step) + 1e-9


def heading_across(run: Recording) -> Recording:
    """The heading after each hole on by the whole turns that the yaw rates before and after it tell.

    A direction is made continuous by the shorter way round; a ship that turns through a hole goes the longer one.

    Args:
        run: The run, gaps as NaN.

    Returns:
        The run with another psi where there is such a hole.
    """
    psi = run["psi"].copy()
    for begin, end in holes(run.time, np.isfinite(psi), run.step):
        after = run.time >= end - 1e-9
        gone = psi[after][0] - psi[~after & np.isfinite(psi)][-1]
        expected = 0.5 * (end - begin) * (_yaw_rate(run, begin, -1) + _yaw_rate(run, end, 1))
        psi[after] += 2 * np.pi * np.round((expected - gone) / (2 * np.pi))
    return run.with_channels(psi=psi)


def _yaw_rate(run: Recording, time: float, side: int) -> float:
    """Yaw rate before (side -1) or after (1) a time [rad/s], by the gyro or by the heading."""
    near = side * (run.time - time) >= -1e-9
    if "r" in run.channels:
        found = run["r"][near & np.isfinite(run["r"])]
        if len(found):
            return float(np.median(found[:ENDS] if side > 0 else found[-ENDS:]))
    here = near & np.isfinite(run["psi"])
    at, psi = (values[here][:ENDS] if side > 0 else values[here][-ENDS:] for values in (run.time, run["psi"]))
    return float(np.polyfit(at - at[0], psi, 1)[0]) if len(at) > 1 else 0.0


def with_rudder(run: Recording, ship: Particulars) -> Recording:
    """The rudder throughout: by the order, else held or on its way; and the times in which nobody knows it.

    Args:
        run: At even times, gaps as NaN.
        ship: For the rate of its steering gear and L/U0.

    Returns:
        The recording without gaps in delta; ``meta["held"]`` holds the holes in which the rudder was held,
        ``meta["breaks"]`` those in which it is not known.
    """
    time, shown, order = run.time, run["delta"].copy(), run.channels.get("delta_order", np.full(len(run), np.nan))
    known = time[np.isfinite(shown)]
    ends = [(float(a), float(b)) for a, b in ((time[0], known[0]), (known[-1], time[-1])) if b - a > _least(run.step)]
    held, breaks = list[Span](), list[Span]()
    for begin, end in [*holes(time, np.isfinite(shown), run.step), *ends]:
        lost = np.flatnonzero((time >= begin - 1e-9) & (time <= end + 1e-9) & ~np.isfinite(shown))
        span = slice(max(lost[0] - 1, 0), lost[-1] + 1)
        if np.isfinite(order[span]).all():
            start = shown[span][0] if np.isfinite(shown[span][0]) else order[span][0]
            shown[span] = followed(time[span], order[span], ship.rudder_rate, start=float(start))
        elif (begin, end) not in ends and _is_held(run, begin, end, ship):
            held.append((begin, end))
        else:
            breaks.append((begin, end))
            # A rudder rests longer than it moves. It matters where the record is late: then it tells of a time before.
            if (begin, end) not in ends:
                last, first = shown[time <= begin + 1e-9], shown[time >= end - 1e-9]
                last, first = last[np.isfinite(last)][-1], first[np.isfinite(first)][0]
                shown[lost] = np.where(time[lost] < 0.5 * (begin + end), last, first)
    good = np.isfinite(shown)
    delta = np.interp(run.time, run.time[good], shown[good])
    meta = {**run.meta, "held": tuple(held), "breaks": tuple(breaks)}
    return Recording(run.name, run.time, {**run.channels, "delta": delta}, run.status, meta)


def _is_held(run: Recording, begin: float, end: float, ship: Particulars) -> bool:
    """Whether the rudder was held through a hole, or moved all the way from one angle to the other."""
    sides = [run.time <= begin + 1e-9, run.time >= end - 1e-9]
    before, after = (run["delta"][side & np.isfinite(run["delta"])] for side in sides)
    moved = abs(float(np.median(after[:ENDS]) - np.median(before[-ENDS:])))
    if moved > RUDDER_PLAY:
        return end - begin < moved / ship.rudder_rate + MIN_HOLE_S
    if end - begin <= ship.time_unit:
        return True
    known = np.isfinite(run["psi"])
    gone = float(run["psi"][sides[1] & known][0] - run["psi"][sides[0] & known][-1])
    expected = 0.5 * (end - begin) * (_yaw_rate(run, begin, -1) + _yaw_rate(run, end, 1))
    share, least = MAX_HEADING_OFF
    return abs(gone - expected) < max(share * abs(expected), least)


def in_breaks(time: Series, breaks: tuple[Span, ...]) -> Bool[np.ndarray, " steps"]:
    """Which steps between samples lie in times in which nobody knows the rudder."""
    lost = np.zeros(len(time) - 1, dtype=bool)
    for begin, end in breaks:
        lost |= (time[:-1] < end - 1e-9) & (time[1:] > begin + 1e-9)
    return lost


def rudder_known_until(run: Recording, since: float) -> float:
    """Time up to which the rudder is known without a break from a time on [s]."""
    return min((begin for begin, end in run.meta.get("breaks", ()) if end > since), default=float(run.time[-1]))


def told(run: Recording) -> list[str]:
    """What was bridged and what was cut, a sentence each."""
    said = [
        f"{run.name}: nothing is known of the rudder from {begin:.0f} to {end:.0f} s: what comes before and after is "
        "fitted as two runs, and a free run ends there."
        for begin, end in run.meta.get("breaks", ())
    ]
    said += [
        f"{run.name}: no rudder from {begin:.0f} to {end:.0f} s: it counts as held, and the model bridges the hole."
        for begin, end in run.meta.get("held", ())
        if end - begin > run.meta["time_unit"]
    ]
    return said


def answers(run: Recording, since: float) -> bool:
    """Whether any sensor of the motion wrote something down after a time [s], as long as the rudder is known."""
    inside = (run.time > since + 1e-9) & (run.time <= rudder_known_until(run, since) + 1e-9)
    return any(np.isfinite(run[k][inside]).any() for k in MOTION_SENSORS if k in run.channels)
