"""``manoeuvre compare``: one table over runs of ``manoeuvre train``, wherever they lie."""

import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from manoeuvre_nn.commands.logs import logged
from manoeuvre_nn.commands.provenance import CONFIG, flat, shown, versions
from manoeuvre_nn.commands.settings import SEVERAL
from manoeuvre_nn.commands.shelves import TARGET
from manoeuvre_nn.core.data_files import OVERRIDES, load_yaml, overrides_of
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.report.html import Report, write_report
from manoeuvre_nn.report.sweep import (
    DEV,
    LEARNT,
    MEAN,
    RMS,
    error_of,
    has_scores,
    job_folders,
    results_of,
    short_name,
    status_of,
    sweep_figure,
    worst_of,
)
from manoeuvre_nn.report.tables import Row, columns, rich_table, write_csv

USAGE = "manoeuvre compare FOLDER [FOLDER ...] [out=FOLDER]"
HELP = f"""One table over runs of manoeuvre train, wherever they lie, the closest to the recorded tracks first.

    {USAGE}
    manoeuvre compare outputs/*

Columns are the run's folder, the verdict, dev/L of every held-out manoeuvre, and the settings in which the runs differ.
Written to out: runs.csv, with everything, and compare.html."""
TABLE, PAGE = "runs.csv", "compare.html"
NOT_SHOWN = (
    "format", "versions", "name", "logger", "score", "config_dir", "trainer.progress", "trainer.resume",
    "trainer.threads", "ship.name",
)  # fmt: skip
"""Parts of a config that make no difference to a model, or that the columns of results say."""
RECORDED = ("recorded_files", "recorded_records", "computed_records")
"""Data of which no manoeuvre of the config is sailed."""
AFTER_SCORES = ("seed", "epochs", "stopped", "seconds")
"""Results that stand last."""
MAX_NAMED = 5
"""Folders that a line names."""
MAX_DRAWN = 3
"""Settings that differ up to which a figure can be read."""
MAX_WIDTH = 10_000
"""No table is wider [columns]."""
STATUS_WIDTH = 30
"""What the message of a run that failed is given at least, beside settings [columns]."""


class _Asked(NamedTuple):
    """What was asked for: folders, and where the table goes."""

    folders: list[Path]
    out: Path


def request(words: Sequence[str]) -> _Asked:
    """Read the command line; refused if a setting is unknown, or a folder is none."""
    folders, out = [], Path("outputs", f"{datetime.now():%Y-%m-%d}", f"{datetime.now():%H-%M-%S}_comparison")
    for word in words:
        key, sign, value = word.partition("=")
        if key == "out" and value:
            out = Path(value)
        elif Path(word).is_dir():
            folders.append(Path(word))
        elif sign or not Path(word).exists():  # a file among folders/* is left
            raise InputError(f"{word} is neither a folder nor out=FOLDER; write {USAGE}")
    if not folders:
        raise InputError(f"no folder is given; write {USAGE}")
    return _Asked(folders, out)


def compare(asked: _Asked, console: Console) -> list[dict[str, Any]]:
    """Write table and page, and print what fits; a row each run."""
    rows = compared(asked.folders)
    notes, out = [*remarks(rows), *_passed_over(asked.folders)], asked.out
    with locked(out), logged(out, f"manoeuvre compare {' '.join(map(str, asked.folders))} out={out}"):
        write_csv(out / TABLE, rows)
        _write_page(rows, notes, asked)
        table, left_out = fitting(rows, console)
        console.print(table)
        for line in [*left_out, *notes]:
            console.print(f"note: {line}", highlight=False)
        here = shown(out.resolve())
        console.print(f"table: {here / TABLE}   page: {here / PAGE}", soft_wrap=True, highlight=False)
    return rows


def _write_page(rows: Sequence[Row], notes: Sequence[str], asked: _Asked) -> None:
    """The table and, where few settings differ, the figure of a sweep."""
    names = settings_in(rows)
    unsaid = {"job", "verdict", MEAN, "stopped", "epochs", *names}
    others = [name for name in columns(rows) if name not in unsaid and not name.startswith("relRMSE")]
    said = [name for name in ("verdict", MEAN) if any(row.get(name) is not None for row in rows)]
    told = ["job", *said, *sorted(others, key=lambda name: not name.startswith((DEV, RMS))), *names]
    drawn = {"Held-out errors/by settings": sweep_figure(rows)} if has_scores(rows) and len(names) <= MAX_DRAWN else {}
    report = Report(
        title=f"{len(rows)} run{'s' if len(rows) != 1 else ''} compared",
        summary=_summary(rows, names),
        tables={"Runs": [{_heading(name, names): row[name] for name in told} for row in rows]},
        figures=drawn,
        config={"folders": [harmless(str(folder)) for folder in asked.folders]},
        versions=versions(),
        notes=notes,
        unfolded=("Runs",),
    )
    write_report(asked.out / PAGE, report)


def _passed_over(folders: Sequence[Path]) -> list[str]:
    """A line on folders without a run, such as those of a diagnosis; empty if there is none."""
    empty = [harmless(str(folder)) for folder in folders if not list(job_folders(folder))]
    told = f"{', '.join(empty[:MAX_NAMED])}{' ...' if len(empty) > MAX_NAMED else ''}"
    return [f"no run of manoeuvre train is in {told}: passed over"] if empty else []


def compared(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """What runs differ in and what came out of each.

    Args:
        folders: Runs, or folders of runs.

    Returns:
        A row each run, best first: ``job``, its folder below what all share; settings that differ; what came out.

    Raises:
        InputError: If there is no run.
    """
    jobs = list(dict.fromkeys(Path(os.path.realpath(job)) for folder in folders for job in job_folders(folder)))
    if not jobs:
        raise InputError(f"{', '.join(map(str, folders))}: no run of manoeuvre train is there; write {USAGE}")
    above = Path(os.path.commonpath([job.parent for job in jobs]))
    settings = [settings_of(job) for job in jobs]
    typed = set(chain.from_iterable(overrides_of(job / OVERRIDES) for job in jobs))
    names = [name for name in differing(settings, typed) if name != "seed"]  # which is among the results
    rows = [
        {"job": harmless(str(job.relative_to(above))), **{name: said.get(name) for name in names}, **results_of(job)}
        for job, said in zip(jobs, settings, strict=True)
    ]
    order = sorted(columns(rows), key=lambda n: (n in AFTER_SCORES, n.startswith("relRMSE"), n.startswith(DEV)))
    return [{name: row.get(name) for name in order} for row in sorted(rows, key=error_of)]


def settings_of(job: Path) -> dict[str, Any]:
    """Settings of a run by their names: a group stands for what it makes or the ship, several things for theirs."""
    try:
        config = load_yaml(job / CONFIG)
    except InputError:
        return dict(overrides_of(job / OVERRIDES))  # it failed before its config was written
    config = config if isinstance(config, Mapping) else {}
    data = config.get("data")
    if isinstance(data, Mapping) and str(data.get(TARGET)).rpartition(".")[2] in RECORDED:
        config = {group: said for group, said in config.items() if group != "manoeuvre"}
    found: dict[str, Any] = {}
    for group, said in config.items():
        if isinstance(said, Mapping) and TARGET in said:
            found[group] = str((group == "ship" and said.get("name")) or str(said[TARGET]).rpartition(".")[2])
        elif isinstance(said, Mapping) and group in SEVERAL:
            found[group] = " ".join(name for name, one in said.items() if isinstance(one, Mapping)) or "none"
    found |= {k: v if isinstance(v, str | int | float) else str(v) for k, v in flat(dict(config)).items()}
    left_out = tuple(f"{name}." for name in NOT_SHOWN)
    return {k: v for k, v in found.items() if not k.endswith(TARGET) and not f"{k}.".startswith(left_out)}


def differing(settings: Sequence[Mapping[str, Any]], typed: set[str]) -> list[str]:
    """Settings in which runs differ.

    Args:
        settings: Of each run.
        typed: Settings that somebody wrote.

    Returns:
        Names of those that have several values; without those that come with the option of a group and that nobody
        wrote: two networks differ in more than a choice.
    """
    names = [name for name in columns(settings) if len({str(s[name]) for s in settings if name in s}) > 1]
    return [name for name in names if name in typed or not _comes_along(name, names, settings)]


def _comes_along(name: str, names: Sequence[str], settings: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the option of a setting's group, which differs too, says what the setting is."""
    group, inner, _ = name.partition(".")
    if not inner or group not in names:
        return False
    pairs = {(str(s.get(group)), str(s[name])) for s in settings if name in s}
    return len(pairs) == len({option for option, _ in pairs})


def settings_in(rows: Sequence[Row]) -> list[str]:
    """Columns of rows that are settings: those between the run and its status."""
    names = columns(rows)
    return names[1 : names.index("status")]


def remarks(rows: Sequence[Row]) -> Iterator[str]:
    """What is to be minded when rows are compared."""
    sets = {
        tuple(n for n in row if n.startswith(DEV) and row[n] is not None) for row in rows if row.get(MEAN) is not None
    }
    if len(sets) > 1:
        yield "The runs are not scored on the same manoeuvres: compare their columns, not the means."


def _summary(rows: Sequence[Row], named: Sequence[str]) -> str:
    """What came out, in a sentence."""
    scored = [row for row in rows if error_of(row) < float("inf")]
    if not scored:
        return "No run has a score."
    best = scored[0]
    settings = [f"{_heading(name, named)}={best[name]}" for name in named if best.get(name) is not None]
    how = f" ({', '.join(settings)})" if 0 < len(settings) <= MAX_DRAWN else ""
    return (
        f"{len(scored)} of {len(rows)} runs have a score; the best is {best['job']}{how}: error {error_of(best):.3g}."
    )


def fitting(rows: Sequence[Row], console: Console) -> tuple[Table, list[str]]:
    """The fullest table that fits the terminal: every manoeuvre, or the worst, and the settings that have room.

    Args:
        rows: One a run.
        console: The terminal.

    Returns:
        The table, and a line on the settings that are left out, if any is.
    """
    names = settings_in(rows)

    def table(each: bool, shown: Sequence[str], status_width: int = MAX_WIDTH) -> Table:
        told = [
            {**_outcome(row, rows, each), **{_heading(name, names): row.get(name) for name in shown}} for row in rows
        ]
        statuses = [status_of(row)[:status_width] for row in rows]
        if len(set(statuses)) > 1:
            told = [{**cells, "status": status} for cells, status in zip(told, statuses, strict=True)]
        return rich_table(told, f"{len(rows)} run{'s' if len(rows) != 1 else ''}")

    def fits(each: bool, shown: Sequence[str]) -> bool:
        wide = console.options.update(width=MAX_WIDTH)
        return console.measure(table(each, shown, STATUS_WIDTH), options=wide).maximum <= console.width

    each, shown = fits(True, names), list[str]()
    for name in names:
        shown += [name] if fits(each, [*shown, name]) else []
    left_out = ", ".join(_heading(name, names) for name in names if name not in shown)
    note = f"no room here for settings in which the runs differ: {left_out}; they are in {TABLE} and on the page"
    return table(each, shown), [note] if left_out else []


def _outcome(row: Row, rows: Sequence[Row], each: bool) -> dict[str, Any]:
    """The run and what came out of it, of each held-out manoeuvre or of the worst; what no run has is left out."""
    errors = [n for n in columns(rows) if n.startswith(RMS) and not n.startswith(LEARNT)]
    told = ["verdict", MEAN, *errors, *(n for n in columns(rows) if each and n.startswith(DEV))]
    told = [name for name in told if any(r.get(name) is not None for r in rows)]
    told += ["seed"] if len({r.get("seed") for r in rows}) > 1 else []
    cells = {_heading(name, ()): row.get(name) for name in ("job", *told)}
    return cells if each or not any(map(worst_of, rows)) else {**cells, "worst": worst_of(row)}


def _heading(name: str, settings: Sequence[str]) -> str:
    """A column's name as a terminal has room for it."""
    if name in settings:
        return short_name(name, settings)
    return "run" if name == "job" else name.removeprefix(DEV)
