"""Zigzag (Kempf) trials."""

from collections.abc import Sequence

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage, check_degrees, check_duration, set_of, side_sign
from manoeuvre_nn.core.units import DEGREE

MAX_EXECUTES = 1000
"""Most rudder executes of a trial."""
UNLIMITED = 60
"""Executes that no record of ordinary length reaches."""
OVERSHOOT_LENGTHS = 200.0
"""Ship lengths at approach speed in which 2.5 cycles at 5 deg of rudder are over, with the approach before."""
MIXED_LENGTHS = 40.0
"""Ship lengths sailed at approach speed in which an ordinary ship has gone through all angles of a mixed zigzag."""


def zigzag(
    rudder_deg: float,
    heading_deg: float | None = None,
    first: str = "starboard",
    executes: int | None = None,
    duration: float | None = None,
    start_deg: float = 0.0,
    name: str | None = None,
) -> Manoeuvre:
    """A zigzag: rudder over until the heading has changed by an angle, then to the other side, and so on.

    Args:
        rudder_deg: Rudder angle [deg].
        heading_deg: Change of heading at which the rudder is reversed [deg]; by default the rudder angle.
        first: Side of the first execute.
        executes: Number of rudder executes; after the last one the rudder goes amidships. None repeats to the end.
        duration: Length of the trial [s]; by default the ship's usual record.
        start_deg: Heading that the trial is about, relative to the heading at the start [deg].
        name: Short name; by default ``zz20`` or ``zz20_10``.

    Returns:
        The manoeuvre.

    Raises:
        InputError: If an angle, the side, the duration or the number of executes makes no sense.

    Source:
        IMO MSC/Circ.1053, section 2; Wang 1996, section 3.2.
    """
    rudder = check_degrees("manoeuvre rudder_deg", rudder_deg)
    heading = rudder if heading_deg is None else check_degrees("manoeuvre heading_deg", heading_deg)
    sign = side_sign("manoeuvre first", first)
    check_duration("manoeuvre duration", duration)
    if executes is not None and not 1 <= executes <= MAX_EXECUTES:
        raise InputError(f"manoeuvre executes={executes}: expected 1 to {MAX_EXECUTES}")
    turns = [sign * (-1) ** k for k in range(executes or UNLIMITED)]
    about = start_deg * DEGREE
    stages = [Stage(side * rudder, heading=about + side * heading, direction=side) for side in turns]
    if name is None:
        name = f"zz{rudder_deg:g}" + ("" if heading_deg in {None, rudder_deg} else f"_{heading_deg:g}")
        name += "_port" if sign < 0 else ""
    return Manoeuvre(name, "zigzag", (*stages, Stage(0.0)), duration=duration)


def overshoot(
    rudder_deg: float, first: str = "starboard", approach: float = 60.0, cycles: float = 2.5, name: str | None = None
) -> Manoeuvre:
    """A horizontal overshoot manoeuvre as navies run it: a steady approach, then a zigzag of some cycles.

    Args:
        rudder_deg: Entrance and checking angle of the rudder, and change of heading at which it is reversed [deg].
        first: Side of the first execute.
        approach: Time on a steady course from the start of the record (COMEX) to the order (EXECUTE) [s].
        cycles: Cycles of two executes after which the trial is over: halves too.
        name: Short name; by default ``overshoot20``, to port first ``overshoot20_port``.

    Returns:
        The manoeuvre.

    Raises:
        InputError: If the cycles are not half or whole numbers from a half.

    Source:
        Stenson & Hundley 1989, as described by Hess & Faller 2000.
    """
    check_duration("manoeuvre approach", approach)
    executes = round(2 * cycles) if abs(cycles) < MAX_EXECUTES else 0
    if executes < 1 or abs(executes - 2 * cycles) > 1e-9:
        raise InputError(f"manoeuvre cycles={cycles}: expected half or whole cycles, .5 or more")
    made = zigzag(rudder_deg, first=first, executes=executes)
    port = "_port" if made.stages[0].order < 0 else ""
    stages = (Stage(0.0, hold=approach), *made.stages)
    return Manoeuvre(
        name or f"overshoot{rudder_deg:g}{port}", "zigzag", stages, ship_lengths=OVERSHOOT_LENGTHS, ends=True
    )


def overshoots(
    rudder_deg: Sequence[float] = (10.0, 20.0), speed_kn: Sequence[float] = (8.0, 12.0, 16.0), first: str = "both",
    approach: float = 60.0, cycles: float = 2.5,
) -> list[Manoeuvre]:  # fmt: skip
    """Horizontal overshoots with every rudder angle at every approach speed.

    Args:
        rudder_deg: Rudder angles [deg].
        speed_kn: Approach speeds [kn].
        first: Side of the first execute: starboard, port or both.
        approach: As of :func:`overshoot` [s].
        cycles: Likewise.

    Returns:
        The manoeuvres, named ``overshoot20_12kn``.
    """
    return set_of(lambda angle, one: overshoot(angle, one, approach, cycles), rudder_deg, speed_kn, first)


def mixed_zigzag(
    rudder_deg: Sequence[float] = (5.0, 10.0, 15.0, 20.0, 25.0),
    heading_deg: Sequence[float] | None = None,
    first: str = "starboard",
    duration: float | None = None,
    name: str | None = None,
) -> Manoeuvre:
    """A zigzag whose angles change from cycle to cycle, and then begin anew.

    No IMO trial, but made to be learnt from: a zigzag of one angle shows a ship on one loop of v, r and rudder only, a
    mixed one fills what lies within.

    Args:
        rudder_deg: Rudder angle of each cycle, an execute to either side [deg].
        heading_deg: Change of heading at which the rudder is reversed, cycle by cycle [deg]; by default the rudder
            angles.
        first: Side of the first execute.
        duration: Length of the trial [s]; by default 40 L/U0.
        name: Short name; by default ``zz5to25`` after the first and the last angle.

    Returns:
        The manoeuvre.

    Raises:
        InputError: If there is no angle, or an angle, the side or the duration makes no sense.
    """
    if not rudder_deg or len(heading_deg or rudder_deg) != len(rudder_deg):
        raise InputError(
            f"manoeuvre rudder_deg={list(rudder_deg)}, heading_deg={heading_deg and list(heading_deg)}: expected "
            "angles, and as many of the one as of the other"
        )
    rudders = [check_degrees("manoeuvre rudder_deg", angle) for angle in rudder_deg]
    headings = [check_degrees("manoeuvre heading_deg", angle) for angle in heading_deg or rudder_deg]
    sign = side_sign("manoeuvre first", first)
    check_duration("manoeuvre duration", duration)
    cycle = [
        Stage(side * rudder, heading=side * heading, direction=side)
        for rudder, heading in zip(rudders, headings, strict=True)
        for side in (sign, -sign)
    ]
    stages = (*(cycle * (UNLIMITED // len(cycle) + 1)), Stage(0.0))
    name = name or f"zz{rudder_deg[0]:g}to{rudder_deg[-1]:g}" + ("_port" if sign < 0 else "")
    return Manoeuvre(name, "mixed_zigzag", stages, duration=duration, ship_lengths=MIXED_LENGTHS)
