"""The manoeuvrability standards of IMO resolution MSC.137(76)."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import held_angle, reversal_times, trace

NO_VERDICT = "not judged: the resolution asks for {}, this is {}"
"""Verdict on a trial at another angle than the resolution's."""
RUDDER_DEG, HEADING_DEG = 1.0, 2.0
"""How far a trial may be from the angles of the resolution to be judged as such [deg]: rudders are read off to a
degree; headings at which the order is given are those of a helmsman, who sees them turn by a degree a second."""
CIRCLE = {"advance_L": 4.5, "tactical_diameter_L": 5.0}
"""Limits for turning circles, 5.3.1."""


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


def imo_table(
    trials: Iterable[tuple[Recording, Mapping[str, float]]],
    ship: Particulars,
    missed: Mapping[str, str] = MappingProxyType({}),
) -> list[dict[str, Any]]:
    """Hold the criteria of trials against the resolution.

    Only what was run is in the table. Turning circles are judged at 35 deg of rudder or the ship's stop, zigzags at
    10/10 and 20/20 deg; trials at other angles are listed with the limit of the nearest such trial, but not judged. The
    angles are those that were recorded, whatever the trial is called.

    Args:
        trials: How each trial was sailed (rudder and heading, family in ``meta["kind"]``), and its criteria.
        ship: The ship, for L/V and the rudder stop.
        missed: Names of trials that a model does not predict -> why: its criteria there are not judged.

    Returns:
        One row a criterion, in the order of the trials: ``criterion`` with the trial's name and the unit, ``value``,
        ``limit`` (the largest value that is allowed) and ``verdict``: ``met``, ``not met``, or why it is not judged.

    Source:
        IMO MSC.137(76), 5.3: advance 4.5 L and tactical diameter 5 L; initial turning 2.5 L; overshoots as in
        :func:`overshoot_limits`. The resolution asks for deep water, full load and at least 90 % of the speed at 85 %
        of the engine's output; whether a trial was made so is for its reader to see.
    """
    return [row for trial, found in trials for row in _rows(trial, found, ship, missed.get(trial.name, ""))]


def _steered_by(recording: Recording, family: str) -> tuple[float, float] | None:
    """Recorded rudder angle of a circle or zigzag, and the heading at which it was reversed [rad].

    Returns:
        The heading of a circle is 0; None for other families, and where no rudder was laid or reversed.
    """
    seen = trace(recording) if family in {"turning_circle", "zigzag"} else None
    reversals = reversal_times(seen)[0] if seen and family == "zigzag" else []
    if seen is None or (family == "zigzag" and not reversals):
        return None
    heading = float(np.median(np.abs(seen.turn(np.array(reversals))))) if reversals else 0.0
    return held_angle(np.abs(seen.rudder)), heading


def _rows(recording: Recording, found: Mapping[str, float], ship: Particulars, missed: str) -> list[dict[str, Any]]:
    """The rows of one trial; none if the resolution has nothing to say about its family."""
    first, second, first_20 = overshoot_limits(ship.time_unit)
    zigzag_10 = {"initial_turning_L": 2.5, "overshoot_1_deg": first, "overshoot_2_deg": second}
    family = str(recording.meta.get("kind", ""))
    angles = _steered_by(recording, family)
    if angles is None:
        return []
    rudder, heading = (angle / DEGREE for angle in angles)
    if family == "turning_circle":
        hardest = min(35.0, ship.rudder_limit / DEGREE)
        limits, wanted, asked = CIRCLE, f"{hardest:.3g} deg of rudder", abs(rudder - hardest) <= RUDDER_DEG
        sailed = f"{rudder:.3g}"
    else:
        limits = {"overshoot_1_deg": first_20} if rudder > 15 else zigzag_10
        wanted, sailed = "10/10 and 20/20 zigzags", f"{rudder:.3g}/{heading:.3g}"
        near = [abs(rudder - angle) <= RUDDER_DEG and abs(heading - angle) <= HEADING_DEG for angle in (10.0, 20.0)]
        asked = any(near)
    other = None if asked else NO_VERDICT.format(wanted, sailed)
    other = f"not judged: the model {missed}" if missed else other
    rows = []
    for key, limit in limits.items():
        if key in found:
            verdict = other or ("met" if found[key] <= limit else "not met")
            rows.append({
                "criterion": f"{recording.name} {key}", "value": found[key], "limit": limit, "verdict": verdict
            })  # fmt: skip
    return rows
