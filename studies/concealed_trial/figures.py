"""Figures of a trial: reliability diagram, confusion matrix and power by strength, with one page that shows them."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from manoeuvre_nn.core.writing import draft_of
from studies.concealed_trial.effects import NAMES
from studies.concealed_trial.strength import DRIFT, STRENGTHS
from studies.concealed_trial.summaries import rate

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Of the tools (Okabe & Ito)."""
MARKS = "osD^vP"
NOTHING = "none"
FIGURES = {
    "reliability.png": "Stated probability against how often the effect was there; bars are 95 % Wilson intervals, "
    "the numbers at the bottom how many statements each tenth holds. On the diagonal a tool is calibrated.",
    "power.png": "Share of the cases that were detected, and whose first name was right, by the strength of their "
    "strongest effect: the root mean square distance, in ship lengths L, by which calm-water predictions then miss "
    "(sensors: their error against their noise). Bars are 95 % Wilson intervals; a case without an answer counts as "
    "missed.",
    "confusion.png": "What was there (rows) and the first name given (columns), for answered clean cases and single "
    "effects; numbers are cases, the shade their share of the row. Names on the diagonal are right, others are "
    "in bold: some of these count as right, as the recordings cannot tell them from what was there.",
}
"""Files and what they show."""
IN_WORDS = ("first name", "both names of pairs", "all names of triples", "unknown found", "false alarms",
            "predictions made worse")  # fmt: skip
"""Scores that the sentence of a tool tells."""


def write_figures(tools: Mapping[str, Mapping[str, Any]], out: Path) -> None:
    """Draw all figures of a trial, and show them with its scores on a page.

    Args:
        tools: ``board`` and ``cases`` of each tool, as in scoreboard.json; the confusion matrix is the first one's.
        out: Takes the PNG files and trial.html; holds scoreboard.md, if there is one.
    """
    from manoeuvre_nn.report.html import picture, write_page  # it loads torch, which no other stage needs

    first = next(iter(tools))
    drawn = {
        "reliability.png": reliability({name: tool["board"]["calibration"] for name, tool in tools.items()}),
        "power.png": power({name: tool["cases"] for name, tool in tools.items()}),
        "confusion.png": confusion(tools[first]["cases"], first),
    }
    for name, figure in drawn.items():
        _save(figure, out / name)
    shown = [(name.removesuffix(".png").title(), picture(FIGURES[name], figure)) for name, figure in drawn.items()]
    scores = (out / "scoreboard.md").read_text() if (out / "scoreboard.md").is_file() else ""
    said = [in_words(name, tool["board"]) for name, tool in tools.items()]
    write_page(
        out / "trial.html",
        "trial.html",
        "studies.concealed_trial",
        said=said,
        figures=shown,
        scores=list(blocks(scores)),
    )


def in_words(tool: str, board: Mapping[str, Any]) -> str:
    """What a tool did, in a sentence.

    Args:
        tool: Its name.
        board: Its scoreboard.

    Returns:
        The sentence; scores that do not apply are left out.
    """
    totals = board["totals"]
    parts = [f"{name} {score['right']} of {score['count']}" for name in IN_WORDS if (score := totals.get(name))]
    return f"{tool}, {totals['cases']} cases: {', '.join(parts)}."


def blocks(scoreboard: str) -> Iterator[tuple[str, Any]]:
    """Blocks of the scoreboard's Markdown, whose first heading the page has already.

    Args:
        scoreboard: The text.

    Yields:
        Kind and content: ``heading`` and its words, ``table`` and its rows, ``list`` and its items, ``text``.
    """
    for block in scoreboard.split("\n\n"):
        lines = block.strip().splitlines()
        if not lines or lines[0].startswith("# "):
            continue
        if lines[0].startswith("#"):
            yield "heading", lines[0].lstrip("# ")
        elif lines[0].startswith("|"):
            names, _, *rows = [line.strip("| ").split(" | ") for line in lines]
            yield "table", [dict(zip(names, row, strict=False)) for row in rows]
        elif lines[0].startswith("- "):
            yield "list", [line[2:] for line in lines]
        else:
            yield "text", " ".join(lines)


def _save(figure: Figure, path: Path) -> None:
    """Write a figure."""
    with draft_of(path) as draft:
        figure.savefig(draft, format="png", dpi=130)


def reliability(bins: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Stated probabilities against how often they were right.

    Args:
        bins: Calibration of each tool.

    Returns:
        The figure, one panel a tool.
    """
    figure = Figure(figsize=(4.2 * len(bins), 4.2), layout="constrained")
    for k, (tool, parts) in enumerate(bins.items()):
        axes: Axes = figure.add_subplot(1, len(bins), k + 1)
        axes.plot([0, 1], [0, 1], color="0.6", linestyle="--", linewidth=1)
        said, found = ([b[key] for b in parts] for key in ("said", "found"))
        spread = np.abs([[b["found"] - b["low"] for b in parts], [b["high"] - b["found"] for b in parts]])
        axes.errorbar(said, found, spread.reshape(2, -1), fmt=MARKS[k % 6], color=COLOURS[k % 6], capsize=3)
        for b in parts:  # in the middle of its bin, where neighbours cannot meet
            axes.text((b["from"] + b["to"]) / 2, -0.09, str(b["count"]), fontsize=8, ha="center", color="0.25")
        axes.set(xlim=(-0.06, 1.06), ylim=(-0.12, 1.06), xlabel="probability stated [-]", title=tool)
        axes.set_ylabel("share of statements with the effect present [-]" if k == 0 else "")
        axes.grid(alpha=0.25)
    return figure


def power(cases: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Detection and first name by strength.

    Args:
        cases: Scored cases of each tool.

    Returns:
        The figure with one panel for each of both.
    """
    panels = {"detected": "detected", "first_right": "first name right"}
    present = [s for s in STRENGTHS if any(row["strongest"] == s for rows in cases.values() for row in rows)]
    figure = Figure(figsize=(9.5, 3.8), layout="constrained")
    for panel, (key, title) in enumerate(panels.items()):
        axes: Axes = figure.add_subplot(1, 2, panel + 1)
        for k, (tool, rows) in enumerate(cases.items()):
            at = np.arange(len(present)) + 0.14 * (k - 0.5 * (len(cases) - 1))
            shares = [rate(row[key] for row in rows if row["strongest"] == s) for s in present]
            label: str | None = tool
            for x, share in zip(at, shares, strict=True):
                if share is None:
                    continue
                spread = [[share["share"] - share["low"]], [share["high"] - share["share"]]]
                colour, mark = COLOURS[k % 6], MARKS[k % 6]
                axes.errorbar(x, share["share"], np.abs(spread), fmt=mark, color=colour, capsize=3, label=label)
                label = None  # a tool is named once
        counts = [sum(row["strongest"] == s for row in next(iter(cases.values()))) for s in present]
        sizes = ["{:g}–{:g} L".format(*DRIFT[s]) for s in present]
        told = [f"{s}\n{size}\n{n} cases" for s, size, n in zip(present, sizes, counts, strict=True)]
        axes.set_xticks(range(len(present)), told)
        axes.set(ylim=(-0.04, 1.04), title=title, xlim=(-0.6, len(present) - 0.4))
        axes.set_ylabel("share of cases [-]" if panel == 0 else "")
        axes.grid(axis="y", alpha=0.25)
    if axes.get_legend_handles_labels()[1]:  # no tool has a share where no case had a cause
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def confusion(cases: Sequence[Mapping[str, Any]], tool: str) -> Figure:
    """What was there and the first name given.

    Args:
        cases: Scored cases of one tool.
        tool: Its name.

    Returns:
        The figure.
    """
    pairs = Counter(
        ((row["truth"] or [NOTHING])[0], row["first"]) for row in cases if len(row["truth"]) < 2 and row["answered"]
    )
    order = [NOTHING, *NAMES]
    said = [name for name in order if any(name in pair for pair in pairs)]
    there = [name for name in order if any(name == truth for truth, _ in pairs)]
    table = np.array([[pairs[truth, first] for first in said] for truth in there], float).reshape(len(there), len(said))
    figure = Figure(figsize=(4.0 + 0.34 * len(said), 3.0 + 0.3 * len(there)), layout="constrained")
    axes: Axes = figure.add_subplot(1, 1, 1)
    axes.imshow(table / np.maximum(table.sum(1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for row, column in zip(*np.nonzero(table), strict=True):
        dark = table[row, column] > 0.5 * table[row].sum()
        wrong = there[row] != said[column]
        axes.text(column, row, f"{table[row, column]:.0f}", ha="center", va="center", fontsize=9,
                  color="white" if dark else "black", fontweight="bold" if wrong else "normal")  # fmt: skip
    axes.set_xticks(range(len(said)), said, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(len(there)), there, fontsize=8)
    axes.set(xlabel=f"first name given by {tool}", ylabel="what was there")
    axes.set_xticks(np.arange(len(said) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(there) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="0.85", linewidth=0.5)
    axes.tick_params(which="minor", length=0)
    return figure
