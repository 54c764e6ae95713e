"""Who steers: an autopilot on a straight course, then the manoeuvre; and the gear between the order and the blade.

Angles are in rad, positive to **port** as in the recordings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import Gear

MANOEUVRE_START = 60.0
"""When the manoeuvre begins [s]."""
SPIRAL_DEG = (-15.0, -10.0, -6.0, -3.0, 0.0, 3.0, 6.0, 10.0, 15.0, 6.0, 0.0, -6.0, -15.0)
"""Held rudder angles of the spiral."""
PULL_OUT = float(np.radians(60.0))
"""Turn after which the rudder of a pull-out is put amidships [rad]."""
SPIRAL_STEP = 60.0
"""How long each is held [s]."""


@dataclass(frozen=True)
class Run:
    """One run of a case.

    Attributes:
        name: ``r01`` and so on.
        split: ``fit`` or ``held_out``.
        manoeuvre: ``tcNN``, ``zzNN``, ``poNN`` (pull-out: a turn of 60 deg, then rudder amidships), ``straight`` or
            ``spiral``.
        first_turn: ``port``, ``starboard``, or None for a spiral.
        heading_deg: Heading of the approach by the ship's compass.
        duration: Length of the recording [s].
        share: Approach speed and shaft speed over the nominal ones.
    """

    name: str
    split: str
    manoeuvre: str
    first_turn: str | None
    heading_deg: float
    duration: int
    share: float = 1.0

    @property
    def angle(self) -> float:
        """NN with the sign of the first order [rad]; 0 for a spiral and a straight run."""
        if self.manoeuvre in {"spiral", "straight"}:
            return 0.0
        return float(np.radians(float(self.manoeuvre[2:]))) * (1.0 if self.first_turn == "port" else -1.0)


class TrialHelm:
    """The orders of all runs."""

    def __init__(self, ship: TrialShip, runs: Sequence[Run]) -> None:
        """Set the courses.

        Args:
            ship: The ship; its L/U0 sets the autopilot.
            runs: The runs.
        """
        self.course = np.radians([run.heading_deg for run in runs])
        self.angle = np.array([run.angle for run in runs])
        self.side = np.sign(self.angle)
        self.zigzag = np.array([run.manoeuvre.startswith("zz") for run in runs])
        self.spiral = np.array([run.manoeuvre == "spiral" for run in runs])
        self.pull_out = np.array([run.manoeuvre.startswith("po") for run in runs])
        self.time_unit = ship.length / ship.speed
        self.integral = np.zeros(len(runs))

    def order(self, t: float, heading: np.ndarray, rate: np.ndarray, step: float) -> np.ndarray:
        """The order of this step.

        Args:
            t: Time [s].
            heading: What the compass shows [rad].
            rate: Yaw rate [rad/s].
            step: Time step [s].

        Returns:
            Order [rad] for each run.
        """
        if t < MANOEUVRE_START - 1e-9:
            return self._hold_course(heading, rate, step)
        swung = -(heading - self.course) * self.side  # positive when on the side that the first order turns to
        self.side = np.where(self.zigzag & (swung >= np.abs(self.angle)), -self.side, self.side)
        self.side = np.where(self.pull_out & (swung >= PULL_OUT), 0.0, self.side)
        held = min(int((t - MANOEUVRE_START + 1e-9) / SPIRAL_STEP), len(SPIRAL_DEG) - 1)
        return np.where(self.spiral, np.radians(SPIRAL_DEG[held]), np.abs(self.angle) * self.side)

    def _hold_course(self, heading: np.ndarray, rate: np.ndarray, step: float) -> np.ndarray:
        """A PID autopilot; the integral is what the ship needs to run straight."""
        error = heading - self.course
        self.integral = self.integral + step * error * 0.2 / self.time_unit
        self.integral = np.clip(self.integral, -np.radians(15), np.radians(15))
        return np.clip(1.5 * error + 3.0 * self.time_unit * rate + self.integral, -0.5, 0.5)


class SteeringGear:
    """Indicator and blade of all runs.

    Attributes:
        indicator: Angle that the follow-up shows [rad].
        blade: Angle of the blade [rad].
    """

    def __init__(self, gear: Gear, rate: float, start: np.ndarray) -> None:
        """Put indicator and blade where they are.

        Args:
            gear: What is wrong.
            rate: Rate of the gear [rad/s].
            start: First angle of the indicator [rad].
        """
        self.gear, self.rate = gear, rate
        self.indicator, self.driven, self.moved = start.copy(), start.copy(), start.copy()

    @property
    def blade(self) -> np.ndarray:
        """Angle of the blade [rad]."""
        return self.moved + self.gear.offset

    def advance(self, order: np.ndarray, step: float) -> None:
        """Move for one step.

        Args:
            order: Order [rad].
            step: Time step [s].
        """
        self.indicator = _towards(order, self.indicator, self.rate * step)
        slow = self.gear.slow_rate
        self.driven = self.indicator if slow is None else _towards(order, self.driven, slow * step)
        self.moved = play(self.moved, self.driven, self.gear.play)

    def show(self, indicator: np.ndarray, order: np.ndarray, step: float) -> None:
        """Move for one step with an indicator that is known.

        Args:
            indicator: Angle shown [rad].
            order: Order [rad].
            step: Time step [s].
        """
        slow = self.gear.slow_rate
        self.driven = indicator if slow is None else _towards(order, self.driven, slow * step)
        self.indicator, self.moved = indicator, play(self.moved, self.driven, self.gear.play)


def play(output: np.ndarray, given: np.ndarray, width: float) -> np.ndarray:
    """The play operator: the output rests until the input has taken up the play.

    Args:
        output: Last output.
        given: Input.
        width: Total play.

    Returns:
        New output, at most half the play from the input.
    """
    return np.clip(output, given - 0.5 * width, given + 0.5 * width)


def _towards(target: np.ndarray, value: np.ndarray, most: float) -> np.ndarray:
    """A value that moves towards its target by at most so much."""
    return value + np.clip(target - value, -most, most)
