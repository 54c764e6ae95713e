"""The job of ``manoeuvre check``: every check of every file, a page, figures and JSON."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import known_part
from manoeuvre_nn.commands.provenance import shown, versions, write_provenance
from manoeuvre_nn.commands.shelves import plain
from manoeuvre_nn.core.ending import WRONG_INPUT
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.estimation.record_information import excitation_findings
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.check.inspection import Inspection, inspect_file
from manoeuvre_nn.recording.read.mapping import Mapping
from manoeuvre_nn.recording.read.mapping_file import mapping_of
from manoeuvre_nn.recording.read.reader import place_of, recordings_in
from manoeuvre_nn.recording.thinning import thinned
from manoeuvre_nn.report.chart import Chart
from manoeuvre_nn.report.check_figures import check_chart, check_figure
from manoeuvre_nn.report.check_tables import (
    checks_json,
    drift_rows,
    finding_rows,
    overview_rows,
    remedy_rows,
    sentence,
    together_rows,
    trouble_rows,
)
from manoeuvre_nn.report.html import Report, save_figure, write_report
from manoeuvre_nn.report.tables import rich_table
from manoeuvre_nn.training.settings import expand

PAGE, RESULT = "checks.html", "findings.json"
DRIFTS = "Drift of the turning circles"
REMEDIES = "Write into the mapping of each file"
MAX_RECORDINGS_WITH_NOTES = 6
"""Recordings up to which the terminal shows notes too."""
MAX_ZOOMED = 8
"""Recordings up to which the figures of the page can be zoomed: of more it would become heavy."""


def check_or_refuse(cfg: DictConfig, out: Path) -> None:
    """Check all files; a file that is refused shows in the exit code.

    Raises:
        SystemExit: With code 2 if one is.
    """
    if any(one.verdict == "refuse" for one in check(cfg, out)):
        raise SystemExit(WRONG_INPUT)


def check(cfg: DictConfig, out: Path, console: Console | None = None) -> list[Inspection]:
    """Check all files and write everything to a folder; what was found comes file by file."""
    console = console or Terminal()
    use_threads(1)
    drawn = cfg.figures
    ship, known = known_part(cfg)
    particulars = ship.particulars
    paths = _files(cfg)
    columns = configs.read_mapping(cfg.data.mapping, cfg.get("config_dir")) or mapping_of(paths[0])
    write_provenance(cfg, out)
    found = []
    with waiting(console) as say:
        for k, path in enumerate(paths, start=1):
            say(f"checking {path.name} ({k} of {len(paths)})", (k - 1) / len(paths))
            found.append(_with_information(inspect_file(path, columns, particulars), known))
        say("what the recordings can identify")
        usable = _usable(found, known)
        together = excitation_findings(usable, known) if len(usable) > 1 else []
        say("drawing")
        charts = _charts(found, particulars) if drawn else {}
        _write(found, together, columns, charts, cfg, out)
    _print(found, together, columns, out, console)
    return found


def _files(cfg: DictConfig) -> list[Path]:
    """Files that are named, or all of the folder."""
    folder = place_of(str(cfg.data.folder))
    names = configs.names(cfg.data.files)
    paths = expand(folder, names, "data.files")
    if names:
        return paths
    there = recordings_in(folder)
    if not there:
        raise InputError(f"data.folder={folder} holds no recording: write the folder that holds the files")
    return there


def _with_information(one: Inspection, known: Ship) -> Inspection:
    """The same with findings on what the record can identify, if its units are right."""
    usable = _usable([one], known)
    more = excitation_findings(usable, known) if usable else []
    return replace(one, findings=(*one.findings, *more))


def _usable(found: Sequence[Inspection], known: Ship) -> list[Recording]:
    """Recordings whose units are right, without outliers."""
    clean = [one.clean for one in found if one.verdict != "refuse"]
    return [thinned(c, known.particulars) for c in clean if c is not None]


def _charts(found: Sequence[Inspection], ship: Particulars) -> dict[str, Chart]:
    """A chart for each recording that was read."""
    made = {one.name: check_chart(one, ship) for one in found}
    return {name: chart for name, chart in made.items() if chart is not None}


def _write(
    found: Sequence[Inspection],
    together: Sequence[Finding],
    columns: Mapping,
    charts: dict[str, Chart],
    cfg: DictConfig,
    out: Path,
) -> None:
    """Figures, page and JSON."""
    figures = {name: check_figure(chart, name) for name, chart in charts.items()}
    for name, figure in figures.items():
        save_figure(figure, out / "figures" / f"{name}.png", dpi=110)
    tables = {"Recordings": overview_rows(found), REMEDIES: remedy_rows(found, columns)}
    tables["Sensors, over all recordings"] = together_rows(found)
    if drifts := drift_rows(found):
        tables[DRIFTS] = drifts
    if together:
        tables["All recordings together"] = finding_rows(together)
    tables |= {one.name: finding_rows(one.findings) for one in found}
    report = Report(
        title="Checks of the recordings",
        summary=sentence(found),
        tables=tables,
        figures={f"{name}/channels": figure for name, figure in figures.items()},
        charts={f"{name}/channels": chart for name, chart in charts.items()} if len(charts) <= MAX_ZOOMED else {},
        config=plain(cfg),
        versions=versions(),
        unfolded=("Recordings", REMEDIES, "Sensors, over all recordings", DRIFTS),
    )
    write_report(out / PAGE, report)
    told = checks_json(found, columns, together, versions())
    write_file(out / RESULT, json.dumps(told, indent=1))


def _print(
    found: Sequence[Inspection], together: Sequence[Finding], columns: Mapping, out: Path, console: Console
) -> None:
    """What is wrong, what to write, and where the rest is."""
    rows = trouble_rows(found, "note" if len(found) <= MAX_RECORDINGS_WITH_NOTES else "mend")
    if rows:
        console.print(rich_table(rows, "What was found"))
    sensors = [row for row in together_rows(found) if not row["found in"].startswith("0 ")]
    if sensors:
        console.print(rich_table(sensors, "Sensors, over all recordings"))
    if drifts := drift_rows(found):
        console.print(rich_table(drifts, DRIFTS))
    for f in together:
        console.print(f"all together: {f}", highlight=False)
    remedies = remedy_rows(found, columns)
    if remedies:
        console.print(f"{REMEDIES}:", highlight=False)
    for row in remedies:
        console.print(f"  {row['recording']}: {row['settings']}", highlight=False)
    console.print(sentence(found), highlight=False)
    here = shown(out)
    console.print(f"report: {here / PAGE}   numbers: {here / RESULT}", soft_wrap=True, highlight=False)
