"""Runs beside each other: which columns a terminal and a page have room for, and whether one can be called the best."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from manoeuvre_nn.report.columns import RUNS, RUNS_BY_MANOEUVRE, RUNS_BY_SETTING
from manoeuvre_nn.report.sweep import DEV, LEARNT, MEAN, RMS, error_of, short_name, status_of, why_no_best, worst_of
from manoeuvre_nn.report.tables import Row, columns, rich_table

MAX_COLUMNS = 10
"""Columns of a page's table that a screen of 1300 px and a sheet of paper have room for."""
MAX_DRAWN = 3
"""Settings that differ up to which a figure and a sentence can be read."""
MAX_WIDTH = 10_000
"""No table is wider [columns]."""
STATUS_WIDTH = 30
"""What the message of a run that failed is given at least, beside settings [columns]."""


class Comparison(NamedTuple):
    """Runs and what they differ in.

    Attributes:
        rows: One a run, best first: ``job``, settings, what came out.
        settings: Names of settings in which runs differ: those swept, the others that somebody wrote, the rest.
        written: How many of them somebody wrote.
    """

    rows: list[dict[str, Any]]
    settings: list[str]
    written: int


class _Form(NamedTuple):
    """How much of what came out is shown, and how narrow: the fewer, the more settings have room."""

    each: bool = False
    worst: bool = True
    run_width: int = MAX_WIDTH


FORMS = (_Form(each=True), _Form(), _Form(worst=False), *(_Form(worst=False, run_width=width) for width in (20, 14, 1)))
"""From the fullest to the narrowest: every manoeuvre, the worst alone, the mean alone, names on several lines."""


def summary(told: Comparison) -> str:
    """What came out, in a sentence; a best run is named only where all were asked the same.

    Args:
        told: The runs.

    Returns:
        The sentence.
    """
    scored = [row for row in told.rows if error_of(row) < float("inf")]
    if not scored:
        return "No run has a score."
    count = f"{len(scored)} of {len(told.rows)} runs have a score"
    if why := why_no_best(told.rows):
        return f"{count}; no best is named: {why}."
    best = scored[0]
    settings = [f"{heading(n, told.settings)}={best[n]}" for n in told.settings if best.get(n) is not None]
    how = f" ({', '.join(settings)})" if 0 < len(settings) <= MAX_DRAWN else ""
    return f"{count}; the best is {best['job']}{how}: error {error_of(best):.3g}."


def fitting(told: Comparison, console: Console) -> tuple[Table, list[str]]:
    """The fullest table that fits the terminal and has all settings that somebody wrote.

    Args:
        told: The runs.
        console: The terminal.

    Returns:
        The table, and a line on the settings that are left out, if any is.
    """
    rows, names = told.rows, told.settings

    def table(form: _Form, shown: Sequence[str], status_width: int = MAX_WIDTH) -> Table:
        cells = [{**_outcome(row, rows, form), **_named(row, shown, names)} for row in rows]
        statuses = [status_of(row)[:status_width] for row in rows]
        if len(set(statuses)) > 1:
            cells = [{**one, "status": status} for one, status in zip(cells, statuses, strict=True)]
        return rich_table(cells, f"{len(rows)} run{'s' if len(rows) != 1 else ''}")

    def fits(form: _Form, shown: Sequence[str]) -> bool:
        wide = console.options.update(width=MAX_WIDTH)
        return console.measure(table(form, shown, STATUS_WIDTH), options=wide).maximum <= console.width

    written = names[: told.written]
    form = next((form for form in FORMS if fits(form, written)), FORMS[-1])
    shown = list(written) if fits(form, written) else []
    for name in names[len(shown) :]:
        shown += [name] if fits(form, [*shown, name]) else []
    left_out = ", ".join(heading(name, names) for name in names if name not in shown)
    note = f"no room here for settings in which the runs differ: {left_out}; they are in runs.csv"
    return table(form, shown), [note] if left_out else []


def page_tables(told: Comparison) -> tuple[dict[str, list[Row]], list[str]]:
    """Tables of a page: one, or where it would be too wide one of what matters and others of the rest.

    Args:
        told: The runs.

    Returns:
        Heading -> rows; and a line on what stands in the file alone, if anything does.
    """
    rows, names = told.rows, told.settings
    each = _known(rows, (n for n in columns(rows) if n.startswith(DEV)))
    errors = _known(rows, (n for n in columns(rows) if n.startswith(RMS)))
    odd = [n for n in ("status", "seed", "ended early") if len({str(row.get(n)) for row in rows}) > 1]
    main = ["job", *_known(rows, ("verdict", MEAN))]
    whole = [*main, *each, *errors, *odd, *names]
    if len(whole) <= MAX_COLUMNS:
        return {RUNS: [_named(row, whole, names) for row in rows]}, []
    room = MAX_COLUMNS - len(main) - len(errors) - len(odd) - (1 if each else 0)
    first = names[: max(min(told.written, room), 0)]
    rest = [name for name in names if name not in first]
    shown = [
        {
            **_named(row, main, ()), **({"worst": worst_of(row)} if each else {}),
            **_named(row, [*errors, *odd, *first], names),
        }
        for row in rows
    ]  # fmt: skip
    parts = {RUNS_BY_MANOEUVRE: each[: MAX_COLUMNS - 1], RUNS_BY_SETTING: rest[: MAX_COLUMNS - 1]}
    made: dict[str, list[Row]] = {RUNS: list(shown)}
    made |= {part: [_named(row, ["job", *some], names) for row in rows] for part, some in parts.items() if some}
    left_out = [heading(name, names) for some in (each, rest) for name in some[MAX_COLUMNS - 1 :]]
    return made, [f"These columns are in runs.csv alone: {', '.join(left_out)}."] if left_out else []


def heading(name: str, settings: Sequence[str]) -> str:
    """A column's name as there is room for it.

    Args:
        name: Column of the file.
        settings: Columns that are settings.

    Returns:
        The last word of a setting unless another ends in it too; else the name.
    """
    if name in settings:
        return short_name(name, settings)
    return "run" if name == "job" else name


def remarks(rows: Sequence[Row]) -> Iterator[str]:
    """What is to be minded when rows are compared.

    Args:
        rows: One a run.

    Yields:
        Sentences.
    """
    if why := why_no_best(rows):
        yield f"{why[:1].upper()}{why[1:]}: compare their columns, not the means."


def _known(rows: Sequence[Row], names: Sequence[str] | Iterator[str]) -> list[str]:
    """Those columns in which any run has something."""
    return [name for name in names if any(row.get(name) is not None for row in rows)]


def _named(row: Row, names: Sequence[str], settings: Sequence[str]) -> dict[str, Any]:
    """Cells of a run under short headings."""
    return {heading(name, settings): row.get(name) for name in names}


def _outcome(row: Row, rows: Sequence[Row], form: _Form) -> dict[str, Any]:
    """The run and what came out of it; what no run has is left out."""
    errors = [n for n in columns(rows) if n.startswith(RMS) and not n.startswith(LEARNT)]
    names = _known(rows, ["verdict", MEAN, *errors, *(n for n in columns(rows) if form.each and n.startswith(DEV))])
    names += ["seed"] if len({row.get("seed") for row in rows}) > 1 else []
    cells: Mapping[str, Any] = {heading(n, ()).removeprefix(DEV): row.get(n) for n in names}
    worst = {"worst": worst_of(row)} if form.worst and not form.each and any(map(worst_of, rows)) else {}
    if form.run_width < MAX_WIDTH:
        cells = {name.replace(" ", "\n"): _stacked(value) for name, value in cells.items()}
    return {"run": _broken(str(row["job"]), form.run_width), **cells, **worst}


def _stacked(value: Any) -> Any:
    """A cell whose words stand on a line each."""
    return value.replace("not use", "not\nuse") if isinstance(value, str) else value


def _broken(name: str, width: int) -> str:
    """A name on lines of a width, broken after a stroke, a comma or an equals sign and nowhere else."""
    lines = [""]
    for part in re.findall(r"[^/,]*[/,]?", name):
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(line for line in lines if line)
