"""The direct (Dieudonne) spiral."""

import numpy as np

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage, check_count, check_degrees, check_duration, side_sign
from manoeuvre_nn.core.units import DEGREE


def spiral(
    rudder_deg: float = 20.0,
    step_deg: float = 5.0,
    hold: float = 60.0,
    first: str = "starboard",
    name: str | None = None,
) -> Manoeuvre:
    """A spiral: rudder over, then in steps to the other side and back, each angle held for a time.

    With a short hold the yaw rate lags behind and even a stable ship draws a loop; the neutral part is only trustworthy
    when a longer hold gives the same.

    Args:
        rudder_deg: Largest rudder angle [deg].
        step_deg: Step between rudder angles [deg].
        hold: Time for which each angle is held [s].
        first: Side of the first rudder angle.
        name: Short name; by default ``spiral20``.

    Returns:
        The manoeuvre, as long as all its holds.

    Raises:
        InputError: If the step does not divide the largest angle.

    Source:
        Dieudonne 1953; Wang 1996, section 3.5 (20 deg, steps of 5 deg, 60 s).
    """
    check_degrees("manoeuvre rudder_deg", rudder_deg)
    check_degrees("manoeuvre step_deg", step_deg, rudder_deg)
    check_duration("manoeuvre hold", hold)
    check_count(f"manoeuvre step_deg={step_deg}", 4 * rudder_deg / step_deg)
    steps = round(rudder_deg / step_deg)
    if abs(steps * step_deg - rudder_deg) > 1e-9:
        raise InputError(f"manoeuvre step_deg={step_deg} does not divide rudder_deg={rudder_deg}")
    down = np.arange(steps, -steps - 1, -1) * step_deg
    angles = side_sign("manoeuvre first", first) * np.concatenate([down, down[-2::-1]]) * DEGREE
    stages = tuple(Stage(float(angle), hold=hold) for angle in angles)
    return Manoeuvre(name or f"spiral{rudder_deg:g}", "spiral", stages, duration=hold * len(stages))
