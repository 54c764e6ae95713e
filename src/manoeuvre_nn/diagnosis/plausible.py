"""Units, signs and frames of a run, judged from the run itself before anything is fitted."""

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
from manoeuvre_nn.diagnosis.sheet import Sheet
from manoeuvre_nn.recording.accelerations import WINDOW, smoothed
from manoeuvre_nn.recording.checks import frame, rudder_sign, rudder_stop, rudder_unit, speed_size, speed_unit

TURNED = 20 * DEGREE
"""Change of heading from which rates and frames can be compared."""
RATES = {
    1 / DEGREE: "r looks like rad/s",
    1 / 60: "r looks like deg/min",
    -1.0: "psi or r has the other sign (both are positive clockwise)",
}
"""Rate of the heading over r -> what was mistaken."""
LOGS = {1 / KNOT: "u_log looks like knots", 3.6: "u_log looks like km/h"}
"""Logged speed over speed over ground -> what was mistaken."""
UNITS = "t in s, x_north, y_east in m, sog, u, v, u_log in m/s, cog, psi, delta in deg, r in deg/s, n in rpm"
REMEDY = f"csv columns are {UNITS}; for others give mapping=FILE.yaml"
STUCK, AROUND = 0.5 * DEGREE, 45 * DEGREE
"""A rudder that moves less, in a run that turns through more, was not recorded."""
Check = Callable[[Recording, Particulars], object | None]
"""Whatever it finds reads as a sentence."""


def check_sheet(sheet: Sheet, ship: Particulars, remedy: str = REMEDY) -> None:
    """Refuse a run whose units, signs or frames do not fit each other or the ship.

    Args:
        sheet: The run as it came.
        ship: The ship.
        remedy: What to do about a wrong column.

    Raises:
        InputError: With the first finding.
    """
    clean = _without_spikes(sheet, ship)
    checks: tuple[Check, ...] = (
        heading_unit,
        stuck_rudder,
        rudder_unit,
        rudder_stop,
        log_unit,
        shaft_unit,
        speed_unit,
        speed_size,
    )
    if (
        max(_turned(clean, ship), np.ptp(clean["psi"])) > TURNED
    ):  # on a straight course there is little but noise to compare
        checks += (rate_unit, frame)
    for check in (*checks, course, rudder_sign):
        finding = check(clean, ship)
        if finding is not None:
            raise InputError(f"{sheet.name}: {finding}" + ("" if check is rudder_sign else f"; {remedy}"))


def _without_spikes(sheet: Sheet, ship: Particulars) -> Recording:
    """The run as a recording: gaps filled, single-sample outliers taken out, what is lacking derived."""
    c = {k: median_filter(sheet.filled(k), 5, mode="nearest") for k in sheet.channels}
    derived = {"u"} if "vn" in sheet.derived else set()
    c["u"], c["v"] = earth_to_body(c["vn"], c["ve"], c["psi"])
    if "r" not in c:
        c["r"] = smoothed(sheet.time, c["psi"], WINDOW * ship.time_unit)[1]
        derived.add("r")
    if "x" not in c:
        c["x"], c["y"] = (cumulative_trapezoid(c[k], sheet.time, initial=0.0) for k in ("vn", "ve"))
        derived.add("x")
    return Recording(sheet.name, sheet.time, c, meta={"derived": tuple(derived)})


def heading_unit(run: Recording, ship: Particulars) -> str | None:
    """A heading that hardly changes while the ship turns: radians among degrees.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
    numbers, turned = run["psi"] / DEGREE, _turned(run, ship)
    if np.ptp(numbers) > 7 or turned < 0.8 * TURNED or np.ptp(run["psi"]) > 0.5 * turned:
        return None
    if not 0.6 < np.ptp(np.unwrap(numbers)) / turned < 1.6:
        return None
    return (
        f"psi stays within {np.ptp(numbers):.3g} deg while the ship turns through {turned / DEGREE:.0f} deg: psi looks "
        "like radians"
    )


def stuck_rudder(run: Recording, ship: Particulars) -> str | None:
    """A rudder that rests while the ship goes through a turn.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
    moved, turned = float(np.ptp(run["delta"])), float(np.ptp(run["psi"]))
    if moved > STUCK or turned < AROUND:
        return None
    return (
        f"the rudder stays within {moved / DEGREE:.2g} deg while the ship turns through {turned / DEGREE:.0f} deg: "
        "delta is missing or its sensor stuck, and without it nothing can be decided"
    )


def rate_unit(run: Recording, ship: Particulars) -> str | None:
    """The rate of the heading against r: units and signs of both.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
    if "r" in run.meta["derived"]:
        return None
    window = WINDOW * ship.time_unit
    r, rate = smoothed(run.time, run["r"], window)[0], smoothed(run.time, run["psi"], window)[1]
    centred = _ratio(rate - rate.mean(), r - r.mean())  # a constant error of the gyro is no wrong unit
    ratio = _ratio(rate, r)
    if min(abs(ratio - 1), abs(centred - 1)) < 0.4:
        return None
    known = min(RATES, key=lambda k: abs(np.log(max(abs(ratio), 1e-9) / abs(k))) + 10 * (ratio * k < 0))
    if np.ptp(run["psi"]) < 7 * DEGREE:
        cause = "psi looks like radians"
    elif 0.7 < ratio / known < 1.4:
        cause = RATES[known]
    else:
        return None  # no unit does that: it may be what is looked for
    return f"the heading changes {ratio:.3g} times as fast as r says: {cause}"


def _ratio(rate: Float[np.ndarray, " n"], r: Float[np.ndarray, " n"]) -> float:
    """By the sizes for the unit and by the product for the sign: unlike a slope it bears noise in both."""
    return float(np.sqrt(np.sum(rate**2) / max(np.sum(r**2), 1e-30)) * np.sign(np.sum(rate * r)))


def course(run: Recording, ship: Particulars) -> str | None:
    """A ship that does not go where it heads.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
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


def log_unit(run: Recording, ship: Particulars) -> str | None:
    """The log in another unit than the speed over ground.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
    del ship
    if "u_log" not in run.channels:
        return None
    ratio = float(np.median(run["u_log"]) / max(np.median(np.hypot(run["vn"], run["ve"])), 1e-9))
    for known, cause in LOGS.items():
        if abs(ratio / known - 1) < 0.12:
            return f"u_log is {ratio:.2f} times the speed over ground: {cause}"
    return None


def shaft_unit(run: Recording, ship: Particulars) -> str | None:
    """Shaft speed in revolutions per second, or of another ship.

    Args:
        run: The run.
        ship: The ship.

    Returns:
        The finding, or None.
    """
    if "n" not in run.channels:
        return None
    ratio = float(np.median(run["n"]))
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
