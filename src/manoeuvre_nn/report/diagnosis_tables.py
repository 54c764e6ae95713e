"""A diagnosis in words: rows for every table, a summary for the terminal, a short one in Markdown."""

import math
from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from manoeuvre_nn.diagnosis.result import GAIN, RIGHT_SHIP, Cause, Diagnosis, Value
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
BEFORE, ALONE, AFTER, NOISE = "calm water", "effects alone", "repaired", "measurement noise"
"""What the columns and curves of every comparison are called."""
FOUND = "found ± standard error"
"""Column of the parameters."""
VALUE_WIDTH = 26
"""Columns of a terminal after which a parameter is broken, so that causes keep their words whole."""
UNTESTED = ": not proved"
"""How the text of a test ends that no held-out run could make."""
MIN_LISTED, MAX_LISTED = 3, 5
"""Causes that a short list shows: at least, at most. Beyond the fewest, those with 1 % or more."""


def verdict_text(d: Diagnosis) -> str:
    """What was found, in a few words."""
    if d.doubtful:
        return "this may not be the ship, or her model is wrong"
    if d.unproved:
        return "nothing is proved to be missing in the calm-water model"
    what = "something unknown" if d.unknown else "something" if d.verdict == "mismatch" else "nothing"
    return f"{what} is missing in the calm-water model"


def alias_texts(d: Diagnosis) -> list[str]:
    """What these recordings cannot tell apart: a sentence for every effect of the repaired model that has rivals."""
    labels = {cause.name: cause.label for cause in d.causes}
    rivals = {name: [labels.get(n, n.replace("_", " ")) for n in alike] for name, alike in d.alias.items() if alike}
    return [
        f"These recordings cannot tell {labels.get(name, name)} from {', '.join(alike)}."
        for name, alike in rivals.items()
    ]


def percent(probability: float) -> str:
    """A probability as people read it, such as ``95 %``; nothing is certain: ``>99 %``, ``<1 %``."""
    if math.isnan(probability):
        return "–"
    if probability > 0.99:
        return ">99 %"
    return "<1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def words(value: Value) -> str:
    """A parameter's name as people read it: ``from`` for ``from_deg``, as the unit stands with the value."""
    return criterion_label(value.name.removesuffix(f"_{value.unit}"))[0]


def of_campaign(value: Value) -> str:
    """The campaign that a value belongs to, in brackets."""
    return f" ({value.campaign})" if value.campaign else ""


def value_text(value: Value) -> str:
    """A parameter with its standard error, if this is known, both to the error's second digit.

    Returns:
        ``11.2 ± 1.4 m/s``; where its sign has words, with these in its place: ``222 ± 12 kN to port``.
    """
    size, side = (abs(value.value), f" {value.sides[value.value < 0]}") if value.sides else (value.value, "")
    unit = ("" if value.unit == "-" else f" {value.unit}") + side
    if not (math.isfinite(value.error) and value.error > 0 and math.isfinite(value.value)):
        return f"{text(size, 4)}{unit}"
    digits = 1 - math.floor(math.log10(value.error))
    shown = [f"{round(number, digits):.{max(digits, 0)}f}" for number in (size, value.error)]
    return f"{' ± '.join(shown)}{unit}"


def interval_text(value: Value) -> str:
    """Where a possible value lies with 95 %.

    Returns:
        ``8.5 to 13.9``; ``any`` of a direction; a dash where the error is unknown; where the sign has words,
        ``198 to 246 to port``, or ``10 to port, 20 to starboard`` if 0 lies within.
    """
    ends = value.interval
    if ends is None:
        return "–"
    if value.period and ends == (0.0, value.period):
        return "any"
    digits = max(1 - math.floor(math.log10(value.error)), 0)
    # What rounding takes to the period is 0.
    shown = [round(end, digits) % value.period if value.period else end for end in ends]
    if not value.sides:
        return " to ".join(f"{end:.{digits}f}" for end in shown)
    positive, negative = value.sides
    if ends[0] < 0 < ends[1]:
        return f"{-shown[0]:.{digits}f} {negative}, {shown[1]:.{digits}f} {positive}"
    low, high = sorted(map(abs, shown))
    return f"{low:.{digits}f} to {high:.{digits}f} {negative if ends[1] <= 0 else positive}"


def when_text(cause: Cause, most: int = 4) -> str:
    """When a cause acts, ``r01 120 ± 3 to 240 ± 4 s, r03 60 to 180 s``; beyond so many times the rest is counted."""
    if cause.intervals is None:
        return "throughout"
    spans = []
    for run, times in cause.intervals.items():
        errors = cause.interval_errors.get(run) or [(math.nan, math.nan)] * len(times)
        for ends, of_ends in zip(times, errors, strict=True):
            shown = [
                f"{t:.0f} ± {max(e, 1):.0f}" if math.isfinite(e) else f"{t:.0f}"
                for t, e in zip(ends, of_ends, strict=True)
            ]
            spans.append(f"{run} {' to '.join(shown)} s")
    rest = [f"and {len(spans) - most} more"] if len(spans) > most else []
    return ", ".join([*spans[:most], *rest]) or "–"


def _acts_text(cause: Cause) -> str:
    """Where a cause acts."""
    return ", ".join(e.removeprefix("actuator:").replace(":", " ") for e in cause.equations) or "–"


def main_causes(d: Diagnosis, most: int = MAX_LISTED) -> list[Cause]:
    """Causes of the repaired model, and the most probable others that a list of so many has room for."""
    named = [cause for cause in d.causes if cause.name in d.model]
    others = [cause for cause in d.causes if cause.name not in d.model]
    room = max(most - len(named), 1)
    probable = sum(cause.probability >= 0.01 for cause in others)
    return named + others[: min(room, max(probable, MIN_LISTED - len(named)))]


def cause_rows(d: Diagnosis, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Causes with all that is known about them, one a row; those of the repaired model have a star."""
    return [
        {
            "cause": f"{'* ' if cause.name in d.model else ''}{cause.label}",
            "probability": percent(cause.probability),
            FOUND: "\n".join(f"{words(value)}{of_campaign(value)} {value_text(value)}" for value in cause.parameters)
            or "–",
            "when": when_text(cause).replace(", ", "\n"),
            "acts on": _acts_text(cause),
            "ln B": _whole(cause.evidence),
        }
        for cause in causes
    ]


def parameter_rows(causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Parameters with their intervals, one a row."""
    return [
        {
            "cause": cause.label,
            "parameter": f"{words(value)}{of_campaign(value)}{', first run' if value.by_run else ''}",
            FOUND: value_text(value),
            "95 % interval": interval_text(value),
        }
        for cause in causes
        for value in cause.parameters
    ]


def _errors(d: Diagnosis) -> dict[str, Mapping[str, float]]:
    """RMS errors on all held-out runs, before, by the effects alone, after, and the measurement noise."""
    repaired = {ALONE: d.rmse("alone"), AFTER: d.rmse("after")} if d.repaired else {}
    noise = {channel: rms if rms > 0 else math.nan for channel, rms in d.noise.items()}
    return {BEFORE: d.rmse("before"), **{k: v for k, v in repaired.items() if v}, NOISE: noise}


def error_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """RMS errors on all held-out runs, one row a channel; the last column is about 1 for a model that is right."""
    errors, last = _errors(d), AFTER if d.repaired else BEFORE
    rows = []
    for channel in errors[BEFORE]:
        name, _, unit = CHANNELS[channel]
        row = {what: of_channel.get(channel, math.nan) for what, of_channel in errors.items()}
        ratio = row[last] / row[NOISE] if row[NOISE] > 0 else math.nan
        rows.append({"RMS error": f"{name} [{unit}]", **row, f"{last} / noise": ratio})
    return rows


def _errors_across(d: Diagnosis) -> list[dict[str, Any]]:
    """The same with a column a channel, which is lower."""
    heads = {channel: "{1} [{2}]".format(*CHANNELS[channel]) for channel in d.rmse("before")}
    return [
        {"RMS error": what, **{head: of_channel.get(channel, math.nan) for channel, head in heads.items()}}
        for what, of_channel in _errors(d).items()
    ]


def check_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """Tests that the claim had to pass, one a row, those not passed first."""
    return [
        {"test": check.name, "passed": check.passed, "measured": check.text}
        for check in sorted(d.checks, key=lambda check: check.passed)
    ]


def site_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """Where anything at all would help, one site a row, the strongest first."""
    ranked = sorted(d.sites.items(), key=lambda item: -item[1])
    return [{"site": SITES.get(site, site), "ln B over calm water": _whole(evidence)} for site, evidence in ranked]


def _whole(evidence: float) -> float | int:
    """A log Bayes factor without digits that say nothing."""
    return round(evidence, 1) if not abs(evidence) >= 100 or math.isinf(evidence) else round(evidence)


def print_diagnosis(d: Diagnosis, console: Console) -> None:
    """About 25 lines: sentence, causes, errors, where, what speaks against it, and what to do next."""
    console.print(Text(f"{d.case}, {d.ship}: {verdict_text(d)}", "dim"))
    console.print(Text(d.sentence, "bold"))
    if d.causes:
        console.print(_short_causes(d))
    if d.proofs:
        console.print(rich_table(_errors_across(d)))
    _print_short(d, lambda head, words, style="": console.print(Text.assemble((f"{head}: ", "bold"), (words, style))))


def _short_causes(d: Diagnosis) -> Table:
    """The main causes within 80 columns, broken at blanks: three parameters each, and the first times."""
    table = rich_table([
        {
            "cause": row["cause"],
            "probability": row["probability"],
            FOUND: "\n".join(
                fill(line, VALUE_WIDTH, break_on_hyphens=False)
                for line in str(row[FOUND]).splitlines()[: None if row["cause"].startswith("*") else 3]
            ),
            "where and when": f"{row['acts on']}; {when_text(cause, 2)}",
        }
        for cause, row in zip(main_causes(d), cause_rows(d, main_causes(d)), strict=True)
    ])
    for column in table.columns[1:3]:
        column.no_wrap = True
    return table


def outcomes(d: Diagnosis) -> list[tuple[str, str, str]]:
    """How the tests went, whether there is a proof, and what was refused: a claim that held-out runs did not bear out.

    Returns:
        Heading, words, and ``good``, ``bad`` or nothing.
    """
    untested = [check for check in d.checks if check.passed and check.text.endswith(UNTESTED)]
    told_elsewhere = (GAIN, RIGHT_SHIP)  # what was refused below, the ship in the first sentence
    tests = [
        check for check in d.checks if check not in untested and (check.passed or check.name not in told_elsewhere)
    ]
    failed = [check for check in tests if not check.passed]
    told = [("not passed", f"{check.name}: {check.text}", "bad") for check in failed]
    if tests and not failed:
        told.append(("tests passed", ", ".join(check.name for check in tests), "good"))
    told += [("refused", check.text, "") for check in d.checks if check.name == GAIN and not check.passed]
    if not d.proofs:
        told.append(("not proved", f"no run was held out{' and recorded' if d.forecasts else ''}", "bad"))
    else:
        told += [("not proved", check.text.removesuffix(UNTESTED), "bad") for check in untested]
    return told


def _print_short(d: Diagnosis, say: Callable[..., None]) -> None:
    """What fits a line or two each."""
    for sentence in alias_texts(d):
        say("undecided", sentence)
    if d.statements:
        say("where", " ".join(d.statements[:2]))
    for head, told, kind in outcomes(d):
        say(head, told, {"good": "green", "bad": "bold red"}.get(kind, ""))
    if d.runner_up:
        say("runner-up", " ".join(d.runner_up))
    if d.undecided:
        say("undecided", d.undecided[0])
    if d.next_steps:
        say("record next", d.next_steps[0])


def diagnosis_markdown(d: Diagnosis) -> str:
    """The diagnosis as a short Markdown text: the sentence, tables and lists; what is empty is left out."""
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
