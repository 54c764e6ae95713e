"""Zigzag (Kempf) trials."""

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage, check_degrees, check_duration, side_sign
from manoeuvre_nn.core.units import DEGREE

UNLIMITED = 60
"""Executes that no record of ordinary length reaches."""


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
    if executes is not None and executes < 1:
        raise InputError(f"manoeuvre executes={executes}: expected at least 1")
    turns = [sign * (-1) ** k for k in range(executes or UNLIMITED)]
    about = start_deg * DEGREE
    stages = [Stage(side * rudder, heading=about + side * heading, direction=side) for side in turns]
    if name is None:
        name = f"zz{rudder_deg:g}" + ("" if heading_deg in {None, rudder_deg} else f"_{heading_deg:g}")
        name += "_port" if sign < 0 else ""
    return Manoeuvre(name, "zigzag", (*stages, Stage(0.0)), duration=duration)
