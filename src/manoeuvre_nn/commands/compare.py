"""``manoeuvre compare``: one table over runs of ``manoeuvre train``, wherever they lie."""

import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from manoeuvre_nn.commands.logs import logged
from manoeuvre_nn.commands.provenance import CONFIG, SCORES, flat, shown, versions
from manoeuvre_nn.commands.settings import SEVERAL
from manoeuvre_nn.commands.shelves import TARGET
from manoeuvre_nn.core.data_files import OVERRIDES, load_yaml, overrides_of
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.report.comparison import MAX_DRAWN, Comparison, fitting, page_tables, remarks, summary
from manoeuvre_nn.report.html import Report, write_report
from manoeuvre_nn.report.sweep import DEV, ERROR, error_of, has_scores, job_folders, results_of, sweep_figure
from manoeuvre_nn.report.tables import columns, write_csv

USAGE = "manoeuvre compare FOLDER [FOLDER ...] [out=FOLDER]"
HELP = f"""One table over runs of manoeuvre train, wherever they lie, the closest to the recorded tracks first.

    {USAGE}
    manoeuvre compare outputs/*

Columns are the run's folder, the verdict, dev/L of the held-out manoeuvres as far as there is room, and the settings in
which the runs differ: those swept first, then the others that somebody wrote, then those that nobody did.
Written to out: runs.csv, with everything, and compare.html."""
TABLE, PAGE = "runs.csv", "compare.html"
SWEEP = "multirun.yaml"
"""What hydra leaves in the folder of a sweep."""
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
    told = compared(asked.folders)
    rows, out = told.rows, asked.out
    notes = [*remarks(rows), *_passed_over(asked.folders)]
    with locked(out), logged(out, f"manoeuvre compare {' '.join(map(str, asked.folders))} out={out}"):
        write_csv(out / TABLE, rows)
        _write_page(told, notes, asked)
        table, left_out = fitting(told, console)
        console.print(table)
        for line in [*left_out, *notes]:
            console.print(f"note: {line}", highlight=False)
        here = shown(out.resolve())
        console.print(f"table: {here / TABLE}   page: {here / PAGE}", soft_wrap=True, highlight=False)
    return rows


def _write_page(told: Comparison, notes: Sequence[str], asked: _Asked) -> None:
    """The tables and, where few settings differ, the figure of a sweep."""
    rows = told.rows
    few = has_scores(rows) and len(told.settings) <= MAX_DRAWN
    tables, left_out = page_tables(told)
    report = Report(
        title=f"{len(rows)} run{'s' if len(rows) != 1 else ''} compared",
        summary=summary(told),
        tables=tables,
        figures={"Held-out errors/by settings": sweep_figure(rows)} if few else {},
        config={"folders": [harmless(str(folder)) for folder in asked.folders]},
        versions=versions(),
        notes=[*notes, *left_out, f"{TABLE} has everything: relRMSE, epochs and seconds too."],
        unfolded=tuple(tables),
    )
    write_report(asked.out / PAGE, report)


def _begun(folder: Path) -> list[Path]:
    """Runs in a folder, without what a command left that was refused before it began."""
    return [job for job in job_folders(folder) if any((job / name).exists() for name in (CONFIG, SCORES, ERROR))]


def _passed_over(folders: Sequence[Path]) -> list[str]:
    """A line on folders without a run, such as those of a diagnosis; empty if there is none."""
    empty = [harmless(str(folder)) for folder in folders if not _begun(folder)]
    told = f"{', '.join(empty[:MAX_NAMED])}{' ...' if len(empty) > MAX_NAMED else ''}"
    return [f"no run of manoeuvre train is in {told}: passed over"] if empty else []


def compared(folders: Sequence[Path]) -> Comparison:
    """What runs differ in and what came out of each.

    Args:
        folders: Runs, or folders of runs.

    Returns:
        A row each run, best first: ``job``, its folder below what all share; settings that differ; what came out.

    Raises:
        InputError: If there is no run.
    """
    jobs = list(dict.fromkeys(Path(os.path.realpath(job)) for folder in folders for job in _begun(folder)))
    if not jobs:
        raise InputError(f"{', '.join(map(str, folders))}: no run of manoeuvre train is there; write {USAGE}")
    above = Path(os.path.commonpath([job.parent for job in jobs]))
    settings = [settings_of(job) for job in jobs]
    typed = {job: overrides_of(job / OVERRIDES) for job in jobs}
    written = set(chain.from_iterable(typed.values()))
    names = [name for name in differing(settings, written) if name != "seed"]  # which is among the results
    varied = swept_in(typed)
    names.sort(key=lambda name: (name not in varied, name not in written))
    rows = [
        {"job": harmless(str(job.relative_to(above))), **{name: said.get(name) for name in names}, **results_of(job)}
        for job, said in zip(jobs, settings, strict=True)
    ]
    order = sorted(columns(rows), key=lambda n: (n in AFTER_SCORES, n.startswith("relRMSE"), n.startswith(DEV)))
    rows = [{name: row.get(name) for name in order} for row in sorted(rows, key=error_of)]
    return Comparison(rows, names, sum(name in written for name in names))


def swept_in(typed: Mapping[Path, Mapping[str, Any]]) -> set[str]:
    """Settings that were swept: typed with several values in runs of one sweep.

    Args:
        typed: Folder of a run -> what was typed.

    Returns:
        Their names.
    """
    values: dict[tuple[Path, str], set[str]] = {}
    for job, said in typed.items():
        for name, value in said.items() if (job.parent / SWEEP).is_file() else ():
            values.setdefault((job.parent, name), set()).add(str(value))
    return {name for (_, name), several in values.items() if len(several) > 1}


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
    for name, value in flat(dict(config)).items():
        found[name] = value if isinstance(value, str | int | float) else "null" if value is None else str(value)
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
