"""The manoeuvrability standards of IMO resolution MSC.137(76)."""

import re
from collections.abc import Mapping
from typing import Any

from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE

TRIAL = re.compile(r"(?P<family>tc|zz)(?P<angle>[0-9.]+)(_(?P<heading>[0-9.]+))?(_port|_starboard)?")
"""Names that say the angles: ``tc35``, ``tc35_port``, ``zz10``, ``zz20_10``."""
NO_VERDICT = "not judged: the resolution asks for {}"
"""Verdict on a trial at another angle than the resolution's."""


def overshoot_limits(time_unit: float) -> tuple[float, float, float]:
    """Largest overshoots that are allowed.

    ``5 + L/V / 2`` and ``17.5 + .75 L/V`` in the 10/10 zigzag, constant below 10 s and from 30 s on; 25 deg in the
    20/20 zigzag.

    Args:
        time_unit: L/V of the trial [s].

    Returns:
        First and second overshoot of the 10/10 zigzag, first overshoot of the 20/20 zigzag [deg].

    Source:
        IMO MSC.137(76), 5.3.3.
    """
    bounded = min(max(time_unit, 10.0), 30.0)
    return 5 + 0.5 * bounded, 17.5 + 0.75 * bounded, 25.0


def imo_table(values: Mapping[str, Mapping[str, float]], ship: Particulars) -> list[dict[str, Any]]:
    """Hold the criteria of trials against the resolution.

    Only what was run is in the table. Turning circles are judged at 35 deg of rudder or the ship's stop, zigzags at
    10/10 and 20/20 deg; trials at other angles are listed with the limit of the nearest such trial, but not judged.

    Args:
        values: Name of the trial (``tc35``, ``zz10``, ``zz20_port``) -> its criteria.
        ship: The ship, for L/V and the rudder stop.

    Returns:
        One row a criterion, in the order of the trials: ``criterion`` with the trial's name and the unit, ``value``,
        ``limit`` (the largest value that is allowed) and ``verdict``: ``met``, ``not met``, or why it is not judged.

    Source:
        IMO MSC.137(76), 5.3: advance 4.5 L and tactical diameter 5 L; initial turning 2.5 L; overshoots as in
        :func:`overshoot_limits`. The resolution asks for deep water, full load and at least 90 % of the speed at 85 %
        of the engine's output; whether a trial was made so is for its reader to see.
    """
    return [row for name, found in values.items() for row in _rows(name, found, ship)]


def _rows(name: str, found: Mapping[str, float], ship: Particulars) -> list[dict[str, Any]]:
    """The rows of one trial; none if the resolution has nothing to say about its family."""
    first, second, first_20 = overshoot_limits(ship.time_unit)
    zigzag_10 = {"initial_turning_L": 2.5, "overshoot_1_deg": first, "overshoot_2_deg": second}
    parts = TRIAL.fullmatch(name)
    if parts is None:
        return []
    family, angle, heading = parts["family"], float(parts["angle"]), float(parts["heading"] or parts["angle"])
    hardest = min(35.0, ship.rudder_limit / DEGREE)
    if family == "tc":
        limits, wanted = {"advance_L": 4.5, "tactical_diameter_L": 5.0}, f"{hardest:.3g} deg of rudder"
        asked = abs(angle - hardest) < 0.5
    else:
        limits = {"overshoot_1_deg": first_20} if angle > 15 else zigzag_10
        wanted, asked = "10/10 and 20/20 zigzags", angle == heading and angle in {10.0, 20.0}
    other = None if asked else NO_VERDICT.format(wanted)
    rows = []
    for key, limit in limits.items():
        if key in found:
            verdict = other or ("met" if found[key] <= limit else "not met")
            rows.append({"criterion": f"{name} {key}", "value": found[key], "limit": limit, "verdict": verdict})
    return rows
