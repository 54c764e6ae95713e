"""Check of turning circles: at what velocity the turns move over ground."""

import numpy as np

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import Finding, number
from manoeuvre_nn.recording.drift import MAX_ERROR, drift_by_arcs
from manoeuvre_nn.recording.kind import guess_kind

CHECK = "drift in the turn"
MATTERS = 0.02
"""Drift that matters, over the speed of the ship [-]."""
MIN_SIGMAS = 3.0
"""Standard errors from which on a drift is one."""


def is_circle(recording: Recording) -> bool:
    """Whether a recording is a turning circle, by what it says or by its rudder."""
    return (recording.meta.get("kind") or guess_kind(recording.filled("delta"))) == "turning_circle"


def turn_drift(recording: Recording) -> list[Finding]:
    """The drift that a turning circle implies; nothing for other manoeuvres, and those without positions of their own.

    Args:
        recording: The recording, without outliers.

    Returns:
        One finding: a note where the circle drifts, for wind and current are no fault of a file.
    """
    if not is_circle(recording) or "x" in recording.derived:
        return []
    try:
        drift = drift_by_arcs(recording)
    except InputError as error:
        return [Finding(CHECK, "ok", str(error).removeprefix(f"recording {recording.name}: "))]
    matters = MATTERS * float(np.nanmedian(np.hypot(recording["u"], recording["v"])))
    size = number(drift.speed, drift.speed_error, "m/s")
    toward = number(drift.toward_deg, drift.toward_error_deg, "deg")
    first, last = (angle / DEGREE for angle in drift.headings)
    text = f"the turns move over ground by {size} towards {toward} (arcs one turn apart, {first:.0f} to {last:.0f} deg)"
    moves = drift.speed > max(MIN_SIGMAS * drift.speed_error, matters)
    remedy = ""
    if drift.error > MAX_ERROR:
        text += f"; uncertain, {drift.error:.1%} of the diameter in a turn: it is not steady, or too short"
    elif moves:
        remedy = "to take it away write drift: arcs"
    return [
        Finding(
            CHECK, "note" if moves else "ok", text, channels=("x", "y"), measured=drift.speed, error=drift.speed_error,
            unit="m/s", expected=f"below {matters:.2g} m/s", remedy=remedy,
        )
    ]  # fmt: skip
