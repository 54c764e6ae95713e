"""Units, signs and frames of a recording, judged from the recording itself before anything is fitted."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from manoeuvre_nn.core.channels import MOTION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.check.finding import Change, Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import trimmed_least_squares
from manoeuvre_nn.recording.thinning import thinned

MISFIT = 0.35
"""Largest misfit between u, v and the track's velocity that is put down to sensors, wind and current [-]."""
RUDDER_WINDOW = 0.4
"""Window of the check of the rudder's sign over L/U0: shorter, for the evidence lies where the rudder moves."""
RECENT = 2.5
"""How long a movement of the rudder is felt in the yaw rate, over L/U0."""
SLOPE_SDS = 3.4
"""Standard deviations beyond which a sample does not count for the slope of one channel on another."""
STRONG_EVIDENCE = 4.0
"""Least ratio of the rudder's coefficient to its standard error for a verdict on its sign."""

Series = Float[np.ndarray, " n"]
SPEED_RATIOS = {
    KNOT: ("u and v look like knots", "kn", ("u", "v")),
    1 / KNOT: ("u and v look like m/s, not knots", "m/s", ("u", "v")),
    1 / 3.6: ("u and v look like km/h", "km/h", ("u", "v")),
    3.6: ("u and v look like m/s, not km/h", "m/s", ("u", "v")),
    1 / 0.3048: ("x and y look like feet", "ft", ("x", "y")),
    0.3048: ("x and y look like metres, not feet", "m", ("x", "y")),
    1e-3: ("time looks like milliseconds", "ms", ("time",)),
    1e3: ("time looks like seconds, not milliseconds", "s", ("time",)),
    60.0: ("time looks like minutes", "min", ("time",)),
    1 / 60: ("time looks like seconds, not minutes", "s", ("time",)),
}
"""Speed over ground over ``hypot(u, v)`` -> what was mistaken, the right unit, of which channels."""


def check_recording(recording: Recording, ship: Particulars) -> None:
    """Refuse a recording whose units, signs or frames do not fit each other or the ship.

    Args:
        recording: As read.
        ship: The ship.

    Raises:
        InputError: With the first finding.
    """
    lacking = [name for name in MOTION if name not in recording.channels]
    if lacking:
        raise InputError(
            f"recording {recording.name} has no {', '.join(lacking)}: a mapping of kind: record serves to look at it; "
            "a model needs u, v, r, x, y, psi and delta"
        )
    for check in CHECKS.values():
        finding = check(recording, ship)
        if finding is not None:
            raise InputError(f"recording {recording.name}: {finding}")


def _rudder_unit(recording: Recording, ship: Particulars) -> Finding | None:
    """Degrees taken for radians, and the reverse."""
    del ship
    largest, turned = float(np.abs(recording["delta"]).max()), float(np.ptp(recording["psi"]))
    if largest > 1.2:
        text = f"rudder angles reach {largest:.4g} rad; expected below 1.2"
        return _refused("rudder unit", text, "delta looks like degrees: write unit: deg", *_units("deg", "delta"))
    if 0 < largest < 1.2 * DEGREE and turned > 0.5:
        text = (
            f"rudder angles stay within {largest / DEGREE:.2g} deg while the heading changes by "
            f"{turned / DEGREE:.0f} deg; delta looks like radians, not degrees"
        )
        return _refused("rudder unit", text, "write unit: rad", *_units("rad", "delta"))
    return None


def _rudder_stop(recording: Recording, ship: Particulars) -> Finding | None:
    """Rudder beyond the ship's stop."""
    largest = float(np.abs(recording["delta"]).max())
    if largest <= ship.rudder_limit + 1.0 * DEGREE:
        return None
    text = (
        f"rudder angles reach {largest / DEGREE:.4g} deg; that of the {ship.name} stops at "
        f"{ship.rudder_limit / DEGREE:.4g} deg"
    )
    return _refused("rudder stop", text, "choose the right ship, or mind the unit and offset of delta")


def _speed_unit(recording: Recording, ship: Particulars) -> Finding | None:
    """Speed from u and v against the track; with no track of its own, against the ship."""
    if recording.derived & {"u", "x"}:
        return None
    m = _Motion(recording, ship)
    fast = m.speed > 0.3 * np.quantile(m.speed, 0.95)
    ratio = float(np.median(np.hypot(m.north, m.east)[fast] / m.speed[fast]))
    if 0.75 < ratio < 1.33:
        return None
    known = min(SPEED_RATIOS, key=lambda k: abs(np.log(max(ratio, 1e-9) / k)))
    text = f"the speed from x, y is {ratio:.4g} times hypot(u, v); expected 1"
    if abs(np.log(max(ratio, 1e-9) / known)) < 0.1:
        cause, unit, channels = SPEED_RATIOS[known]
        return _refused("speed unit", text, f"{cause}: write unit: {unit}", *_units(unit, *channels))
    return _refused("speed unit", text, "mind the units of u, v, x, y and time")


def _speed_size(recording: Recording, ship: Particulars) -> Finding | None:
    """Speeds that the ship cannot have. Slow runs are let pass: a trial may be made at any speed."""
    speed = np.hypot(recording["u"], recording["v"])
    usual = float(np.quantile(speed, 0.9))
    if usual > 1.6 * ship.speed:
        remedy = "u and v look like knots or km/h: write their unit, or choose the right ship (model scale, full scale)"
        text = f"the speed reaches {usual:.4g} m/s; the {ship.name} approaches at {ship.speed:.4g} m/s"
        return _refused("speed", text, remedy)
    if usual < 0.05 * ship.speed:
        text = f"the speed stays below {usual:.4g} m/s; the {ship.name} approaches at {ship.speed:.4g} m/s"
        return _refused("speed", text, "mind the unit of u and v, or choose the right ship (model scale, full scale)")
    forward = float(np.quantile(recording["u"], 0.95))
    if forward < 0:
        text = f"u stays below {forward:.3g} m/s, the ship runs astern throughout"
        return _refused("speed", text, "write sign: -1 for u", *_turned("u"))
    return None


def _heading_rate(recording: Recording, ship: Particulars) -> Finding | None:
    """The rate of the heading against r: units and signs of both."""
    if "r" in recording.derived:
        return None
    m = _Motion(recording, ship)
    if np.ptp(m.psi) < 0.5 * DEGREE and np.ptp(recording["r"]) == 0:
        return None
    slope = _robust_slope(m.r, m.psi_rate)
    # A constant error of the gyro is no wrong unit.
    centred = _robust_slope(m.r - np.median(m.r), m.psi_rate - np.median(m.psi_rate))
    if min(abs(slope - 1), abs(centred - 1)) < 0.2:
        return None
    said = f"the heading changes {slope:.3g} times as fast as r says; expected 1"
    remedy, changes = _rate_remedy(recording, ship, m, slope)
    return _refused("r against psi", said, remedy, *changes)


def _rate_remedy(recording: Recording, ship: Particulars, m: "_Motion", slope: float) -> tuple[str, tuple[Change, ...]]:
    """Which of psi and r is in another unit, or has the other sign."""
    turning = float(np.quantile(np.abs(m.r), 0.98)) * ship.time_unit
    if abs(60 * slope - 1) < 0.02:  # close to 1 / 57.3, which is deg/s taken for rad/s
        return "r looks like deg/min, not deg/s: write unit: deg/min for r", _units("deg/min", "r")
    if abs(slope * DEGREE - 1) < 0.2:
        if turning > 0.03:
            return "psi looks like degrees: write unit: deg for psi", _units("deg", "psi")
        return "r looks like rad/s, not deg/s: write unit: rad/s for r", _units("rad/s", "r")
    if abs(slope / DEGREE - 1) < 0.2:
        if turning > 4:
            return "r looks like deg/s: write unit: deg/s for r", _units("deg/s", "r")
        return "psi looks like radians, not degrees: write unit: rad for psi", _units("rad", "psi")
    if abs(slope + 1) < 0.2:
        if recording.derived & {"u", "x"}:
            return "write sign: -1 for psi or for r", ()
        turned = _misfit(m, m.u, m.v, m.north, m.east, -m.psi) < _misfit(m, m.u, m.v, m.north, m.east, m.psi)
        name = "psi" if turned else "r"
        return f"write sign: -1 for {name}", _turned(name)
    return "mind the units of psi, r and time", ()


def _frame(recording: Recording, ship: Particulars) -> Finding | None:
    """Body velocities against those of the track: frames, signs, swapped columns, heading offset."""
    # Every simple mistake is tried; the one that brings the two together best is named.
    if recording.derived & {"u", "x"}:
        return None
    m = _Motion(recording, ship)
    as_given = _misfit(m, m.u, m.v, m.north, m.east, m.psi)
    if as_given < MISFIT:
        return None
    offset = _heading_offset(m)
    turned, straight = body_to_earth(m.u, m.v, m.psi), earth_to_body(m.u, m.v, m.psi)
    tried: list[tuple[str, tuple[Change, ...], float]] = [
        ("u and v look earth-fixed: write frame: earth", (Change("frame", value="earth"),),
         _misfit(m, *straight, m.north, m.east, m.psi)),
        ("u and v look body-fixed: write frame: body", (Change("frame", value="body"),),
         _misfit(m, *turned, m.north, m.east, m.psi)),
        ("u and v look swapped: exchange their columns", (Change("channels.u", "exchange", "v"),),
         _misfit(m, m.v, m.u, m.north, m.east, m.psi)),
        ("x and y look swapped (x is north, y east): exchange their columns", (Change("channels.x", "exchange", "y"),),
         _misfit(m, m.u, m.v, m.east, m.north, m.psi)),
        ("write sign: -1 for v", _turned("v"), _misfit(m, m.u, -m.v, m.north, m.east, m.psi)),
        ("write sign: -1 for u", _turned("u"), _misfit(m, -m.u, m.v, m.north, m.east, m.psi)),
        ("write sign: -1 for x", _turned("x"), _misfit(m, m.u, m.v, -m.north, m.east, m.psi)),
        ("write sign: -1 for y", _turned("y"), _misfit(m, m.u, m.v, m.north, -m.east, m.psi)),
        ("write sign: -1 for psi", _turned("psi"), _misfit(m, m.u, m.v, m.north, m.east, -m.psi)),
        (f"psi looks {offset / DEGREE:.0f} deg off: take that from the heading",
         (Change("channels.psi", "offset", offset),), _misfit(m, m.u, m.v, m.north, m.east, m.psi - offset)),
    ]  # fmt: skip
    cause, changes, best = min(tried, key=lambda one: one[2])
    if best > 0.6 * as_given:
        cause, changes = _other_point(m, as_given)
    text = f"u, v do not follow from x, y and psi (misfit {as_given:.2g}, expected below {MISFIT})"
    return _refused("frame", text, cause, *changes)


def _other_point(m: "_Motion", as_given: float) -> tuple[str, tuple[Change, ...]]:
    """Positions of another point than the velocities; else nobody knows."""
    _, abeam = earth_to_body(m.north, m.east, m.psi)
    lever = _robust_slope(m.r, abeam - m.v)
    if _misfit(m, m.u, m.v + lever * m.r, m.north, m.east, m.psi) > 0.6 * as_given:
        return "mind the columns and signs of u, v, x, y, psi, and reference_point", ()
    side = "ahead of" if lever > 0 else "aft of"
    said = f"x and y look to be of a point {abs(lever):.3g} m {side} that of u and v: write position_point"
    return said, (Change("position_point", "add", lever),)


def _rudder_sign(recording: Recording, ship: Particulars) -> Finding | None:
    """Which way the rudder turns the ship, measured."""
    # ``rdot = a r + b delta + c`` is fitted to the times in which the rudder has moved lately, so that a ship that lags
    # behind its rudder, or is unstable on a straight course, does not mislead: what counts is which way a rudder angle
    # *changes* the yaw rate. Long steady turns are left out, for there r says all that delta does; so are outlying
    # samples. (Sway as a third column is so much like r that it takes the rudder's evidence away.) No verdict is given
    # where b is not significant, as with a rudder that hardly moves.
    b, error = rudder_effect(recording, ship)
    if not b < -STRONG_EVIDENCE * error:
        return None
    text = (
        "rudder sign opposite to the turn: a positive rudder angle turns the ship to port (rdot = "
        f"{b * ship.time_unit**2:.2g} delta in units of U0^2/L^2)"
    )
    remedy = "change rudder_positive_to (or the sign of delta, or of r and psi together)"
    return _refused("rudder sign", text, remedy, Change("rudder_positive_to", "turn"))


def _refused(check: str, text: str, remedy: str, *changes: Change) -> Finding:
    """What cannot be used as it is."""
    return Finding(check, "refuse", text, remedy=remedy, changes=tuple(changes))


def _units(unit: str, *names: str) -> tuple[Change, ...]:
    """Another unit for some channels, or for time."""
    return tuple(Change("time.unit" if k == "time" else f"channels.{k}.unit", value=unit) for k in names)


def _turned(name: str) -> tuple[Change, ...]:
    """A channel with the other sign."""
    return (Change(f"channels.{name}", "turn"),)


class _Motion:
    """Smoothed velocities, and those of the track."""

    def __init__(self, recording: Recording, ship: Particulars) -> None:
        recording, window = thinned(recording, ship), WINDOW * ship.time_unit
        smooth = {k: smoothed(recording.time, recording[k], window) for k in ("u", "v", "r", "x", "y", "psi")}
        self.u, self.v, self.r, self.psi = (smooth[k][0] for k in ("u", "v", "r", "psi"))
        self.psi_rate = smooth["psi"][1]
        self.north, self.east = smooth["x"][1], smooth["y"][1]
        self.speed = np.maximum(np.hypot(self.u, self.v), 1e-9)


def _misfit(m: _Motion, u: Series, v: Series, north: Series, east: Series, psi: Series) -> float:
    """Typical error of u over the typical speed plus that of v over the typical sway of ship and track."""
    ahead, abeam = earth_to_body(north, east, psi)
    sway = 0.5 * np.quantile(np.abs(abeam), 0.9) + 0.5 * np.quantile(np.abs(v), 0.9)
    surge = np.median(np.abs(u - ahead)) / np.median(m.speed)
    return float(surge + np.median(np.abs(v - abeam)) / max(sway, 1e-9))


def _heading_offset(m: _Motion) -> float:
    """Constant by which psi is ahead of the angle between track velocity and body velocity [rad]."""
    course = np.arctan2(m.east, m.north) - np.arctan2(m.v, m.u)
    weight = m.speed > 0.3 * np.quantile(m.speed, 0.95)
    return float(np.angle(np.mean(np.exp(1j * (m.psi - course)[weight]))))


def _robust_slope(x: Series, y: Series) -> float:
    """Slope of y on x through the origin, twice without the samples that lie far off."""
    large = np.abs(x) > 0.2 * np.quantile(np.abs(x), 0.95)
    return float(trimmed_least_squares(x[:, None], y, SLOPE_SDS, 1e-12, large)[0][0])


def rudder_effect(recording: Recording, ship: Particulars) -> tuple[float, float]:
    """How much a rudder angle turns the ship, by the fit of :func:`_rudder_sign`.

    Args:
        recording: Rudder and rate of turn.
        ship: The ship.

    Returns:
        Coefficient of the rudder in the yaw acceleration [1/s^2] and its standard error; zeros where it hardly moves.
    """
    recording = thinned(recording, ship)
    time, window = recording.time, RUDDER_WINDOW * ship.time_unit
    (rudder, _), (r, rdot) = (smoothed(time, recording[k], window) for k in ("delta", "r"))
    interval = float(np.median(np.diff(time)))
    # Samples half a window apart have nearly independent errors.
    stride = max(round(0.5 * window / interval), 1)
    columns, target = np.stack([rudder, r, np.ones_like(r)], axis=1)[::stride], rdot[::stride]
    active = _has_moved(rudder, max(round(RECENT * ship.time_unit / interval), 1))[::stride]
    if active.sum() < 8:
        return 0.0, 0.0
    large = float(np.quantile(np.abs(target[active]), 0.9))
    values, covariance, _ = trimmed_least_squares(columns, target, 4.0, 0.05 * large, active)
    return float(values[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))


def _has_moved(rudder: Series, count: int) -> Bool[np.ndarray, " n"]:
    """Whether the rudder has moved by 30 % of its usual angle within the last ``count`` samples."""
    back = (count - 1) // 2
    travel = maximum_filter1d(rudder, count, origin=back) - minimum_filter1d(rudder, count, origin=back)
    return travel > 0.3 * max(float(np.quantile(np.abs(rudder), 0.9)), 1e-6)


Check = Callable[[Recording, Particulars], Finding | None]
CHECKS: dict[str, Check] = {
    "rudder unit": _rudder_unit,
    "rudder stop": _rudder_stop,
    "speed unit": _speed_unit,
    "speed size": _speed_size,
    "heading rate": _heading_rate,
    "frame": _frame,
    "rudder sign": _rudder_sign,
}
"""In the order in which a finding is reported: a wrong unit explains what a later check would find."""
