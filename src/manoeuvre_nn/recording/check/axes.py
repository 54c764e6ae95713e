"""Checks of signs, axes and frames: heading against rate of turn, velocities against the track, rudder against turn."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import ndtr, stdtrit

from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import Change, Finding, in_unit, other_sign, refused
from manoeuvre_nn.recording.check.motion import (
    ALONG,
    ASIDE,
    TURNED,
    angle_turned,
    course_over_ground,
    off_course,
    smoothed_motion,
)
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import trimmed_least_squares
from manoeuvre_nn.recording.thinning import thinned

MISFIT = 0.35
"""Largest misfit between u, v and the track's velocity that is put down to sensors, wind and current [-]."""
SLOPE_SDS = 3.4
"""Standard deviations beyond which a sample does not count for the slope of one channel on another."""
RUDDER_WINDOW = 0.4
"""Window of the check of the rudder's sign over L/U0: shorter, for the evidence lies where the rudder moves."""
RECENT = 2.5
"""How long a movement of the rudder is felt in the yaw rate, over L/U0."""
HELD = 5.0
"""How long a rudder that has not moved is held until the ship turns steadily, over L/U0."""
HELD_TURN = 90 * DEGREE
"""Turn under a held rudder that no wave and no gust makes: the ship comes round."""
HELD_RUDDER = 10 * DEGREE
"""Rudder that is more than slight: against a slight one an unstable ship goes on turning (IMO 2002, MSC/Circ.1053,
appendix 4, 2.1.5). The angle is ours."""
STRONG_EVIDENCE = 4.0
"""Least ratio of the rudder's coefficient to its standard error for a verdict on its sign."""

WAY = 0.5
"""Speed over that of the approach from which on a ship goes where she heads; a slower one drifts in the wind."""

Series = Float[np.ndarray, " n"]


def heading_rate(recording: Recording, ship: Particulars) -> Finding | None:
    """The rate of the heading against r: units and signs of both."""
    if "r" in recording.derived:
        return None
    m = smoothed_motion(recording, ship)
    if np.ptp(m["psi"]) < 0.5 * DEGREE and np.ptp(recording["r"]) == 0:
        return None
    slope = robust_slope(m["r"], m["psidot"])
    # A constant error of the gyro is no wrong unit.
    centred = robust_slope(m["r"] - np.median(m["r"]), m["psidot"] - np.median(m["psidot"]))
    if min(abs(slope - 1), abs(centred - 1)) < 0.2:
        return None
    said = f"the heading changes {slope:.3g} times as fast as r says; expected 1"
    remedy, changes = _rate_remedy(recording, ship, m, slope)
    return refused("r against psi", said, remedy, *changes)


def heading_rate_in_turns(run: Recording, ship: Particulars) -> Finding | None:
    """The same where the ship turns; what no unit or sign explains may be what a diagnosis looks for."""
    found = heading_rate(run, ship) if _turns(run, ship) else None
    return found if found is not None and found.changes else None


def frame(recording: Recording, ship: Particulars) -> Finding | None:
    """Body velocities against those of the track: frames, signs, swapped columns, heading offset."""
    # The mistake without which the two come together best is named.
    if recording.derived & {"u", "x"}:
        return None
    m = smoothed_motion(recording, ship)
    as_given = _misfit(m)
    if as_given < MISFIT:
        return None
    tried = mistakes(m)
    cause, change, mended = min(tried, key=lambda one: _misfit(one[2]))
    cause, changes = (cause, (change,)) if _misfit(mended) <= 0.6 * as_given else _other_point(m, as_given)
    text = f"u, v do not follow from x, y and psi (misfit {as_given:.2g}, expected below {MISFIT})"
    return refused("frame", text, cause, *changes)


def mistakes(m: Recording) -> list[tuple[str, Change, Recording]]:
    """Simple mistakes with axes, frames and signs, and the motion without each.

    Args:
        m: From :func:`~manoeuvre_nn.recording.check.motion.smoothed_motion`.

    Returns:
        What looks wrong and what to do, the same as a change of the mapping, the motion with it.
    """
    offset = _heading_offset(m)
    north, east = body_to_earth(m["u"], m["v"], m["psi"])
    ahead, abeam = earth_to_body(m["u"], m["v"], m["psi"])
    return [
        ("u and v look earth-fixed: write frame: earth", Change("frame", value="earth"),
         m.with_channels(u=ahead, v=abeam)),
        ("u and v look body-fixed: write frame: body", Change("frame", value="body"),
         m.with_channels(u=north, v=east)),
        ("u and v look swapped: exchange their columns", Change("channels.u", "exchange", "v"),
         m.with_channels(u=m["v"], v=m["u"])),
        ("x and y look swapped (x is north, y east): exchange their columns", Change("channels.x", "exchange", "y"),
         m.with_channels(xdot=m["ydot"], ydot=m["xdot"])),
        *((f"write sign: -1 for {k}", other_sign(k), m.with_channels(**{compared: -m[compared]}))
          for k, compared in (("v", "v"), ("u", "u"), ("x", "xdot"), ("y", "ydot"), ("psi", "psi"))),
        (f"psi looks {offset / DEGREE:.0f} deg off: take that from the heading",
         Change("channels.psi", "offset", offset), m.with_channels(psi=m["psi"] - offset)),
    ]  # fmt: skip


def frame_in_turns(run: Recording, ship: Particulars) -> Finding | None:
    """The same where the ship turns; else there is little but noise to compare."""
    return frame(run, ship) if _turns(run, ship) else None


def course(run: Recording, ship: Particulars) -> Finding | None:
    """A ship that does not go where it heads."""
    way, window = course_over_ground(run, ship), WINDOW * ship.time_unit
    off = off_course(way, run["psi"])
    rates = [np.gradient(smoothed(run.time, angle, window)[0], run.time) for angle in (way, run["psi"])]
    mirrored = np.ptp(run["psi"]) > TURNED and np.corrcoef(*rates)[0, 1] < -0.5
    if off < ASIDE and not mirrored:
        return None
    beyond_a_turn = float(np.abs(run["psi"]).max()) > 7.0
    if off > ASIDE and beyond_a_turn and off_course(way, run["psi"] * DEGREE) < ALONG:
        text = f"the course over ground is {off / DEGREE:.0f} deg off the heading, along the numbers of psi as degrees"
        return refused("course", text, "psi looks like degrees: write unit: deg for psi", *in_unit("deg", "psi"))
    said = "turns to the other side than the heading" if mirrored else f"is {off / DEGREE:.0f} deg off the heading"
    text = (
        f"the course over ground {said} most of the time: x is north and y east, cog and psi are clockwise from north"
    )
    return refused("course", text, "exchange or turn round those that are not")


def course_of_track(recording: Recording, ship: Particulars) -> Finding | None:
    """The same of positions that u and v were derived from, for nothing else compares those with the heading."""
    makes_way = float(np.quantile(np.hypot(recording["u"], recording["v"]), 0.9)) > WAY * ship.speed
    return course(recording, ship) if recording.derived & {"u", "x"} == {"u"} and makes_way else None


def rudder_sign(recording: Recording, ship: Particulars) -> Finding | None:
    """Which way the rudder turns the ship, measured."""
    # A steady force may turn a ship against her rudder, but not make her answer its movements the wrong way.
    turned = turned_by_held_rudder(recording, ship)
    b, error = rudder_effect(recording, ship)
    if turned < -HELD_TURN and b < STRONG_EVIDENCE * error:
        how = f"{-turned / DEGREE:.0f} deg while it is held"
    elif turned < HELD_TURN and b < -STRONG_EVIDENCE * error:
        how = f"rdot = {b * ship.time_unit**2:.2g} delta in units of U0^2/L^2"
    else:
        return None
    text = f"rudder sign opposite to the turn: a positive rudder angle turns the ship to port ({how})"
    remedy = "change rudder_positive_to (or the sign of delta, or of r and psi together)"
    return refused("rudder sign", text, remedy, Change("rudder_positive_to", "turn"))


def rudder_effect(recording: Recording, ship: Particulars) -> tuple[float, float]:
    """How much a rudder angle turns the ship.

    ``rdot = a r + b delta + c`` is fitted to the times in which the rudder has moved lately, so that a ship that lags
    behind its rudder, or is unstable on a straight course, does not mislead: what counts is which way a rudder angle
    *changes* the yaw rate. Long steady turns are left out, for there r says all that delta does; so are outlying
    samples. Sway as a third column is so much like r that it takes the rudder's evidence away.

    A rudder that is held turns the ship to its side in the end. Where no such turn says the same as b, the standard
    error of few samples is made wider, by as much as Student's t is at ``STRONG_EVIDENCE``.

    Returns:
        Coefficient b of the rudder [1/s^2] and its standard error; zeros where the rudder hardly moves.
    """
    recording = thinned(recording, ship)
    window = RUDDER_WINDOW * ship.time_unit
    (rudder, _), (r, rdot) = (smoothed(recording.time, recording[k], window) for k in ("delta", "r"))
    # Samples half a window apart have nearly independent errors.
    stride = max(round(0.5 * window / recording.step), 1)
    columns, target = np.stack([rudder, r, np.ones_like(r)], axis=1)[::stride], rdot[::stride]
    active = _has_moved(rudder, max(round(RECENT * ship.time_unit / recording.step), 1))[::stride]
    if active.sum() < 8:
        return 0.0, 0.0
    large = float(np.quantile(np.abs(target[active]), 0.9))
    values, covariance, kept = trimmed_least_squares(columns, target, 4.0, 0.05 * large, active)
    error = float(np.sqrt(max(covariance[0, 0], 0.0)))
    held = _held(rudder, recording, ship)
    if values[0] * float((r * rudder)[held].sum()) <= 0:
        error *= -float(stdtrit(max(kept.sum() - len(values), 1), ndtr(-STRONG_EVIDENCE))) / STRONG_EVIDENCE
    return float(values[0]), error


def turned_by_held_rudder(recording: Recording, ship: Particulars) -> float:
    """How far the ship turned to the side of a large rudder angle that was held, ``int r sign(delta) dt``.

    Args:
        recording: The recording.
        ship: The ship.

    Returns:
        Angle [rad]; negative for a turn against the rudder, 0 where none is held.
    """
    recording = thinned(recording, ship)
    rudder, r = (smoothed(recording.time, recording[k], RUDDER_WINDOW * ship.time_unit)[0] for k in ("delta", "r"))
    held = _held(rudder, recording, ship) & (np.abs(rudder) > HELD_RUDDER)
    return float((r * np.sign(rudder))[held].sum()) * recording.step


def _rate_remedy(recording: Recording, ship: Particulars, m: Recording, slope: float) -> tuple[str, tuple[Change, ...]]:
    """Which of psi and r is in another unit, or has the other sign."""
    turning = float(np.quantile(np.abs(m["r"]), 0.98)) * ship.time_unit
    if abs(60 * slope - 1) < 0.02:  # close to 1 / 57.3, which is deg/s taken for rad/s
        return "r looks like deg/min, not deg/s: write unit: deg/min for r", in_unit("deg/min", "r")
    if abs(slope * DEGREE - 1) < 0.2:
        if turning > 0.03:
            return "psi looks like degrees: write unit: deg for psi", in_unit("deg", "psi")
        return "r looks like rad/s, not deg/s: write unit: rad/s for r", in_unit("rad/s", "r")
    if abs(slope / DEGREE - 1) < 0.2:
        if turning > 4:
            return "r looks like deg/s: write unit: deg/s for r", in_unit("deg/s", "r")
        return "psi looks like radians, not degrees: write unit: rad for psi", in_unit("rad", "psi")
    if abs(slope + 1) < 0.2:
        if recording.derived & {"u", "x"}:
            return "write sign: -1 for psi or for r", ()
        name = "psi" if _misfit(m.with_channels(psi=-m["psi"])) < _misfit(m) else "r"
        return f"write sign: -1 for {name}", (other_sign(name),)
    return "mind the units of psi, r and time", ()


def _other_point(m: Recording, as_given: float) -> tuple[str, tuple[Change, ...]]:
    """Positions of another point than the velocities; else nobody knows."""
    _, abeam = earth_to_body(m["xdot"], m["ydot"], m["psi"])
    lever = robust_slope(m["r"], abeam - m["v"])
    if _misfit(m.with_channels(v=m["v"] + lever * m["r"])) > 0.6 * as_given:
        return "mind the columns and signs of u, v, x, y, psi, and reference_point", ()
    side = "ahead of" if lever > 0 else "aft of"
    said = f"x and y look to be of a point {abs(lever):.3g} m {side} that of u and v: write position_point"
    return said, (Change("position_point", "add", lever),)


def _turns(run: Recording, ship: Particulars) -> bool:
    """Whether there is more than noise to compare."""
    return bool(max(angle_turned(run, ship), np.ptp(run["psi"])) > TURNED)


def _misfit(m: Recording) -> float:
    """Typical error of u over the typical speed plus that of v over the typical sway of ship and track."""
    ahead, abeam = earth_to_body(m["xdot"], m["ydot"], m["psi"])
    sway = 0.5 * np.quantile(np.abs(abeam), 0.9) + 0.5 * np.quantile(np.abs(m["v"]), 0.9)
    surge = np.median(np.abs(m["u"] - ahead)) / np.median(m["speed"])
    return float(surge + np.median(np.abs(m["v"] - abeam)) / max(sway, 1e-9))


def _heading_offset(m: Recording) -> float:
    """Constant by which psi is ahead of the angle between track velocity and body velocity [rad]."""
    way = np.arctan2(m["ydot"], m["xdot"]) - np.arctan2(m["v"], m["u"])
    weight = m["speed"] > 0.3 * np.quantile(m["speed"], 0.95)
    return float(np.angle(np.mean(np.exp(1j * (m["psi"] - way)[weight]))))


def robust_slope(x: Series, y: Series) -> float:
    """Slope of y on x through the origin, where x is large, without the samples that lie far off.

    Args:
        x: One channel.
        y: Another.

    Returns:
        Slope, in units of y over those of x; 0 where x is 0 throughout.
    """
    large = np.abs(x) > 0.2 * np.quantile(np.abs(x), 0.95)
    return float(trimmed_least_squares(x[:, None], y, SLOPE_SDS, 1e-12, large)[0][0]) if large.any() else 0.0


def _held(rudder: Series, recording: Recording, ship: Particulars) -> Bool[np.ndarray, " n"]:
    """Whether the ship turns steadily by a rudder that has not moved."""
    return ~_has_moved(rudder, max(round(HELD * ship.time_unit / recording.step), 1))


def _has_moved(rudder: Series, count: int) -> Bool[np.ndarray, " n"]:
    """Whether the rudder has moved by 30 % of its usual angle within the last ``count`` samples."""
    back = (count - 1) // 2
    travel = maximum_filter1d(rudder, count, origin=back) - minimum_filter1d(rudder, count, origin=back)
    return travel > 0.3 * max(float(np.quantile(np.abs(rudder), 0.9)), 1e-6)
