"""What checks compare: smoothed velocities and those of the track, the course, and how far a ship turns."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.thinning import thinned

TURNED = 20 * DEGREE
"""Change of heading from which the rates and frames of a run with unknown effects can be compared."""

Series = Float[np.ndarray, " n"]


class SmoothedMotion(NamedTuple):
    """Smoothed u, v [m/s], r [rad/s], psi [rad] and its rate [rad/s], the rates of x and y, the speed [m/s]."""

    u: Series
    v: Series
    r: Series
    psi: Series
    psi_rate: Series
    x: Series
    y: Series
    speed: Series


def smoothed_motion(recording: Recording, ship: Particulars) -> SmoothedMotion:
    """What a recording says of the ship's motion, by local cubics."""
    recording = thinned(recording, ship)
    smooth = {
        k: smoothed(recording.time, recording[k], WINDOW * ship.time_unit) for k in ("u", "v", "r", "psi", "x", "y")
    }
    u, v, r, psi = (smooth[k][0] for k in ("u", "v", "r", "psi"))
    psi_rate, x, y = (smooth[k][1] for k in ("psi", "x", "y"))
    return SmoothedMotion(u, v, r, psi, psi_rate, x, y, np.maximum(np.hypot(u, v), 1e-9))


def course_over_ground(run: Recording, ship: Particulars) -> Series:
    """Course over ground without jumps, by the track where it was recorded [rad]."""
    names, order = (("vn", "ve"), 0) if "x" in run.derived else (("x", "y"), 1)
    north, east = (smoothed(run.time, run[k], WINDOW * ship.time_unit)[order] for k in names)
    return np.unwrap(np.arctan2(east, north))


def angle_turned(run: Recording, ship: Particulars) -> float:
    """Angle that the ship turns through by track or gyro, whichever says more [rad]."""
    speed = np.hypot(run["vn"], run["ve"])
    way = course_over_ground(run, ship)[speed > 0.2 * np.quantile(speed, 0.95)]
    # A gyro's constant error is no turn.
    yaw = cumulative_trapezoid(run["r"] - np.median(run["r"]), run.time, initial=0.0)
    return float(max(np.ptp(way), np.ptp(yaw)))
