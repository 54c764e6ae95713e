"""What the helmsman does: a list of rudder orders, each with the event that ends it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.plain_text import check_name
from manoeuvre_nn.core.units import DEGREE, KNOT

MAX_DURATION_S, MAX_TURN_DEG, MAX_ORDERS = 1e6, 36000.0, 100_000
"""Longest trial [s], largest change of heading in it [deg], most rudder orders."""


@dataclass(frozen=True)
class Stage:
    """One rudder order and when it ends: at a heading, after a time, or never.

    Attributes:
        order: Rudder angle ordered [rad], positive to starboard.
        heading: Change of heading since the start that ends the stage [rad]; None if it does not matter.
        direction: +1 if the heading must rise to that value, -1 if it must fall to it.
        hold: Time after which the stage ends [s]; None if it does not matter.
    """

    order: float
    heading: float | None = None
    direction: int = 1
    hold: float | None = None


@dataclass(frozen=True)
class Manoeuvre:
    """A steering trial as the helmsman knows it.

    Attributes:
        name: Short name (``zz20``, ``tc25``).
        kind: Family (``zigzag``, ``turning_circle``, ...), which decides what criteria are read off.
        stages: Orders in turn; the last one is held to the end.
        duration: Length [s]; None takes the family's usual one, see :meth:`duration_for`.
        ship_lengths: The family's usual length as a multiple of L/U0; None is the ship's usual record.
        speed: Approach speed [m/s]; None is the ship's own.
        rudder_split: Half of what the starboard rudder of two has more than the port one, throughout [rad].
        shaft_split: Likewise of two shafts, over the nominal shaft speed [-].
        ends: Whether the trial is over when its last stage begins; else it lasts for its duration.
    """

    name: str
    kind: str
    stages: tuple[Stage, ...]
    duration: float | None = None
    ship_lengths: float | None = None
    speed: float | None = None
    rudder_split: float = 0.0
    shaft_split: float = 0.0
    ends: bool = False

    def __post_init__(self) -> None:
        """Refuse a name that no file can be called after."""
        check_name("manoeuvre: name", self.name)

    @property
    def largest_order(self) -> float:
        """Largest rudder angle that is ordered [rad]."""
        return max(abs(stage.order) for stage in self.stages) + abs(self.rudder_split)

    def duration_for(self, ship: Particulars) -> float:
        """Length of the trial on a ship [s]; turning circles end where the coefficient set stops making sense."""
        if self.duration is not None:
            return self.duration
        usual = ship.record_length if self.ship_lengths is None else self.ship_lengths * ship.time_unit
        return min(usual, ship.longest_turn) if self.kind == "turning_circle" else usual

    def at_speed(self, speed: float | None) -> "Manoeuvre":
        """The same trial from another approach speed [m/s]; None leaves it."""
        return self if speed is None else replace(self, speed=speed)

    def end(self, time: Float[np.ndarray, " n"], orders: Float[np.ndarray, " n"]) -> float:
        """When a run is over.

        Args:
            time: Sample times [s].
            orders: Rudder orders [rad].

        Returns:
            Time of the last sample before the last stage [s]; the last time where the trial has no such end or did not
            come to it.
        """
        if not self.ends:
            return float(time[-1])
        wanted = np.array([stage.order for stage in self.stages])
        changed = np.flatnonzero(np.diff(orders)) + 1
        count = np.count_nonzero(np.diff(wanted))
        return float(time[changed[count - 1] - 1] if count and len(changed) >= count else time[-1])

    def check(self, ship: Particulars) -> None:
        """Refuse what the ship's steering gear cannot do.

        Args:
            ship: The ship.

        Raises:
            InputError: If an order goes beyond the rudder stop.
        """
        if self.largest_order > ship.rudder_limit + 1e-9:
            raise InputError(
                f"manoeuvre {self.name} orders {self.largest_order / DEGREE:.4g} deg of rudder; the {ship.name} stops "
                f"at {ship.rudder_limit / DEGREE:.4g} deg: write a smaller rudder_deg"
            )


def check_degrees(what: str, value: float, largest: float = 90.0) -> float:
    """Read an angle that was given in degrees.

    Args:
        what: The setting's name, for the message.
        value: What was given [deg].
        largest: Largest sensible value [deg].

    Returns:
        The angle [rad].

    Raises:
        InputError: If it is not between 0 and ``largest``.
    """
    if not 0 < value <= largest:
        raise InputError(f"{what}={value}: expected an angle in degrees between 0 and {largest:g}")
    return value * DEGREE


def side_sign(what: str, side: object) -> int:
    """Sign of a side.

    Args:
        what: The setting's name, for the message.
        side: ``starboard`` or ``port``.

    Returns:
        +1 for starboard, -1 for port.

    Raises:
        InputError: If it is neither.
    """
    if not isinstance(side, str) or side not in {"starboard", "port"}:
        raise InputError(f"{what}={side!r}: write starboard or port")
    return 1 if side == "starboard" else -1


def set_of(
    trial: Callable[[float, str], Manoeuvre], rudder_deg: Sequence[float], speed_kn: Sequence[float], side: str
) -> list[Manoeuvre]:
    """A trial with every rudder angle at every approach speed.

    Args:
        trial: Rudder angle [deg] and side -> the trial.
        rudder_deg: Rudder angles [deg].
        speed_kn: Approach speeds [kn].
        side: starboard, port or both.

    Returns:
        The trials, their speed behind the name.

    Raises:
        InputError: If a speed is not positive or the side is none of these.
    """
    if side not in {"starboard", "port", "both"}:
        raise InputError(f"manoeuvre side={side!r}: write starboard, port or both")
    if not all(speed > 0 for speed in speed_kn):
        raise InputError(f"manoeuvre speed_kn={list(speed_kn)}: expected approach speeds in knots, more than 0")
    sides = ("starboard", "port") if side == "both" else (side,)
    made = [(trial(angle, one), speed) for speed in speed_kn for angle in rudder_deg for one in sides]
    return [replace(m, name=f"{m.name}_{speed:g}kn", speed=speed * KNOT) for m, speed in made]


def check_duration(what: str, value: float | None) -> None:
    """Refuse a time that is not positive.

    Args:
        what: The setting's name, for the message.
        value: Time [s] or None.

    Raises:
        InputError: If it is zero or negative, or longer than any trial.
    """
    if value is not None and not 0 < value <= MAX_DURATION_S:
        raise InputError(f"{what}={value}: expected a time in seconds, more than 0 and up to {MAX_DURATION_S:g}")


def check_turn(turn_deg: float) -> None:
    """Refuse a change of heading in degrees that is not positive, or that no ship comes to."""
    if not 0 < turn_deg <= MAX_TURN_DEG:
        raise InputError(
            f"manoeuvre turn_deg={turn_deg}: expected a change of heading in degrees, more than 0 and up to "
            f"{MAX_TURN_DEG:g}"
        )


def check_count(what: str, count: float) -> None:
    """Refuse more rudder orders than a trial has."""
    if not count <= MAX_ORDERS:
        raise InputError(f"{what} makes {count:.3g} rudder orders; expected {MAX_ORDERS} at most")
