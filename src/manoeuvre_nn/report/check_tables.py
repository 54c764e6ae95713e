"""What the checks of recordings say, as tables and JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from manoeuvre_nn.recording.check.finding import VERDICTS, Finding, finding_json, number, settings
from manoeuvre_nn.recording.check.inspection import Inspection
from manoeuvre_nn.recording.read.mapping import Mapping as ChannelMapping


def finding_rows(inspection: Inspection, all_of_them: bool = True) -> list[dict[str, Any]]:
    """Checks of one recording.

    Args:
        inspection: What was found.
        all_of_them: Whether those that passed are shown too.

    Returns:
        One row a finding.
    """
    return [
        {
            "check": f.check,
            "verdict": f.verdict,
            "measured": number(f.measured, f.error, f.unit),
            "expected": f.expected or "–",
            "what, and what to do": str(f),
        }
        for f in inspection.findings
        if all_of_them or f.verdict != "ok"
    ]


def trouble_rows(inspections: Sequence[Inspection], least: str = "note") -> list[dict[str, Any]]:
    """What is wrong with several recordings, for the terminal.

    Args:
        inspections: What was found.
        least: Verdict from which on a finding is shown.

    Returns:
        One row a finding that is not ``ok``; the recording is named in its first.
    """
    rows = []
    for one in inspections:
        name = one.name
        for f in one.findings:
            if VERDICTS.index(f.verdict) >= VERDICTS.index(least):
                rows.append({"recording": name, "check": f.check, "verdict": f.verdict, "what, and what to do": str(f)})
                name = ""
    return rows


def overview_rows(inspections: Sequence[Inspection]) -> list[dict[str, Any]]:
    """One row a recording.

    Args:
        inspections: What was found.

    Returns:
        Verdict, how many findings of each kind, and the checks that trip.
    """
    return [
        {
            "recording": one.name,
            "verdict": one.verdict,
            **{v: sum(f.verdict == v for f in one.findings) for v in reversed(VERDICTS)},
            "trips": ", ".join(dict.fromkeys(f.check for f in one.findings if f.trips)) or "–",
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


def _remedy_lines(inspection: Inspection, mapping: ChannelMapping) -> list[str]:
    """What is to be written into the mapping for one recording."""
    tripped = [f for f in inspection.findings if f.trips]
    return [f"{path}: {_yaml(value)}" for path, value in settings(tripped, mapping).items()]


def remedy_rows(inspections: Sequence[Inspection], mapping: ChannelMapping) -> list[dict[str, Any]]:
    """What is to be written into the mapping, for the page and the terminal.

    Args:
        inspections: What was found.
        mapping: The mapping that the recordings were read with.

    Returns:
        One row a recording that something is to be done about.
    """
    lines = {one.name: _remedy_lines(one, mapping) for one in inspections}
    return [{"recording": name, "settings": "; ".join(told)} for name, told in lines.items() if told]


def _yaml(value: object) -> str:
    """A value as yaml has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return "null" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def sentence(inspections: Sequence[Inspection]) -> str:
    """The verdict on all recordings.

    Args:
        inspections: What was found.

    Returns:
        A sentence.
    """
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
    """What ``findings.json`` holds.

    Args:
        inspections: What was found.
        mapping: The mapping that the files were read with.
        more: Findings on all recordings together.
        versions: Package -> version.

    Returns:
        Plain numbers and strings; ``changes`` are settings of the mapping, path -> value.
    """
    return {
        "recordings": {
            one.name: {
                "verdict": one.verdict,
                "changes": settings([f for f in one.findings if f.trips], mapping),
                "findings": [finding_json(f, mapping) for f in one.findings],
            }
            for one in inspections
        },
        "together": [finding_json(f, mapping) for f in more],
        "sensors": together_rows(inspections),
        "versions": dict(versions),
    }
