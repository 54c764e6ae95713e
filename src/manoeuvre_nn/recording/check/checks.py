"""The table of checks of units, signs and frames: run before anything is fitted, each where it applies."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter

from manoeuvre_nn.core.channels import MOTION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.check import axes, order, units
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.check.weighed import Bounds, strong_current, weighed
from manoeuvre_nn.recording.holes import MOTION_SENSORS, holes
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed

FIT, DIAGNOSIS = "fit", "diagnosis"
"""Where a check applies: to a recording that a model is fitted to or that ``manoeuvre check`` looks at, complete and in
body axes; to one that is diagnosed, where velocities are over ground and effects may act that no model has yet."""
BOTH = (FIT, DIAGNOSIS)


class _Check(NamedTuple):
    """A check, where it applies, whether a wrong column of the file may be what it finds, whether it looks at noise."""

    find: Callable[[Recording, Particulars], Finding | None]
    where: tuple[str, ...]
    of_columns: bool = True
    of_noise: bool = False


CHECKS = (
    _Check(order.no_order, BOTH, of_noise=True),
    _Check(units.heading_unit, (DIAGNOSIS,)),
    _Check(units.stuck_rudder, (DIAGNOSIS,)),
    _Check(units.rudder_unit, BOTH),
    _Check(units.rudder_stop, BOTH),
    _Check(units.log_unit, BOTH),
    _Check(units.shaft_unit, (DIAGNOSIS,)),
    _Check(units.speed_unit, BOTH),
    _Check(axes.course_of_track, (FIT,)),
    _Check(units.speed_size, BOTH),
    _Check(axes.heading_rate, (FIT,)),
    _Check(axes.heading_rate_in_turns, (DIAGNOSIS,)),
    _Check(axes.frame, (FIT,)),
    _Check(axes.frame_in_turns, (DIAGNOSIS,)),
    _Check(axes.course, (DIAGNOSIS,)),
    _Check(axes.rudder_sign, BOTH, of_columns=False),
)
"""In the order in which a finding is reported: a wrong unit explains what a later check would find."""
COLUMNS = (
    "csv columns are t in s, x_north, y_east in m, sog, u, v, u_log in m/s, cog, psi, delta in deg, r in deg/s, n in "
    "rpm; for others give mapping=FILE.yaml"
)
"""What to do about a wrong unit where no mapping was given."""
NOTHING = Bounds()
"""No effect explains anything."""
MIN_LENGTH = 4.0
"""Shortest run that a diagnosis can use, over L/U0: the state at the end of the warm-up takes half of it."""
MAX_STEP = 0.25
"""Longest time between samples that a diagnosis can use, over L/U0."""
MAX_LOST_RUDDER, MAX_UNEVEN = 0.2, 0.2
"""Largest share of empty cells in the rudder angle, and of times between samples that are far from the usual one."""


def first_finding(recording: Recording, ship: Particulars) -> tuple[Finding, bool] | None:
    """What the first check finds that finds anything, and whether a wrong column may be the cause."""
    for check in CHECKS:
        finding = check.find(recording, ship) if FIT in check.where else None
        if finding is not None:
            return finding, check.of_columns
    return None


def check_recording(recording: Recording, ship: Particulars) -> None:
    """Refuse a recording whose units, signs or frames do not fit each other or the ship.

    Args:
        recording: As read.
        ship: The ship.

    Raises:
        InputError: With the first finding.
    """
    lacking = [name for name in MOTION if name not in recording.channels]
    if lacking:
        raise InputError(
            f"recording {recording.name} has no {', '.join(lacking)}: a mapping of kind: record serves to look at it; "
            "a model needs u, v, r, x, y, psi and delta"
        )
    found = first_finding(recording, ship)
    if found is not None:
        raise InputError(f"recording {recording.name}: {found[0]}")


def check_over_ground(
    recordings: Sequence[Recording], ship: Particulars, remedy: str = COLUMNS, bounds: Bounds = NOTHING
) -> list[tuple[str, ...]]:
    """Refuse runs for a diagnosis whose units, signs or frames do not fit each other or the ship.

    Args:
        recordings: Runs of one recorder, from :func:`~manoeuvre_nn.recording.preparation.over_ground`.
        ship: The ship.
        remedy: What to do about a wrong column.
        bounds: How far effects go that could explain a finding.

    Returns:
        For each run, findings that an effect could explain, a clause each.

    Raises:
        InputError: With the first finding that none explains.
    """
    runs = [_without_spikes(recording, ship) for recording in recordings]
    notes = []
    for raw, run in zip(recordings, runs, strict=True):
        said = [strong_current(run, ship)]
        for check in CHECKS:
            looked_at = raw if check.of_noise else run
            found = check.find(looked_at, ship) if DIAGNOSIS in check.where else None
            finding = None if found is None else weighed(found, run, ship, bounds, runs)
            if finding is not None and finding.trips:
                raise InputError(f"{run.name}: {finding}" + (f"; {remedy}" if check.of_columns else ""))
            said.append(finding)
        notes.append(tuple(finding.text for finding in said if finding is not None))
    return notes


def check_sampling(run: Recording, ship: Particulars) -> None:
    """Refuse a run that is too short, too coarse or too uneven for a diagnosis, or lacks much of its rudder angle.

    Args:
        run: As recorded, gaps as NaN.
        ship: For L/U0.

    Raises:
        InputError: If it is.
    """
    steps, unit, usual = np.diff(run.time), ship.time_unit, run.step
    if run.duration < MIN_LENGTH * unit:
        raise InputError(
            f"{run.name}: too short a record: {len(run)} samples over {run.duration:.4g} s; a diagnosis of the "
            f"{ship.name} needs at least {MIN_LENGTH * unit:.0f} s ({MIN_LENGTH:g} L/U0): give a longer one, t in s"
        )
    if usual > MAX_STEP * unit:
        raise InputError(
            f"{run.name}: samples are {usual:.4g} s apart; the {ship.name} needs one every {MAX_STEP * unit:.2g} s or "
            "more often: sample faster, with t in s"
        )
    uneven = float(np.mean(np.abs(steps - usual) > 0.5 * usual))
    if uneven > MAX_UNEVEN:
        raise InputError(
            f"{run.name}: {uneven:.0%} of the times between samples are more than half off the usual {usual:.3g} s: "
            "write samples at even times"
        )
    written = np.any([np.isfinite(values) for values in run.channels.values()], axis=0)
    in_holes = sum(end - begin for begin, end in holes(run.time, written, usual))
    if run.duration - in_holes < MIN_LENGTH * unit:
        raise InputError(
            f"{run.name}: only {run.duration - in_holes:.4g} s of {run.duration:.4g} s were recorded, the rest are "
            f"holes; a diagnosis of the {ship.name} needs {MIN_LENGTH * unit:.0f} s ({MIN_LENGTH:g} L/U0)"
        )
    rudder = [np.isfinite(run[name]) for name in ("delta", "delta_order") if name in run.channels]
    lost = 1 - float(np.mean(np.any(rudder, axis=0)[written])) if rudder else 0.0
    if lost > MAX_LOST_RUDDER:
        raise InputError(f"{run.name}: {lost:.0%} of delta is empty; a diagnosis needs the rudder throughout")


def _without_spikes(recording: Recording, ship: Particulars) -> Recording:
    """The run as a recording: gaps filled, short spikes taken out by a running median, what is lacking derived."""
    # Where no sensor of the motion wrote anything down there is nothing to check.
    seen = np.any([np.isfinite(recording[k]) for k in MOTION_SENSORS if k in recording.channels], axis=0)
    if not seen.all():
        kept = {k: values[seen] for k, values in recording.channels.items()}
        recording = replace(recording, time=recording.time[seen], channels=kept)
    c = {k: median_filter(recording.filled(k), 5, mode="nearest") for k in recording.channels}
    derived = {"u"} if "vn" in recording.derived else set()
    c["u"], c["v"] = earth_to_body(c["vn"], c["ve"], c["psi"])
    if "r" not in c:
        c["r"] = smoothed(recording.time, c["psi"], WINDOW * ship.time_unit)[1]
        derived.add("r")
    if "x" not in c:
        c["x"], c["y"] = (cumulative_trapezoid(c[k], recording.time, initial=0.0) for k in ("vn", "ve"))
        derived.add("x")
    meta = {"derived": tuple(derived), "kind": recording.meta.get("kind", "")}
    return Recording(recording.name, recording.time, c, meta=meta)
