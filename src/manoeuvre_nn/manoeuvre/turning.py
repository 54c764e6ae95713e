"""Turning circle and pull-out."""

from collections.abc import Sequence
from math import pi

from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage, check_degrees, check_duration, check_turn, set_of, side_sign

TACTICAL_LENGTHS = 200.0
"""Ship lengths at approach speed in which a circle of 540 deg is over at 5 deg of rudder, with the approach before."""
CIRCLE_LENGTHS = 30.0
"""Ship lengths sailed at approach speed in which an ordinary ship turns well past 360 deg at 25 deg of rudder."""


def turning_circle(
    rudder_deg: float, side: str = "starboard", duration: float | None = None, name: str | None = None
) -> Manoeuvre:
    """A turning circle: rudder over and held.

    Args:
        rudder_deg: Rudder angle [deg].
        side: Side of the turn.
        duration: Length of the trial [s]; by default 30 L/U0.
        name: Short name; by default ``tc25``, to port ``tc25_port``.

    Returns:
        The manoeuvre.

    Source:
        IMO MSC/Circ.1053, section 2; Wang 1996, section 3.4.
    """
    rudder = check_degrees("manoeuvre rudder_deg", rudder_deg)
    sign = side_sign("manoeuvre side", side)
    check_duration("manoeuvre duration", duration)
    name = name or f"tc{rudder_deg:g}" + ("_port" if sign < 0 else "")
    return Manoeuvre(name, "turning_circle", (Stage(sign * rudder),), duration=duration, ship_lengths=CIRCLE_LENGTHS)


def tactical_circle(
    rudder_deg: float, side: str = "starboard", approach: float = 60.0, turn_deg: float = 540.0, name: str | None = None
) -> Manoeuvre:
    """A tactical circle as navies run it: a steady approach, then the rudder held until the heading has come round.

    Args:
        rudder_deg: Rudder angle [deg].
        side: Side of the turn.
        approach: Time on a steady course from the start of the record (COMEX) to the order (EXECUTE) [s].
        turn_deg: Change of heading at which the trial is over [deg].
        name: Short name; by default ``circle35``, to port ``circle35_port``.

    Returns:
        The manoeuvre.

    Source:
        Stenson & Hundley 1989, as described by Hess & Faller 2000.
    """
    rudder = check_degrees("manoeuvre rudder_deg", rudder_deg)
    sign = side_sign("manoeuvre side", side)
    check_duration("manoeuvre approach", approach)
    check_turn(turn_deg)
    turn = Stage(sign * rudder, heading=sign * turn_deg * pi / 180, direction=sign)
    name = name or f"circle{rudder_deg:g}" + ("_port" if sign < 0 else "")
    stages = (Stage(0.0, hold=approach), turn, Stage(0.0))
    return Manoeuvre(name, "turning_circle", stages, ship_lengths=TACTICAL_LENGTHS, ends=True)


def tactical_circles(
    rudder_deg: Sequence[float] = (10.0, 20.0, 35.0), speed_kn: Sequence[float] = (12.0, 20.0),
    side: str = "both", approach: float = 60.0, turn_deg: float = 540.0,
) -> list[Manoeuvre]:  # fmt: skip
    """Tactical circles with every rudder angle at every approach speed.

    Args:
        rudder_deg: Rudder angles [deg].
        speed_kn: Approach speeds [kn].
        side: Side of the turn: starboard, port or both.
        approach: As of :func:`tactical_circle` [s].
        turn_deg: Likewise [deg].

    Returns:
        The manoeuvres, named ``circle35_20kn``.
    """
    return set_of(lambda angle, one: tactical_circle(angle, one, approach, turn_deg), rudder_deg, speed_kn, side)


def pull_out(
    rudder_deg: float,
    side: str = "starboard",
    turn_deg: float = 270.0,
    coast: float | None = None,
    name: str | None = None,
) -> Manoeuvre:
    """A pull-out: a turn, then the rudder amidships while the rate of turn dies out.

    A ship that keeps turning is not straight-line stable; one that settles on the same rate after a turn to either side
    is.

    Args:
        rudder_deg: Rudder angle of the turn [deg].
        side: Side of the turn.
        turn_deg: Change of heading at which the rudder goes amidships [deg].
        coast: Length of the whole trial [s]; by default 40 L/U0.
        name: Short name; by default ``pullout20``.

    Returns:
        The manoeuvre.

    Source:
        Burcher 1972; IMO MSC/Circ.1053, section 4.
    """
    rudder = check_degrees("manoeuvre rudder_deg", rudder_deg)
    sign = side_sign("manoeuvre side", side)
    check_duration("manoeuvre coast", coast)
    check_turn(turn_deg)
    turn = Stage(sign * rudder, heading=sign * turn_deg * pi / 180, direction=sign)
    name = name or f"pullout{rudder_deg:g}" + ("_port" if sign < 0 else "")
    return Manoeuvre(name, "pull_out", (turn, Stage(0.0)), duration=coast, ship_lengths=40.0)
