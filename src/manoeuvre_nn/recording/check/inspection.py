"""All checks of a file or a recording, before anything is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from manoeuvre_nn.core.channels import MOTION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.check.checks import first_finding
from manoeuvre_nn.recording.check.fault_findings import fault_finding
from manoeuvre_nn.recording.check.file_checks import file_findings
from manoeuvre_nn.recording.check.finding import Finding, worst
from manoeuvre_nn.recording.check.heel import heel_findings, side_findings
from manoeuvre_nn.recording.check.samples import Flags, gaps, outliers, quantized, sampling, stuck, without_outliers
from manoeuvre_nn.recording.check.sensor_faults import measure_faults
from manoeuvre_nn.recording.check.steering import rudder_jumps, rudder_lag, steady_approach
from manoeuvre_nn.recording.check.turn_drift import turn_drift
from manoeuvre_nn.recording.read.mapping import Mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.recording.thinning import thinned

MAX_LINES = 5
"""Findings that a summary tells, before it says how many more there are."""
STANDING = 0.05
"""Share of the record for which channels may stand still when delays and offsets are measured."""


@dataclass(frozen=True)
class Inspection:
    """What all checks say of one recording.

    Attributes:
        name: Its name.
        findings: One or more a check, in the order of the checks.
        recording: As read; None for a file that cannot be read.
        flags: Channel -> samples that are odd.
    """

    name: str
    findings: tuple[Finding, ...]
    recording: Recording | None = None
    flags: Flags = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The gravest."""
        return worst(self.findings)

    @property
    def clean(self) -> Recording | None:
        """The recording with outliers filled."""
        return None if self.recording is None else without_outliers(self.recording, self.flags)


def inspect_file(path: str | Path, mapping: Mapping, ship: Particulars) -> Inspection:
    """Check a file: what it holds, sample by sample, and what its channels say of each other.

    Args:
        path: The file.
        mapping: Columns, units, signs.
        ship: The ship.

    Returns:
        What was found. Nothing is raised for a bad file: what cannot be used has the verdict ``refuse``.
    """
    path = Path(path)
    broken = file_findings(path, mapping, ship)
    try:
        recording = read_recording(path, mapping, ship)
        plain = _as_written(mapping)
        written = recording if plain == mapping else read_recording(path, plain, ship)
    except InputError as error:
        known = [f for f in broken if f.verdict == "refuse"]
        return Inspection(path.stem, tuple(known or [*broken, Finding("file", "refuse", str(error))]))
    is_cut = mapping.start is not None or any(c.delay for c in mapping.channels.values())
    since = recording.meta["started"] - _first_time(path, mapping, ship) if is_cut else 0.0
    recording = replace(recording, meta={**recording.meta, "since": since})
    found = inspect_recording(recording, ship, written, mapping)
    return replace(found, findings=(*broken, *found.findings))


def inspect_recording(
    recording: Recording, ship: Particulars, written: Recording | None = None, mapping: Mapping | None = None
) -> Inspection:
    """Check a recording.

    Args:
        recording: The recording.
        ship: The ship.
        written: The same before its columns were turned, shifted and carried to midship; None is the recording.
        mapping: The mapping that it was read with.

    Returns:
        What was found. Where units or frames are wrong nothing else is looked at: a wrong unit explains it.
    """
    lacking = [name for name in MOTION if name not in recording.channels]
    if lacking:
        text = f"no {', '.join(lacking)} in the file: nothing to compare"
        refused = Finding("channels", "refuse", text, remedy="map u, v, r, x, y, psi, delta")
        return Inspection(recording.name, (refused,))
    written = recording if written is None else written
    missing, (wild, flags) = gaps(recording, ship), outliers(written)
    same = len(written) == len(recording)
    shifted = flags if same else {k: np.interp(recording.time, written.time, f) > 0.5 for k, f in flags.items()}
    clean = without_outliers(recording, shifted)
    found = [sampling(recording, ship), missing, wild]
    gross = first_finding(clean, ship)
    if gross is not None:
        return Inspection(recording.name, (*found, gross[0]), recording, shifted)
    plain, fewer = without_outliers(written, flags), thinned(clean, ship)
    still = stuck(plain, ship)
    fits = "units, signs, axes and the rudder's side fit each other and the ship"
    found += [*still, *quantized(plain, ship), Finding("units, signs, frame", "ok", fits)]
    # Much of a channel that stands still, or a hole, would be taken for a fault of the sensors.
    standing = sum(b - a for f in still for a, b in f.spans) / recording.duration
    if standing < STANDING and not missing.trips:
        found += [fault_finding(fault, mapping) for fault in measure_faults(fewer, ship)]
    lag = rudder_lag(fewer, ship)
    found += [rudder_jumps(clean, ship), *([] if lag is None else [lag]), steady_approach(fewer, ship)]
    found += [*turn_drift(fewer), *heel_findings(clean, ship), *side_findings(clean)]
    return Inspection(recording.name, tuple(found), recording, shifted)


def summary_lines(inspections: Sequence[Inspection]) -> list[str]:
    """What is worth a look before training, a line each: findings that ask for something, then how many more."""
    said = [f"{i.name}: {f}" for i in inspections for f in i.findings if f.trips]
    more = [f"{len(said) - MAX_LINES} more: manoeuvre check shows them all"] if len(said) > MAX_LINES else []
    return [*said[:MAX_LINES], *more]


def _as_written(mapping: Mapping) -> Mapping:
    """The mapping without what moves, turns or carries channels."""
    plain = {k: replace(c, delay=0.0) for k, c in mapping.channels.items()}
    return replace(
        mapping, channels=plain, frame="body", reference_point=0.0, position_point=None, rudder="angle", drift="keep"
    )


def _first_time(path: Path, mapping: Mapping, ship: Particulars) -> float:
    """Time of the file's first sample [s]."""
    whole = replace(_as_written(mapping), start=None)
    try:
        return float(read_recording(path, whole, ship).meta["started"])
    except InputError:  # what lies before the start cannot be read
        return float(read_recording(path, mapping, ship).meta["started"]) - (mapping.start or 0.0)
