"""What came out of many runs: one table and one figure for the jobs of a sweep."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.table import Table

from manoeuvre_nn.core.data_files import OVERRIDES, load_json, overrides_of
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.report.columns import JOBS
from manoeuvre_nn.report.html import Report, save_figure, write_report
from manoeuvre_nn.report.style import COLOURS, FIGURE_WIDTH_IN, MARKERS, legend_below, log_axis, new_figure, plain_axes
from manoeuvre_nn.report.tables import Row, columns, rich_table, text, to_markdown, write_csv

SCORES, ERROR = "scores.json", "error.txt"
"""Files of a job's folder: what it scored, what was swept, and why it failed."""
MEAN, DEV = "mean dev/L", "dev/L "
"""Columns of the mean and, followed by its name, of each held-out manoeuvre."""
RMS = "RMS "
"""Column of the error of each set of records, followed by its name and unit, where a response is approximated."""
LEARNT = f"{RMS}learning"
"""Start of the column of records that were learnt."""
RESULTS = ("job", "status", "verdict", "ended early", MEAN, "seed", "epochs", "stopped", "seconds")
"""Columns that are not settings, beside those that start with ``dev/L``, ``RMS`` or ``relRMSE``."""


def job_folders(folder: Path) -> list[Path]:
    """Runs in a folder: every folder in it, or itself, that holds scores, overrides or an error; job 10 after job 9."""
    jobs = {path.parent for name in (SCORES, ERROR) for path in folder.rglob(name)}
    jobs |= {path.parents[1] for path in folder.rglob(OVERRIDES)}
    return sorted(jobs, key=lambda path: _natural(str(path.relative_to(folder))))


def sweep_rows(folder: Path) -> list[dict[str, Any]]:
    """Collect what the jobs of a sweep left behind.

    Args:
        folder: The sweep's folder.

    Returns:
        One row a job, by job number: job, overrides, and what came out, see :func:`results_of`.

    Raises:
        InputError: If there is no job.
    """
    jobs = job_folders(folder)
    if not jobs:
        raise InputError(f"{folder} holds no runs: expected folders with {SCORES}, as manoeuvre train -m leaves them")
    return [{"job": str(job.relative_to(folder)), **overrides_of(job / OVERRIDES), **results_of(job)} for job in jobs]


def _natural(name: str) -> list[tuple[int, str]]:
    """Sorting key that puts job 10 after job 9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def results_of(job: Path) -> dict[str, Any]:
    """What came out of a run.

    Args:
        job: Its folder.

    Returns:
        status (``finished``, ``unfinished``, or ``failed:`` and the first line of the error), verdict, dev/L of each
        manoeuvre and their mean, manoeuvres that ended early, relRMSE of g, epochs, seconds. What a damaged or missing
        file would have told is not there.
    """
    scores = _read_json(job / SCORES)
    return {"status": _status(job, scores), **(_results(scores) if scores else {})}


def _status(job: Path, scores: Mapping[str, Any] | None) -> str:
    """How the job ended."""
    if (job / ERROR).is_file():
        lines = (job / ERROR).read_text(errors="replace").strip().splitlines()
        return f"failed: {lines[0].strip() if lines else 'no message'}"
    if scores:
        return "finished"
    return f"failed: {SCORES} is damaged" if (job / SCORES).is_file() else "unfinished"


def _read_json(path: Path) -> dict[str, Any] | None:
    """What a file holds; None if it is missing, damaged or not a mapping."""
    try:
        found = load_json(path)
    except (OSError, InputError):
        return None
    return found if isinstance(found, dict) else None


def _results(scores: Mapping[str, Any]) -> dict[str, Any]:
    """Columns out of ``scores.json``; only what is there."""
    scored = _mapping(scores.get("scores"))
    scored = {name: _mapping(score) for name, score in scored.items()}
    training = _mapping(scores.get("training"))
    ended = [name for name, score in scored.items() if score.get("status", OK) != OK]
    verdict = _mapping(scores.get("verdict")).get("word")
    row: dict[str, Any] = {"verdict": verdict, "ended early": " ".join(ended) or None, MEAN: scores.get("mean_dev_L")}
    row |= {f"{DEV}{name}": score.get("dev_L") for name, score in scored.items()}
    errors = {name: _mapping(error).get("rms") for name, error in _mapping(scores.get("errors")).items()}
    row |= {f"{RMS}{name} [{scores.get('unit')}]": error for name, error in errors.items()}
    row |= {f"relRMSE {name}": error for name, error in _mapping(training.get("relrmse")).items()}
    row |= {"seed": scores.get("seed"), **{name: training.get(name) for name in ("epochs", "stopped", "seconds")}}
    return {name: _cell(value) for name, value in row.items() if value is not None}


def _cell(value: Any) -> str | int | float:
    """A result as a cell: lists and tables, which only a damaged file holds there, as text."""
    return value if isinstance(value, str | int | float) else str(value)


def _mapping(value: Any) -> dict[str, Any]:
    """The value if it is a mapping; else an empty one."""
    return value if isinstance(value, dict) else {}


def swept(rows: Sequence[Row]) -> list[str]:
    """Settings that differ between jobs, the one with the most values first, repeats (``seed``) last; or the first."""
    settings = [name for name in columns(rows) if name not in RESULTS and not name.startswith((DEV, RMS, "relRMSE"))]
    if any("seed" in row for row in rows):
        settings.append("seed")
    values = {name: {str(row[name]) for row in rows if row.get(name) is not None} for name in settings}
    differ = [name for name in settings if len(values[name]) > 1]
    return sorted(differ or settings[:1], key=lambda name: (name == "seed", -len(values[name])))


def short_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Settings that differ (else the job), status, mean dev/L, the worst manoeuvre, verdict, seconds; best first."""
    names = swept(rows)
    short = []
    for row in sorted(rows, key=error_of):
        errors = {n: row.get(n) for n in columns(rows) if n.startswith(RMS) and not n.startswith(LEARNT)}
        # The settings that differ say which job it is; its folder's name would only repeat them.
        named = {short_name(name, names): row.get(name) for name in names}
        cells = named if any(value is not None for value in named.values()) else {"job": row["job"]}
        cells |= {"status": status_of(row), MEAN: row.get(MEAN), **errors}
        cells |= {"worst": worst_of(row), "verdict": row.get("verdict")}
        short.append({**cells, "seconds": row.get("seconds")})
    headings = dict.fromkeys(name for row in short for name in row)
    return [{n: row.get(n) for n in headings if any(r.get(n) is not None for r in short)} for row in short]


def status_of(row: Row) -> str:
    """How a run ended, or how many of its manoeuvres ended early."""
    ended = len(str(row.get("ended early") or "").split())
    return f"{ended} ended early" if ended else str(row["status"])


def worst_of(row: Row) -> str | None:
    """The manoeuvre with the largest dev/L, and that; None if none has a number."""
    numbers = {name.removeprefix(DEV): _number(value) for name, value in row.items() if name.startswith(DEV)}
    devs = {name: dev for name, dev in numbers.items() if np.isfinite(dev)}
    worst = max(devs, key=lambda name: devs[name], default=None)
    return worst and f"{worst} {devs[worst]:.3g}"


def error_of(row: Row) -> float:
    """By what jobs are put in order: the mean dev/L, or the error of the records kept for validation or testing."""
    starts = (MEAN, f"{RMS}validation", f"{RMS}testing")
    found = [row[name] for start in starts for name in row if name.startswith(start)]
    return _number(next(iter(found), None), float("inf"))


def why_no_best(rows: Sequence[Row]) -> str:
    """Why errors of runs cannot be set beside each other.

    Args:
        rows: One a run.

    Returns:
        The reason; empty if all that have a score are of one ship and scored on the same.
    """
    scored = [row for row in rows if error_of(row) < float("inf")]
    ships = {tuple(str(row[n]) for n in columns(rows) if n in row and f"{n}.".startswith("ship.")) for row in scored}
    if len(ships) > 1:
        return "the runs are of different ships"
    of_scores = [name for name in columns(rows) if name.startswith((DEV, RMS)) and not name.startswith(LEARNT)]
    sets = {tuple(name for name in of_scores if row.get(name) is not None) for row in scored}
    return "the runs are not scored on the same manoeuvres or records" if len(sets) > 1 else ""


def short_name(name: str, names: Sequence[str]) -> str:
    """``network.hidden`` as a heading has room for it: ``hidden``, unless another setting ends in the same word."""
    last = name.rpartition(".")[2]
    return last if sum(other.rpartition(".")[2] == last for other in names) == 1 else name


def _number(value: Any, otherwise: float = float("nan")) -> float:
    """A finite number, or another where there is none."""
    fine = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
    return float(value) if fine else otherwise


def sweep_figure(rows: Sequence[Row]) -> Figure:
    """dev/L of each held-out manoeuvre, or the error of each set of records, against what was swept, logarithmic.

    One setting: a curve a manoeuvre. Several: the one with the most values along the axis, a panel a manoeuvre, a curve
    a combination of the others. Repeats (same settings, other seed) are points, and the curve goes through their
    median; a cross is a prediction that was ended early.

    Args:
        rows: One a job.

    Returns:
        The figure.

    Raises:
        InputError: If no job has a score.
    """
    along, *others = swept(rows) or ["job"]
    points = _points(rows, along, [name for name in others if name != "seed"])
    if points.empty:
        raise InputError("no job of the sweep has a score, so there is nothing to draw: see the status of each job")
    label = "held-out dev/L [-]" if any(name.startswith(DEV) for name in columns(rows)) else "RMS error"
    panels, labels = list(points.panel.unique()), list(points.label.unique())
    tall, wide = -(-len(panels) // 2), min(len(panels), 2)
    figure = new_figure(1.2 + 2.6 * tall + 0.18 * len(labels), width=7.0 if wide > 1 else FIGURE_WIDTH_IN)
    grid = figure.subplots(tall, wide, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, panel in zip(grid, panels, strict=False):
        log_axis(plain_axes(axes, along, label if axes.get_subplotspec().is_first_col() else "")).set_title(
            panel, fontsize=10, loc="left"
        )
        for one, curve in points[points.panel == panel].groupby("label", sort=False):
            _draw_curve(axes, curve, _look(labels.index(one)))
        _mark_values(axes, points.value)
        axes.tick_params(labelbottom=True)  # the panel below may be empty
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    handles = [Line2D([], [], label=label, linestyle="", **_look(k)) for k, label in enumerate(labels)]
    if points.ended.any():
        handles.append(Line2D([], [], label="ended early", color="black", marker="x", linestyle=""))
    legend_below(figure, handles, columns=5 if panels == [""] else 2)
    return figure


def _points(rows: Sequence[Row], along: str, others: Sequence[str]) -> pd.DataFrame:
    """A line each score: panel, label, value of the setting along the axis, dev/L, whether it was ended early."""
    scored = {name.removeprefix(DEV).removeprefix(RMS): name for name in columns(rows) if name.startswith((DEV, RMS))}
    points = []
    for manoeuvre, column in scored.items():
        for row in rows:
            rest = ", ".join(f"{short_name(name, others)} {row.get(name)}" for name in others)
            panel, label = (manoeuvre, rest) if others else ("", manoeuvre)
            ended = manoeuvre in str(row.get("ended early", "")).split()
            points.append((panel, label, row.get(along), _number(row.get(column)), ended))
    table = pd.DataFrame(points, columns=["panel", "label", "value", "dev", "ended"])
    table = table[table.value.notna() & (table.dev > 0)].infer_objects()
    return table if pd.api.types.is_numeric_dtype(table.value) else table.assign(value=table.value.map(str))


def _look(index: int) -> dict[str, Any]:
    """Colour and marker of a curve."""
    return {"color": COLOURS[index % len(COLOURS)], "marker": MARKERS[index % len(MARKERS)], "markersize": 4.5}


def _draw_curve(axes: Axes, curve: pd.DataFrame, look: Mapping[str, Any]) -> None:
    """Points of one curve and, where the setting is a number, the line through their medians."""
    for ended, marker in ((False, look["marker"]), (True, "x")):
        some = curve[curve.ended == ended]
        if len(some):
            points: dict[str, Any] = {**look, "marker": marker, "linestyle": ""}
            axes.plot(some.value.to_list(), some.dev.to_list(), **points)
    if pd.api.types.is_numeric_dtype(curve.value):
        medians = curve.groupby("value").dev.median()
        axes.plot(medians.index.to_list(), medians.to_list(), color=look["color"], linewidth=1.3)


def _mark_values(axes: Axes, values: pd.Series) -> None:
    """Ticks at the values that were tried; logarithmic where they go far."""
    if not pd.api.types.is_numeric_dtype(values):
        axes.margins(x=0.15)  # matplotlib sets words side by side
        return
    if values.min() > 0 and values.max() >= 30 * values.min():
        log_axis(axes, "x")
    if values.nunique() <= 8:
        tried = sorted(values.unique())
        axes.set_xticks(tried, [f"{value:g}" for value in tried])


def heat_map(rows: Sequence[Row]) -> Figure | None:
    """Error over the two settings with the most values, a cell each pair that says its number.

    Jobs that differ in other settings or in the seed alone share a cell, which holds their median.

    Args:
        rows: One a job.

    Returns:
        The figure; None if fewer than two settings differ, or no job has an error.
    """
    names = [name for name in swept(rows) if name != "seed"]
    cells = pd.DataFrame([{**{n: row.get(n) for n in names}, "error": error_of(row)} for row in rows])
    cells = cells[(cells.error > 0) & (cells.error < float("inf"))]
    if len(names) < 2 or cells.empty:
        return None
    along, up = names[:2]
    table = cells.pivot_table(index=up, columns=along, values="error", aggfunc="median")
    figure = new_figure(1.6 + 0.5 * len(table), title="median error of each pair")
    axes = plain_axes(figure.subplots(), along, up)
    values = table.to_numpy(float)
    scale = LogNorm(cells.error.min(), max(cells.error.max(), 1.01 * cells.error.min()))
    image = axes.pcolormesh(values, norm=scale, cmap="Blues", edgecolors="white", linewidth=1.5)
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            ink = "white" if scale(value) > 0.6 else "black"
            axes.text(column + 0.5, row + 0.5, f"{value:.3g}", ha="center", va="center", color=ink, fontsize=9)
    axes.set_xticks(np.arange(len(table.columns)) + 0.5, [str(value) for value in table.columns])
    axes.set_yticks(np.arange(len(table.index)) + 0.5, [str(value) for value in table.index])
    axes.grid(visible=False)
    label = MEAN if any(MEAN in row for row in rows) else "RMS error"
    figure.colorbar(image, ax=axes, label=f"{label} [-]" if label == MEAN else label)
    return figure


def write_sweep(folder: Path) -> Table:
    """Write ``sweep.csv``, ``sweep.md``, ``sweep.html`` and figures if any job has a score; return a table to print."""
    rows = sweep_rows(folder)
    write_csv(folder / "sweep.csv", rows)
    short = short_rows(rows)
    write_file(folder / "sweep.md", to_markdown(short))
    figures = {}
    if has_scores(rows):
        drawn = {"sweep": sweep_figure(rows), "sweep_map": heat_map(rows)}
        figures = {name: figure for name, figure in drawn.items() if figure is not None}
        for name, figure in figures.items():
            save_figure(figure, folder / f"{name}.png", dpi=150)
    told = {name: value for name, value in short[0].items() if value not in (None, "finished") and name != "seconds"}
    best = ", ".join(f"{name} {text(value, 3)}" for name, value in told.items())
    why = why_no_best(rows)
    said = f"{len(rows)} jobs; no best is named: {why}." if why else f"Best of {len(rows)} jobs: {best}."
    named = {f"Errors over what was swept/{name}": figure for name, figure in figures.items()}
    page = Report(f"Sweep {folder.name}", said, {JOBS: short}, named, unfolded=(JOBS,))
    write_report(folder / "sweep.html", page)
    return rich_table(short, f"Sweep {folder.name}")


def has_scores(rows: Sequence[Row]) -> bool:
    """Whether there is anything to draw."""
    return any(name.startswith((DEV, RMS)) for name in columns(rows))
