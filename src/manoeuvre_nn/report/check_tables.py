"""What the checks of recordings say, as tables and JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.check.finding import VERDICTS, Finding, finding_json, number, settings
from manoeuvre_nn.recording.check.inspection import Inspection
from manoeuvre_nn.recording.check.turn_drift import CHECK
from manoeuvre_nn.recording.drift import drift_by_arcs, track_less_velocities
from manoeuvre_nn.recording.read.mapping import Mapping as ChannelMapping


def finding_rows(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Checks of one recording, one row a finding."""
    return [
        {
            "check": f.check,
            "verdict": f.verdict,
            "measured": number(f.measured, f.error, f.unit),
            "expected": f.expected or "–",
            "what, and what to do": str(f),
        }
        for f in findings
    ]


def trouble_rows(inspections: Sequence[Inspection], least: str = "note") -> list[dict[str, Any]]:
    """What is wrong with several recordings: one row a finding of at least a verdict; the first names the recording."""
    rows = []
    for one in inspections:
        grave = [f for f in one.findings if VERDICTS.index(f.verdict) >= VERDICTS.index(least)]
        rows += [
            {
                "recording": "" if k else one.name,
                "check": f.check,
                "verdict": f.verdict,
                "what, and what to do": str(f),
            }
            for k, f in enumerate(grave)
        ]
    return rows


def overview_rows(inspections: Sequence[Inspection]) -> list[dict[str, Any]]:
    """One row a recording: verdict, how many findings of each kind, and the checks that trip."""
    return [
        {
            "recording": one.name,
            "verdict": one.verdict,
            **{v: sum(f.verdict == v for f in one.findings) for v in reversed(VERDICTS)},
            "to be done": ", ".join(dict.fromkeys(f.check for f in one.findings if f.trips)) or "–",
        }
        for one in inspections
    ]


def together_rows(inspections: Sequence[Inspection]) -> list[dict[str, Any]]:
    """Delays, offsets, scales and points over all recordings: a sensor's fault is the same in each.

    Args:
        inspections: What was found.

    Returns:
        One row a fault: in how many recordings it was found, mean weighted by the errors, its standard error (from the
        scatter where that is larger), and the scatter over what the errors explain. None for a single recording.
    """
    measured: dict[str, list[Finding]] = {}
    for one in inspections:
        for f in one.findings:
            if f.measured is not None and f.error and np.isfinite(f.error) and " of " in f.check:
                measured.setdefault(f.check, []).append(f)
    return [_together(name, fs, len(inspections)) for name, fs in measured.items() if len(fs) > 1]


def _together(name: str, findings: Sequence[Finding], count: int) -> dict[str, Any]:
    """Mean of one fault."""
    values, errors = np.array([[f.measured, f.error] for f in findings], dtype=float).T
    weight = 1 / np.maximum(errors, 1e-12) ** 2
    mean = float((weight * values).sum() / weight.sum())
    scatter = float(np.sqrt((weight * (values - mean) ** 2).sum() / (len(values) - 1)))
    error = float(weight.sum() ** -0.5) * max(scatter, 1.0)
    found = sum(f.verdict != "ok" for f in findings)
    return {
        "fault": name,
        "found in": f"{found} of {count}",
        "mean": number(mean, error, findings[0].unit),
        "median": float(np.median(values)),
        "scatter / error": scatter,
        "matters from": findings[0].expected.removeprefix("below "),
    }


def drift_rows(inspections: Sequence[Inspection]) -> list[dict[str, Any]]:
    """The drift that every turning circle implies, beside what its file says of current and wind; a row a circle."""
    return [
        _drift_row(one.name, one.clean)
        for one in inspections
        if one.clean is not None and any(f.check == CHECK and f.measured is not None for f in one.findings)
    ]


def _drift_row(name: str, recording: Recording) -> dict[str, Any]:
    """One circle: drift by its arcs with standard errors; track less u and v; mean of the recorded wind."""
    drift, left = drift_by_arcs(recording), track_less_velocities(recording)
    wind = "–"
    if {"wind_speed", "wind_from"} <= set(recording.channels):
        mean = np.nanmean(recording["wind_speed"] * np.exp(1j * recording["wind_from"]))
        wind = f"{abs(mean):.3g} m/s from {np.angle(mean, deg=True) % 360:.0f} deg"
    return {
        "recording": name,
        "drift by arcs": number(drift.speed, drift.speed_error, "m/s"),
        "towards": number(drift.toward_deg, drift.toward_error_deg, "deg"),
        "error in a turn [% of diameter]": round(100 * drift.error, 2),
        "track less u, v": "–" if left is None else _as_compass(*left),
        "wind, mean": wind,
    }


def _as_compass(north: float, east: float) -> str:
    """A velocity as speed and direction."""
    return f"{np.hypot(north, east):.3g} m/s towards {np.degrees(np.arctan2(east, north)) % 360:.0f} deg"


def remedy_rows(inspections: Sequence[Inspection], mapping: ChannelMapping) -> list[dict[str, Any]]:
    """What is to be written into the mapping, one row a recording that something is to be done about."""
    laid = {one.name: _changes(one, mapping) for one in inspections}
    return [
        {"recording": name, "settings": "; ".join(f"{path}: {_yaml(value)}" for path, value in changes.items())}
        for name, changes in laid.items()
        if changes
    ]


def _changes(one: Inspection, mapping: ChannelMapping) -> dict[str, Any]:
    """Settings of the mapping that mend a recording."""
    return settings([f for f in one.findings if f.trips], mapping)


def _yaml(value: object) -> str:
    """A value as yaml has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return "null" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def sentence(inspections: Sequence[Inspection]) -> str:
    """The verdict on all recordings, in a sentence."""
    count = {v: sum(one.verdict == v for one in inspections) for v in VERDICTS}
    total = f"{len(inspections)} recording{'s' if len(inspections) != 1 else ''}"
    usable = count["ok"] + count["note"]
    if usable == len(inspections):
        return f"{total}: {'all' if usable != 1 else 'it'} can be used {_as_it_is(usable)}."
    parts = [f"{usable} can be used {_as_it_is(usable)}"] if usable else []
    parts += [f"{count['mend']} should be mended first"] if count["mend"] else []
    parts += [f"{count['refuse']} cannot be used {_as_it_is(count['refuse'])}"] if count["refuse"] else []
    return f"{total}: {', '.join(parts)}."


def _as_it_is(count: int) -> str:
    """Of one or of several."""
    return "as it is" if count == 1 else "as they are"


def checks_json(
    inspections: Sequence[Inspection],
    mapping: ChannelMapping,
    more: Sequence[Finding],
    versions: Mapping[str, str],
) -> dict[str, Any]:
    """What ``findings.json`` holds; ``more`` are findings on all recordings together, ``changes`` path -> value."""
    return {
        "recordings": {
            one.name: {
                "verdict": one.verdict,
                "changes": _changes(one, mapping),
                "findings": [finding_json(f, mapping) for f in one.findings],
            }
            for one in inspections
        },
        "together": [finding_json(f, mapping) for f in more],
        "sensors": together_rows(inspections),
        "drifts": drift_rows(inspections),
        "versions": dict(versions),
    }
