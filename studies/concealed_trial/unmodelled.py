"""Effects that no list holds: made up for the trial, so that ``unknown`` has something to be right about.

Forces are in units of 0.5 rho L T U0^2 (moments with L); ``b = v/U0``, ``q = r L/U0``.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from studies.concealed_trial.forces import Force, Moment
from studies.concealed_trial.ships import TrialShip

Shape = Callable[[TrialShip, Mapping[str, float], Moment], np.ndarray]


def _turn_rate(ship: TrialShip, now: Moment) -> np.ndarray:
    """Yaw rate r L/U0."""
    return now.r * ship.length / ship.speed


def _cubic_by_heading(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """Y grows with r^3 and changes its sign six times in a full turn."""
    return p["a"] * _turn_rate(ship, now) ** 3 * np.cos(3 * now.psi)


def _lopsided_turn(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A yaw moment that only turns to starboard meet."""
    q = np.maximum(_turn_rate(ship, now), 0.0)
    return p["a"] * q * q


def _beat(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A yaw moment with a period of its own."""
    return np.full(now.u.shape, p["a"] * np.sin(2 * np.pi * now.t / p["period_s"]))


def _turn_drag(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A resistance that grows with the yaw rate and the speed."""
    return -p["a"] * np.abs(_turn_rate(ship, now)) * now.u / ship.speed


def _by_speed(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A yaw moment that grows with the third power of the speed."""
    return p["a"] * (now.u / ship.speed) ** 3 * now.v / ship.speed


def _striped_water(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A side force tied to the place: stripes across the sea."""
    across = np.radians(p["stripes_deg"])
    place = now.x * np.cos(across) + now.y * np.sin(across)
    return p["a"] * np.sin(2 * np.pi * place / p["spacing_m"])


def _sway_beat(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A side force with a period of its own."""
    return _beat(ship, p, now)


def _late_turn(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A yaw moment that remembers: it follows the yaw rate behind a lag."""
    return p["a"] * np.asarray(now.lagged)


def _growing(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A force that grows with the time of the run; ``a`` is what it is after ten minutes."""
    return np.full(now.u.shape, p["a"] * np.maximum(now.t, 0.0) / 600.0)


def _damped_drift(ship: TrialShip, p: Mapping[str, float], now: Moment) -> np.ndarray:
    """A side force of drift and turn together, whatever their signs."""
    return p["a"] * np.abs(_turn_rate(ship, now)) * np.abs(now.v) / ship.speed


FORCES: dict[str, tuple[str, Shape]] = {
    "cubic_by_heading": ("Y", _cubic_by_heading),
    "lopsided_turn": ("N", _lopsided_turn),
    "beat": ("N", _beat),
    "turn_drag": ("X", _turn_drag),
    "by_speed": ("N", _by_speed),
    "striped_water": ("Y", _striped_water),
    "damped_drift": ("Y", _damped_drift),
    "sway_beat": ("Y", _sway_beat),
    "late_turn": ("N", _late_turn),
    "growing_push": ("Y", _growing),
    "growing_drag": ("X", lambda ship, p, now: -_growing(ship, p, now)),
    "random_push": ("Y", lambda ship, p, now: np.full(now.u.shape, p["a"])),
    "random_moment": ("N", lambda ship, p, now: np.full(now.u.shape, p["a"])),
}
"""Equation and shape of the forces."""

RANDOM = ("random_push", "random_moment")
"""Forces with a random course (Ornstein-Uhlenbeck) of standard deviation ``a``; nobody can predict them."""
LONGEST_RUN = 4000
"""Length of their series [s]."""

RUDDERS = ("rudder_hole", "weak_to_port")
"""Rudders that do less than their angle says."""

SENSORS: dict[str, str] = {
    "compass_two_beats": "sensor:psi",
    "log_by_heading": "sensor:u_log",
    "position_runs_away": "sensor:x_north",
    "rate_scale": "sensor:r",
}
"""Channels that are wrong in a way of their own."""


def random_course(chance: float, tau: float, runs: Sequence[str]) -> np.ndarray:
    """Ornstein-Uhlenbeck courses of standard deviation 1, the same for the same run.

    Args:
        chance: Seed.
        tau: Correlation time [s].
        runs: Names of the runs.

    Returns:
        One row a second, one column a run.
    """
    memory = float(np.exp(-1 / tau))
    columns = []
    for run in runs:
        white = np.random.default_rng([int(chance), *run.encode()]).standard_normal(LONGEST_RUN)
        columns.append(lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white))
    return np.stack(columns, axis=1)


def unmodelled_force(ship: TrialShip, detail: str, parameters: Mapping[str, float], runs: Sequence[str] = ()) -> Force:
    """The force of an effect that no list holds.

    Args:
        ship: The ship.
        detail: A name of :data:`FORCES`.
        parameters: Its ``a`` and what else it needs.
        runs: Names of the runs, which a random course needs.

    Returns:
        The force.
    """
    equation, shape = FORCES[detail]
    course = random_course(parameters["chance"], parameters["tau_s"], runs) if detail in RANDOM else None
    row = "XYN".index(equation)
    unit = ship.force_unit * (ship.length if equation == "N" else 1.0)

    def force(now: Moment) -> np.ndarray:
        rows = np.zeros((3, now.u.size))
        rows[row] = unit * shape(ship, parameters, now)
        if course is not None:
            rows[row] *= course[min(max(int(float(now.t)), 0), len(course) - 1)]
        return rows

    return force


def felt_angle(detail: str, parameters: Mapping[str, float], d: np.ndarray) -> np.ndarray:
    """The rudder angle that the water feels.

    Args:
        detail: A name of :data:`RUDDERS`.
        parameters: ``a``, the share that is lost.
        d: Angle of the blade [rad], positive to port.

    Returns:
        Angle that acts [rad].
    """
    if detail == "rudder_hole":  # between 8 and 14 deg, with soft edges
        depth = np.clip(np.minimum(np.abs(d) - np.radians(7.5), np.radians(14.5) - np.abs(d)) / np.radians(0.5), 0, 1)
        return d * (1 - parameters["a"] * depth)
    return np.where(d > 0, (1 - parameters["a"]) * d, d)
