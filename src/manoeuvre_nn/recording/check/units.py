"""Checks of units and sizes: each channel against the others and against the ship."""

import numpy as np

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.check.finding import Change, Finding, in_unit, other_sign, refused
from manoeuvre_nn.recording.check.motion import (
    ALONG,
    TURNED,
    angle_turned,
    course_over_ground,
    off_course,
    smoothed_motion,
)

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
LOGS = {1 / KNOT: "u_log looks like knots", 3.6: "u_log looks like km/h"}
"""Logged speed over speed over ground -> what was mistaken."""
MAX_RATIO, MAX_RATIO_BY_LOG = 1.6, 2.0
"""Speed over ground over the approach speed beyond which a unit or the ship is wrong: by what is measured over ground,
and where a log agrees. A gale from astern drives a slow ship at more than 1.6 times it; feet are 3.3 times."""
STUCK, AROUND = 0.5 * DEGREE, 45 * DEGREE
"""A rudder that moves less, in a run that turns through more, was not recorded."""


def heading_unit(run: Recording, ship: Particulars) -> Finding | None:
    """A heading that hardly changes while the ship turns: radians among degrees."""
    numbers, turned = run["psi"] / DEGREE, angle_turned(run, ship)
    if np.ptp(numbers) > 7 or turned < 0.8 * TURNED or np.ptp(run["psi"]) > 0.5 * turned:
        return None
    if not 0.6 < np.ptp(np.unwrap(numbers)) / turned < 1.6:
        return None
    text = f"psi stays within {np.ptp(numbers):.3g} deg while the ship turns through {turned / DEGREE:.0f} deg"
    return refused("heading unit", text, "psi looks like radians")


def stuck_rudder(run: Recording, ship: Particulars) -> Finding | None:
    """A rudder that rests while the ship goes through a turn."""
    moved, turned = float(np.ptp(run["delta"])), float(np.ptp(run["psi"]))
    if moved > STUCK or turned < AROUND:
        return None
    text = f"the rudder stays within {moved / DEGREE:.2g} deg while the ship turns through {turned / DEGREE:.0f} deg"
    remedy = "delta is missing or its sensor stuck, and without it nothing can be decided"
    return refused("stuck rudder", text, remedy)


def rudder_unit(recording: Recording, ship: Particulars) -> Finding | None:
    """Degrees taken for radians, and the reverse."""
    largest, turned = float(np.abs(recording["delta"]).max()), float(np.ptp(recording["psi"]))
    if largest > 1.2:
        text = f"rudder angles reach {largest:.4g} rad; expected below 1.2"
        if {"x", "y"} <= set(recording.channels) and "x" not in recording.derived:
            way = course_over_ground(recording, ship)
            if off_course(way, recording["delta"]) < min(ALONG, off_course(way, recording["psi"])):
                text += ", and the ship goes where they point"
                remedy = "delta and psi look exchanged: exchange their columns"
                return refused("rudder unit", text, remedy, Change("channels.delta", "exchange", "psi"))
        return refused("rudder unit", text, "delta looks like degrees: write unit: deg", *in_unit("deg", "delta"))
    if 0 < largest < 1.2 * DEGREE and turned > 0.5:
        text = (
            f"rudder angles stay within {largest / DEGREE:.2g} deg while the heading changes by "
            f"{turned / DEGREE:.0f} deg; delta looks like radians, not degrees"
        )
        return refused("rudder unit", text, "write unit: rad", *in_unit("rad", "delta"))
    return None


def rudder_stop(recording: Recording, ship: Particulars) -> Finding | None:
    """Rudder beyond the ship's stop."""
    largest = float(np.abs(recording["delta"]).max())
    if largest <= ship.rudder_limit + 1.0 * DEGREE:
        return None
    text = (
        f"rudder angles reach {largest / DEGREE:.4g} deg; that of the {ship.name} stops at "
        f"{ship.rudder_limit / DEGREE:.4g} deg"
    )
    return refused("rudder stop", text, "choose the right ship, or mind the unit and offset of delta")


def log_unit(run: Recording, ship: Particulars) -> Finding | None:
    """The log in another unit than the speed over ground."""
    if "u_log" not in run.channels:
        return None
    over_ground = ("vn", "ve") if "vn" in run.channels else ("u", "v")
    speed = np.nanmedian(np.hypot(*(run[name] for name in over_ground)))
    ratio = float(np.nanmedian(run["u_log"]) / max(speed, 1e-9))
    cause = next((cause for known, cause in LOGS.items() if abs(ratio / known - 1) < 0.12), None)
    return refused("log unit", f"u_log is {ratio:.2f} times the speed over ground", cause) if cause else None


def shaft_unit(run: Recording, ship: Particulars) -> Finding | None:
    """Shaft speed in revolutions per second, or of another ship."""
    ratio = float(np.median(run.channels.get("shaft_recorded", 1.0)))
    if 0.1 < ratio < 5:
        return None
    text = f"n is {ratio * ship.rpm:.3g} rpm; nominal for the {ship.name} is {ship.rpm:g} rpm"
    return refused("shaft unit", text, "mind the unit of n, or write the nominal one as rpm=")


def speed_unit(recording: Recording, ship: Particulars) -> Finding | None:
    """Speed from u and v against the track; with no track of its own, against the ship."""
    if recording.derived & {"u", "x"}:
        return None
    m = smoothed_motion(recording, ship)
    fast = m["speed"] > 0.3 * np.quantile(m["speed"], 0.95)
    ratio = float(np.median(np.hypot(m["xdot"], m["ydot"])[fast] / m["speed"][fast]))
    if 0.75 < ratio < 1.33:
        return None
    known = min(SPEED_RATIOS, key=lambda k: abs(np.log(max(ratio, 1e-9) / k)))
    text = f"the speed from x, y is {ratio:.4g} times hypot(u, v); expected 1"
    if abs(np.log(max(ratio, 1e-9) / known)) < 0.1:
        cause, unit, channels = SPEED_RATIOS[known]
        return refused("speed unit", text, f"{cause}: write unit: {unit}", *in_unit(unit, *channels))
    return refused("speed unit", text, "mind the units of u, v, x, y and time")


def speed_size(recording: Recording, ship: Particulars) -> Finding | None:
    """Speeds that the ship cannot have. Slow runs are let pass: a trial may be made at any speed."""
    usual = float(np.quantile(np.hypot(recording["u"], recording["v"]), 0.9))
    approach = f"{usual:.4g} m/s; the {ship.name} approaches at {ship.speed:.4g} m/s"
    choose = "or choose the right ship (model scale, full scale)"
    given = "mind the units of x, y and time" if "u" in recording.derived else "mind the unit of u and v"
    log = recording.channels.get("u_log")
    by_log = log is not None and np.nanquantile(log, 0.9) > 0.75 * usual
    if usual > (MAX_RATIO_BY_LOG if by_log else MAX_RATIO) * ship.speed:
        looks = given if "u" in recording.derived else "u and v look like knots or km/h: write their unit"
        return refused("speed", f"the speed reaches {approach}", f"{looks}, {choose}")
    if usual < 0.05 * ship.speed:
        return refused("speed", f"the speed stays below {approach}", f"{given}, {choose}")
    forward = float(np.quantile(recording["u"], 0.95))
    if forward < 0:
        text = f"u stays below {forward:.3g} m/s, the ship runs astern throughout"
        return refused("speed", text, "write sign: -1 for u", other_sign("u"))
    return None
