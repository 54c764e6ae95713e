"""What checks compare: smoothed velocities and those of the track, the course, and how far a ship turns."""

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.thinning import thinned

ALONG, ASIDE = 30 * DEGREE, 60 * DEGREE
"""Angle off her heading within which a ship goes, drift and current counted, and from which she does not."""
TURNED = 20 * DEGREE
"""Change of heading from which the rates and frames of a run with unknown effects can be compared."""

Series = Float[np.ndarray, " n"]


def smoothed_motion(recording: Recording, ship: Particulars) -> Recording:
    """What a recording says of the ship's motion, by local cubics.

    Returns:
        The recording, thinned: u, v [m/s], r [rad/s], psi [rad] smoothed; besides, psidot [rad/s], xdot, ydot [m/s] and
        the speed [m/s].
    """
    recording = thinned(recording, ship)
    time, window = recording.time, WINDOW * ship.time_unit
    values = {k: smoothed(time, recording[k], window)[0] for k in ("u", "v", "r")}
    values["psi"], psidot = smoothed(time, recording["psi"], window)
    (_, xdot), (_, ydot) = (smoothed(time, recording[k], window) for k in ("x", "y"))
    speed = np.maximum(np.hypot(values["u"], values["v"]), 1e-9)
    return recording.with_channels(**values, psidot=psidot, xdot=xdot, ydot=ydot, speed=speed)


def course_over_ground(run: Recording, ship: Particulars) -> Series:
    """Course over ground without jumps, by the track where it was recorded [rad]."""
    names, order = (("vn", "ve"), 0) if "x" in run.derived else (("x", "y"), 1)
    north, east = (smoothed(run.time, run[k], WINDOW * ship.time_unit)[order] for k in names)
    return np.unwrap(np.arctan2(east, north))


def off_course(way: Series, heading: Series) -> float:
    """Median angle between the way of a ship and what is said to be her heading [rad]."""
    return float(np.median(np.abs(np.angle(np.exp(1j * (way - heading))))))


def angle_turned(run: Recording, ship: Particulars) -> float:
    """Angle that the ship turns through by track or gyro, whichever says more [rad]."""
    speed = np.hypot(run["vn"], run["ve"])
    way = course_over_ground(run, ship)[speed > 0.2 * np.quantile(speed, 0.95)]
    # A gyro's constant error is no turn.
    yaw = cumulative_trapezoid(run["r"] - np.median(run["r"]), run.time, initial=0.0)
    return float(max(np.ptp(way), np.ptp(yaw)))
