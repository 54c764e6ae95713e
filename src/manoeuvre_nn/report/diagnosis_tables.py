"""A diagnosis in words: rows for every table, a summary for the terminal, a short one in Markdown."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Interval, Value
from manoeuvre_nn.report.tables import criterion_label, rich_table, text, to_markdown

CHANNELS: dict[str, tuple[str, str, str]] = {
    "pos": ("position", "pos", "m"),
    "psi": ("heading ψ", "ψ", "deg"),
    "r": ("yaw rate r", "r", "deg/s"),
    "u": ("surge u", "u", "m/s"),
    "v": ("sway v", "v", "m/s"),
    "u_log": ("speed log", "log", "m/s"),
}
"""Channels that are scored: in words, short, unit."""
VERDICTS = {"none": "nothing is missing", "mismatch": "something is missing"}
"""Verdict -> what it says of the calm-water model."""
UNKNOWN = "something unknown is missing"
SITES = {
    "surge": "any force in surge",
    "sway and yaw": "any force in sway and yaw",
    "inflow": "a cause in the inflow",
    "hull": "a cause at the hull",
    "force": "a cause that pushes the ship",
    "actuator": "a cause at rudder or shaft",
    "sensor": "a cause in a sensor",
}
"""Where a force or a candidate was allowed."""
BEFORE, AFTER, NOISE = "calm water", "repaired", "noise alone"
"""What the columns and curves of every comparison are called."""
FOUND = "found ± standard error"
"""Column of the parameters."""
MIN_LISTED, MAX_LISTED = 3, 5
"""Causes that a short list shows: at least, at most. Beyond the fewest, those with 1 % or more."""


def verdict_text(d: Diagnosis) -> str:
    """What was found, in three words.

    Args:
        d: The diagnosis.

    Returns:
        Nothing, something or something unknown is missing.
    """
    return UNKNOWN if d.unknown else VERDICTS.get(d.verdict, d.verdict)


def alias_texts(d: Diagnosis) -> list[str]:
    """What these recordings cannot tell apart.

    Args:
        d: The diagnosis.

    Returns:
        A sentence for every effect of the repaired model that has rivals.
    """
    return [
        f"These recordings cannot tell {label(d, name)} from {', '.join(label(d, rival) for rival in rivals)}."
        for name, rivals in d.alias.items()
        if rivals
    ]


def percent(probability: float) -> str:
    """A probability as people read it; nothing is certain.

    Args:
        probability: Between 0 and 1.

    Returns:
        Such as ``95 %``, ``>99 %`` or ``<1 %``.
    """
    if math.isnan(probability):
        return "–"
    if probability > 0.99:
        return ">99 %"
    return "<1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def words(value: Value) -> str:
    """A parameter's name as people read it.

    Args:
        value: The parameter.

    Returns:
        Such as ``from`` for ``from_deg``: the unit stands with the value.
    """
    return criterion_label(value.name.removesuffix(f"_{value.unit}"))[0]


def value_text(value: Value) -> str:
    """A parameter with its standard error, both to the error's second digit.

    Args:
        value: The parameter.

    Returns:
        Such as ``11.2 ± 1.4 m/s``; without the error where it is zero or unknown.
    """
    unit = "" if value.unit == "-" else f" {value.unit}"
    if not (math.isfinite(value.error) and value.error > 0 and math.isfinite(value.value)):
        return f"{text(value.value, 4)}{unit}"
    digits = 1 - math.floor(math.log10(value.error))
    shown = [f"{round(number, digits):.{max(digits, 0)}f}" for number in (value.value, value.error)]
    return f"{' ± '.join(shown)}{unit}"


def interval_text(value: Value) -> str:
    """Where a parameter lies with 95 %.

    Args:
        value: The parameter.

    Returns:
        Such as ``8.5 to 13.9``; a dash where the error is unknown.
    """
    if not (math.isfinite(value.error) and value.error > 0):
        return "–"
    digits = max(1 - math.floor(math.log10(value.error)), 0)
    return " to ".join(f"{value.value + sign * 1.96 * value.error:.{digits}f}" for sign in (-1, 1))


def when_text(intervals: Mapping[str, Sequence[Interval]] | None, most: int = 4) -> str:
    """When a cause acts.

    Args:
        intervals: Run -> times [s]; None: throughout.
        most: Times to name before the rest is only counted.

    Returns:
        Such as ``r01 120–240 s, r03 60–180 s``.
    """
    if intervals is None:
        return "throughout"
    spans = [f"{run} {start:.0f}–{end:.0f} s" for run, times in intervals.items() for start, end in times]
    rest = [f"and {len(spans) - most} more"] if len(spans) > most else []
    return ", ".join([*spans[:most], *rest]) or "–"


def _acts_text(cause: Cause) -> str:
    """Where a cause acts."""
    return ", ".join(e.removeprefix("actuator:").replace(":", " ") for e in cause.equations) or "–"


def label(d: Diagnosis, name: str) -> str:
    """A cause's name in words.

    Args:
        d: The diagnosis.
        name: Its name.

    Returns:
        Its label; the name itself if it is no candidate.
    """
    return next((cause.label for cause in d.causes if cause.name == name), name.replace("_", " "))


def main_causes(d: Diagnosis, most: int = MAX_LISTED) -> list[Cause]:
    """Causes that a short list has room for.

    Args:
        d: The diagnosis.
        most: How many there may be.

    Returns:
        Those of the repaired model, and the most probable others.
    """
    named = [cause for cause in d.causes if cause.name in d.model]
    others = [cause for cause in d.causes if cause.name not in d.model]
    room = max(most - len(named), 1)
    probable = sum(cause.probability >= 0.01 for cause in others)
    return named + others[: min(room, max(probable, MIN_LISTED - len(named)))]


def cause_rows(d: Diagnosis, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Causes with all that is known about them.

    Args:
        d: The diagnosis.
        causes: Which ones.

    Returns:
        One row a cause; those of the repaired model have a star.
    """
    return [
        {
            "cause": f"{'* ' if cause.name in d.model else ''}{cause.label}",
            "probability": percent(cause.probability),
            FOUND: "\n".join(f"{words(value)} {value_text(value)}" for value in cause.parameters) or "–",
            "when": when_text(cause.intervals),
            "acts on": _acts_text(cause),
            "ln B": _whole(cause.evidence),
        }
        for cause in causes
    ]


def parameter_rows(causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Parameters with their intervals.

    Args:
        causes: Whose parameters.

    Returns:
        One row a parameter.
    """
    return [
        {
            "cause": cause.label,
            "parameter": words(value),
            FOUND: value_text(value),
            "95 % interval": interval_text(value),
        }
        for cause in causes
        for value in cause.parameters
    ]


def error_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """RMS errors on all held-out runs, before and after, beside the noise.

    Args:
        d: The diagnosis.

    Returns:
        One row a channel; none without held-out runs. The last column is 1 for a model that cannot be better.
    """
    before, after = d.rmse("before"), d.rmse("after")
    rows = []
    for channel in before:
        name, _, unit = CHANNELS.get(channel, (channel, channel, "-"))
        noise = d.noise.get(channel, math.nan)
        repaired = {AFTER: after.get(channel, math.nan)} if d.model else {}
        left = repaired.get(AFTER, before[channel])
        ratio = left / noise if noise > 0 else math.nan
        rows.append({
            "RMS error": f"{name} [{unit}]",
            BEFORE: before[channel],
            **repaired,
            NOISE: noise,
            f"{AFTER if d.model else BEFORE} / noise": ratio,
        })
    return rows


def _errors_across(d: Diagnosis) -> list[dict[str, Any]]:
    """The same with a column a channel, which is lower."""
    before, after = d.rmse("before"), d.rmse("after")
    lines = {BEFORE: before, **({AFTER: after} if d.model else {}), NOISE: d.noise}
    heads = {channel: "{1} [{2}]".format(*CHANNELS.get(channel, (channel, channel, "-"))) for channel in before}
    if not before:
        return []
    return [
        {"RMS error": name, **{head: values.get(channel, math.nan) for channel, head in heads.items()}}
        for name, values in lines.items()
    ]


def check_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """Tests that the claim had to pass.

    Args:
        d: The diagnosis.

    Returns:
        One row a test, those not passed first.
    """
    return [
        {"test": check.name, "passed": check.passed, "measured": check.text}
        for check in sorted(d.checks, key=lambda check: check.passed)
    ]


def site_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """Where anything at all would help.

    Args:
        d: The diagnosis.

    Returns:
        One row a site, the strongest first.
    """
    ranked = sorted(d.sites.items(), key=lambda item: -item[1])
    return [{"site": SITES.get(site, site), "ln B over calm water": _whole(evidence)} for site, evidence in ranked]


def _whole(evidence: float) -> float | int:
    """A log Bayes factor without digits that say nothing."""
    return round(evidence, 1) if not abs(evidence) >= 100 or math.isinf(evidence) else round(evidence)


def print_diagnosis(d: Diagnosis, console: Console) -> None:
    """About 25 lines: sentence, causes, errors, where, what speaks against it, and what to do next.

    Args:
        d: The diagnosis.
        console: Where to print.
    """
    console.print(Text(f"{d.case}, {d.ship}: {verdict_text(d)} in the calm-water model", "dim"))
    console.print(Text(d.sentence, "bold"))
    if d.causes:
        console.print(_short_causes(d))
    if d.proofs:
        console.print(rich_table(_errors_across(d)))
    _print_short(d, lambda head, words, style="": console.print(Text.assemble((f"{head}: ", "bold"), (words, style))))


def _short_causes(d: Diagnosis) -> Table:
    """The main causes within 80 columns: three parameters each, and the first times."""
    table = rich_table([
        {
            "cause": row["cause"],
            "probability": row["probability"],
            FOUND: "\n".join(str(row[FOUND]).splitlines()[:3]),
            "where and when": f"{row['acts on']}; {when_text(cause.intervals, 2)}",
        }
        for cause, row in zip(main_causes(d), cause_rows(d, main_causes(d)), strict=True)
    ])
    for column in table.columns[1:3]:
        column.no_wrap = True
    return table


def _print_short(d: Diagnosis, say: Callable[..., None]) -> None:
    """What fits a line or two each."""
    for sentence in alias_texts(d):
        say("undecided", sentence)
    if d.statements:
        say("where", " ".join(d.statements[:2]))
    failed = [check for check in d.checks if not check.passed]
    for check in failed:
        say("not passed", f"{check.name}: {check.text}", "bold red")
    if d.checks and not failed:
        say("checks", f"all {len(d.checks)} passed", "green")
    if not d.proofs:
        say("not proved", "no run was held out", "bold red")
    if d.runner_up:
        say("runner-up", " ".join(d.runner_up))
    if d.undecided:
        say("undecided", d.undecided[0])
    if d.next_steps:
        say("record next", d.next_steps[0])


def diagnosis_markdown(d: Diagnosis) -> str:
    """The diagnosis as a short text.

    Args:
        d: The diagnosis.

    Returns:
        Markdown: the sentence, tables and lists; what is empty is left out.
    """
    parts = [
        f"# {d.case}, {d.ship}: {verdict_text(d)}\n",
        f"**{d.sentence}**\n",
        _part("Causes", to_markdown(cause_rows(d, main_causes(d)), 3)),
        _part("", "\\* in the repaired model\n" if d.model else ""),
        _part("", _bullets(alias_texts(d))),
        _part("Held-out runs", to_markdown(error_rows(d), 3) if d.proofs else "No run was held out.\n"),
        _part("Where", _bullets(d.statements)),
        _part("For and against the runner-up", _bullets(d.runner_up)),
        _part("Checks", to_markdown(check_rows(d))),
        _part("Undecided", _bullets(d.undecided)),
        _part("Record next", _bullets(d.next_steps)),
    ]
    return "\n".join(part for part in parts if part)


def _part(heading: str, body: str) -> str:
    """A heading and what is under it; nothing if there is nothing."""
    return (f"## {heading}\n\n" if heading and body else "") + body


def _bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list."""
    return "".join(f"- {sentence}\n" for sentence in sentences)
