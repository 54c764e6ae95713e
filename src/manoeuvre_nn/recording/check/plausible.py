"""Units, signs and frames of a run, fitted from the run itself before anything is fitted."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.check.checks import CHECKS
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed

TURNED = 20 * DEGREE
"""Change of heading from which rates and frames can be compared."""
LOGS = {1 / KNOT: "u_log looks like knots", 3.6: "u_log looks like km/h"}
"""Logged speed over speed over ground -> what was mistaken."""
COLUMNS = (
    "csv columns are t in s, x_north, y_east in m, sog, u, v, u_log in m/s, cog, psi, delta in deg, r in deg/s, n in "
    "rpm; for others give mapping=FILE.yaml"
)
"""What to do about a wrong unit where no mapping was given."""
MIN_LENGTH = 4.0
"""Shortest run that a diagnosis can use, over L/U0: the state at the end of the warm-up takes half of it."""
MAX_STEP = 0.25
"""Longest time between samples that a diagnosis can use, over L/U0."""
MAX_LOST_RUDDER, MAX_UNEVEN = 0.2, 0.2
"""Largest share of empty cells in the rudder angle, and of times between samples that are far from the usual one."""
STUCK, AROUND = 0.5 * DEGREE, 45 * DEGREE
"""A rudder that moves less, in a run that turns through more, was not recorded."""


def check_plausible(recording: Recording, ship: Particulars, remedy: str = COLUMNS) -> None:
    """Refuse a run whose units, signs or frames do not fit each other or the ship.

    Args:
        recording: From :func:`~manoeuvre_nn.recording.preparation.over_ground`.
        ship: The ship.
        remedy: What to do about a wrong column.

    Raises:
        InputError: With the first finding.
    """
    clean = _without_spikes(recording, ship)
    checks: list[Callable[[Recording, Particulars], object | None]] = [_heading_unit, _stuck_rudder]
    checks += [CHECKS["rudder unit"], CHECKS["rudder stop"], _log_unit, _shaft_unit]
    checks += [CHECKS["speed unit"], CHECKS["speed size"]]
    if max(_turned(clean, ship), np.ptp(clean["psi"])) > TURNED:  # else there is little but noise to compare
        checks += [_explained_rate, CHECKS["frame"]]
    for check in (*checks, _course, CHECKS["rudder sign"]):
        finding = check(clean, ship)
        if finding is not None:
            raise InputError(f"{recording.name}: {finding}" + ("" if check is CHECKS["rudder sign"] else f"; {remedy}"))


def check_sampling(run: Recording, ship: Particulars) -> None:
    """Refuse a run that is too short, too coarse or too uneven for a diagnosis, or lacks much of its rudder angle.

    Args:
        run: As recorded, gaps as NaN.
        ship: For L/U0.

    Raises:
        InputError: If it is.
    """
    steps, unit = np.diff(run.time), ship.time_unit
    if run.duration < MIN_LENGTH * unit:
        raise InputError(
            f"{run.name}: too short a record: {len(run)} samples over {run.duration:.4g} s; a diagnosis of the "
            f"{ship.name} needs at least {MIN_LENGTH * unit:.0f} s ({MIN_LENGTH:g} L/U0): give a longer one, t in s"
        )
    usual = float(np.median(steps))
    if usual > MAX_STEP * unit:
        raise InputError(
            f"{run.name}: samples are {usual:.4g} s apart; the {ship.name} needs one every {MAX_STEP * unit:.2g} s or "
            "more often: sample faster, with t in s"
        )
    uneven = float(np.mean(np.abs(steps - usual) > 0.5 * usual))
    if uneven > MAX_UNEVEN:
        raise InputError(
            f"{run.name}: {uneven:.0%} of the times between samples are more than half off the usual {usual:.3g} s: "
            "write samples at even times"
        )
    lost = float(np.mean(np.isnan(run.channels.get("delta", np.zeros(1)))))
    if lost > MAX_LOST_RUDDER:
        raise InputError(f"{run.name}: {lost:.0%} of delta is empty; a diagnosis needs the rudder throughout")


def _without_spikes(recording: Recording, ship: Particulars) -> Recording:
    """The run as a recording: gaps filled, single-sample outliers taken out, what is lacking derived."""
    c = {k: median_filter(recording.filled(k), 5, mode="nearest") for k in recording.channels}
    derived = {"u"} if "vn" in recording.meta["derived"] else set()
    c["u"], c["v"] = earth_to_body(c["vn"], c["ve"], c["psi"])
    if "r" not in c:
        c["r"] = smoothed(recording.time, c["psi"], WINDOW * ship.time_unit)[1]
        derived.add("r")
    if "x" not in c:
        c["x"], c["y"] = (cumulative_trapezoid(c[k], recording.time, initial=0.0) for k in ("vn", "ve"))
        derived.add("x")
    return Recording(recording.name, recording.time, c, meta={"derived": tuple(derived)})


def _explained_rate(run: Recording, ship: Particulars) -> Finding | None:
    """Heading and rate of turn in units that do not fit; what no unit explains may be what a diagnosis looks for."""
    found = CHECKS["heading rate"](run, ship)
    return found if found is not None and found.changes else None


def _heading_unit(run: Recording, ship: Particulars) -> str | None:
    """A heading that hardly changes while the ship turns: radians among degrees."""
    numbers, turned = run["psi"] / DEGREE, _turned(run, ship)
    if np.ptp(numbers) > 7 or turned < 0.8 * TURNED or np.ptp(run["psi"]) > 0.5 * turned:
        return None
    if not 0.6 < np.ptp(np.unwrap(numbers)) / turned < 1.6:
        return None
    return (
        f"psi stays within {np.ptp(numbers):.3g} deg while the ship turns through {turned / DEGREE:.0f} deg: psi looks "
        "like radians"
    )


def _stuck_rudder(run: Recording, ship: Particulars) -> str | None:
    """A rudder that rests while the ship goes through a turn."""
    moved, turned = float(np.ptp(run["delta"])), float(np.ptp(run["psi"]))
    if moved > STUCK or turned < AROUND:
        return None
    return (
        f"the rudder stays within {moved / DEGREE:.2g} deg while the ship turns through {turned / DEGREE:.0f} deg: "
        "delta is missing or its sensor stuck, and without it nothing can be decided"
    )


def _course(run: Recording, ship: Particulars) -> str | None:
    """A ship that does not go where it heads."""
    way = _way(run, ship)
    off = float(np.median(np.abs(np.angle(np.exp(1j * (way - run["psi"]))))))
    rates = [
        np.gradient(smoothed(run.time, angle, WINDOW * ship.time_unit)[0], run.time) for angle in (way, run["psi"])
    ]
    mirrored = np.ptp(run["psi"]) > TURNED and np.corrcoef(*rates)[0, 1] < -0.5
    if off < 60 * DEGREE and not mirrored:
        return None
    said = "turns to the other side than the heading" if mirrored else f"is {off / DEGREE:.0f} deg off the heading"
    return (
        f"the course over ground {said} most of the time: x is north and y east, cog and psi are clockwise from north: "
        "exchange or turn round those that are not"
    )


def _log_unit(run: Recording, ship: Particulars) -> str | None:
    """The log in another unit than the speed over ground."""
    del ship
    if "u_log" not in run.channels:
        return None
    ratio = float(np.median(run["u_log"]) / max(np.median(np.hypot(run["vn"], run["ve"])), 1e-9))
    for known, cause in LOGS.items():
        if abs(ratio / known - 1) < 0.12:
            return f"u_log is {ratio:.2f} times the speed over ground: {cause}"
    return None


def _shaft_unit(run: Recording, ship: Particulars) -> str | None:
    """Shaft speed in revolutions per second, or of another ship."""
    if "shaft_recorded" not in run.channels:
        return None
    ratio = float(np.median(run["shaft_recorded"]))
    if 0.1 < ratio < 5:
        return None
    return (
        f"n is {ratio * ship.rpm:.3g} rpm; nominal for the {ship.name} is {ship.rpm:g} rpm: mind the unit of n, or "
        "write the nominal one as rpm="
    )


def _way(run: Recording, ship: Particulars) -> Float[np.ndarray, " n"]:
    """Course over ground without jumps, by the track where it was recorded [rad]."""
    window = WINDOW * ship.time_unit
    if "x" in run.meta["derived"]:
        north, east = (smoothed(run.time, run[k], window)[0] for k in ("vn", "ve"))
    else:
        north, east = (smoothed(run.time, run[k], window)[1] for k in ("x", "y"))
    return np.unwrap(np.arctan2(east, north))


def _turned(run: Recording, ship: Particulars) -> float:
    """Angle that the ship turns through by track or gyro, whichever says more [rad]."""
    speed = np.hypot(run["vn"], run["ve"])
    way = _way(run, ship)[speed > 0.2 * np.quantile(speed, 0.95)]
    # A gyro's constant error is no turn.
    yaw = cumulative_trapezoid(run["r"] - np.median(run["r"]), run.time, initial=0.0)
    return float(max(np.ptp(way), np.ptp(yaw)))
