"""Tables for the terminal, for files and for the HTML report; every table is first a list of rows."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

from manoeuvre_nn.core.writing import draft_of
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.scoring.score import SCORED_CHANNELS, Score
from manoeuvre_nn.scoring.verdict import MAX_DEV_L, ModelVerdict

Row = Mapping[str, Any]
"""Column heading -> cell. Cells are numbers, strings, or None where there is nothing."""

Baselines = Mapping[str, Sequence[Score]]
"""Simpler models than the network -> their scores on the same manoeuvres."""
CRITERIA = "criteria, predicted (recorded)"
"""Heading of their column."""
UNIT_SUFFIXES = {"deg": "deg", "s": "s", "L": "L", "deg_s": "deg/s", "m": "m", "m_s": "m/s"}
"""Endings of criteria names and the units that they stand for."""
FAR_OFF = "far off"
"""What a run is that went on to its end, but further from the recorded track than a usable model's."""
GOOD, BAD = (
    frozenset({"ok", "pass", "passed", "met", "yes", "finished", "usable"}),
    frozenset({"fail", "failed", "no", "not met", "mend", "refuse", "do not use", FAR_OFF}),
)
"""Words that are good and bad."""
STYLES = {True: "green", False: "bold red", None: ""}
"""How they are shown in the terminal."""
LONG_TEXT = 40
"""Letters from which on a cell of a page may be broken into lines."""


def text(value: Any, digits: int = 4) -> str:
    """A cell as people read it: a number to so many digits, a dash where there is nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{float(f'{value:.{digits}g}'):.6g}" if abs(value) < 1e4 else f"{value:.{digits - 1}e}"
    return str(value)


def columns(rows: Sequence[Row]) -> list[str]:
    """Headings of all rows, which need not have the same, in the order in which they first appear."""
    return list(dict.fromkeys(name for row in rows for name in row))


def criterion_label(name: str) -> tuple[str, str]:
    """A criterion's name as people read it: ``overshoot_1_deg`` is ``overshoot 1`` in ``deg``."""
    for suffix in sorted(UNIT_SUFFIXES, key=len, reverse=True):
        if name.endswith(f"_{suffix}"):
            return name.removesuffix(f"_{suffix}").replace("_", " "), UNIT_SUFFIXES[suffix]
    return name.replace("_", " "), ""


def _criteria_text(score: Score) -> str:
    """Predicted and recorded values of the main criteria."""
    said = []
    for name in (score.main_criteria or [*{**score.reference, **score.criteria}])[:3]:  # of other kinds the first three
        words, unit = criterion_label(name)
        predicted, recorded = (text(values.get(name), 3) for values in (score.criteria, score.reference))
        said.append(f"{words}: {predicted} ({recorded}) {unit}".rstrip())
    return ", ".join(said)


def score_rows(scores: Iterable[Score], baselines: Baselines | None = None) -> list[dict[str, Any]]:
    """Scores as rows for files and the HTML report.

    Args:
        scores: One a manoeuvre.
        baselines: Simpler models -> their scores on the same manoeuvres.

    Returns:
        One row a manoeuvre: status, dev/L, that of the simpler models, and nRMSE.
    """
    return [
        {
            "manoeuvre": s.manoeuvre,
            "status": status_word(s),
            "dev/L": s.dev_L,
            **({} if s.spread_L is None else {"spread/L": s.spread_L}),
            **{f"{name} dev/L": dev for name, dev in _beside(baselines, s.manoeuvre)},
            **{f"nRMSE {name}": s.nrmse.get(name) for name in SCORED_CHANNELS},
        }
        for s in scores
    ]


def status_word(score: Score) -> str:
    """How a run ended, and of one that went on to its end whether it stayed near the recorded track."""
    return FAR_OFF if score.status == OK and score.dev_L > MAX_DEV_L else score.status


def main_criteria_rows(scores: Iterable[Score]) -> list[dict[str, Any]]:
    """A row each manoeuvre that has criteria: the main ones, predicted (recorded)."""
    return [{"manoeuvre": s.manoeuvre, CRITERIA: said} for s in scores if (said := _criteria_text(s))]


def _beside(baselines: Baselines | None, manoeuvre: str) -> list[tuple[str, float]]:
    """dev/L of simpler models in a manoeuvre."""
    return [(name, s.dev_L) for name, scores in (baselines or {}).items() for s in scores if s.manoeuvre == manoeuvre]


def criteria_rows(scores: Iterable[Score]) -> list[dict[str, Any]]:
    """All criteria of all manoeuvres, predicted beside recorded; no error where either side has no such value."""
    rows = []
    for s in scores:
        for name in dict.fromkeys([*s.reference, *s.criteria]):
            words, unit = criterion_label(name)
            values = {"predicted": s.criteria.get(name), "recorded": s.reference.get(name)}
            rows.append({
                "manoeuvre": s.manoeuvre,
                "criterion": words,
                "unit": unit or "-",
                **values,
                "error": s.errors.get(name),
            })
    return rows


def rich_table(rows: Sequence[Row], title: str = "") -> Table:
    """Rows as a table for the terminal; numbers stand right, status words are coloured."""
    table = _bare_table(title)
    for name in columns(rows):
        numeric = any(_is_number(row.get(name)) for row in rows)
        table.add_column(Text(name), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(_coloured(text(row.get(name), 3)) for name in columns(rows)))
    return table


def _bare_table(title: str) -> Table:
    """A table with a rule below the heading and no other lines."""
    return Table(
        title=Text(title) if title else None,
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )


def score_table(
    scores: Sequence[Score], baselines: Baselines | None = None, title: str = "Held-out manoeuvres"
) -> Group:
    """Scores for the terminal, within 80 columns.

    Args:
        scores: One a manoeuvre.
        baselines: Simpler models -> their scores on the same manoeuvres.
        title: Heading.

    Returns:
        A table of manoeuvre, status, dev/L, how far an ensemble's members go apart and dev/L of the simpler models, or
        where there are none of these nRMSE of u, v, r, psi; and one of the main criteria, predicted (recorded).
    """
    table = _bare_table(title)
    banded, others = any(s.spread_L is not None for s in scores), list(baselines or {})
    headings = ["dev/L", *(["spread"] if banded else []), *(others or SCORED_CHANNELS)]
    what = f"{', '.join(others)}: dev/L of simpler models" if others else "u v r psi: RMS error / std"
    apart = "; spread: of the members" if banded else ""
    table.caption = f"dev: largest track distance{apart}; {what}"
    # Names of files are long: folded, they can still be told apart.
    table.add_column("manoeuvre", min_width=10, max_width=16, overflow="fold")
    table.add_column("status", max_width=10)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    found = _bare_table("")
    for s in scores:
        beside = [dev for _, dev in _beside(baselines, s.manoeuvre)] if others else map(s.nrmse.get, SCORED_CHANNELS)
        numbers = [text(s.dev_L, 3), *([text(s.spread_L, 2)] if banded else []), *(text(x, 2) for x in beside)]
        table.add_row(*map(_coloured, (s.manoeuvre, status_word(s), *numbers)))
    found.add_column("manoeuvre", min_width=10, max_width=16, overflow="fold")
    found.add_column(CRITERIA)
    for row in main_criteria_rows(scores):
        found.add_row(*map(_coloured, row.values()))
    return Group(table, *([found] if found.row_count else []))


def verdict_text(verdict: ModelVerdict) -> Text:
    """What a model may be used for, for the terminal; its first words are coloured."""
    said = Text(verdict.sentence)
    said.stylize(STYLES[is_good(verdict.word)], 0, len(verdict.word))
    return said


def is_good(cell: str) -> bool | None:
    """Whether a cell is a good word (True), a bad one (False), or neither (None)."""
    word = cell.strip().lower()
    bad = word in BAD or word.startswith(("left the physical range", "failed"))
    return True if word in GOOD | {OK} else False if bad else None


def _coloured(cell: str) -> Text:
    """A cell for the terminal; as it is not markup, brackets in it are shown and not obeyed."""
    return Text(cell, STYLES[is_good(cell)])


def _is_number(value: Any) -> bool:
    """Whether a cell is a number to be set right."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def write_csv(path: Path, rows: Sequence[Row]) -> Path:
    """Write rows with all their digits, and return the file."""
    with draft_of(path) as draft:
        pd.DataFrame(list(rows), columns=columns(rows)).to_csv(draft, index=False, float_format="%.10g")
    return path


def to_markdown(rows: Sequence[Row], digits: int = 4) -> str:
    """Rows as a Markdown table that ends in a line break; empty without rows."""
    if not rows:
        return ""
    names = columns(rows)
    rules = ["---:" if any(_is_number(row.get(name)) for row in rows) else "---" for name in names]
    body = [[text(row.get(name), digits) for name in names] for row in rows]
    lines = [
        [_markdown_cell(name) for name in names],
        rules,
        *([_markdown_cell(cell) for cell in line] for line in body),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _markdown_cell(cell: str) -> str:
    """A cell's text where bars and line breaks would end it."""
    return cell.replace("\\", "\\\\").replace("|", "\\|").replace("\n", "<br>")


def html_cells(rows: Sequence[Row], digits: int = 3) -> dict[str, Any]:
    """Rows as a page shows them.

    Args:
        rows: The rows.
        digits: Significant digits of numbers.

    Returns:
        ``headings``, and ``rows`` of cells: text, and the style class ``number``, ``good``, ``bad``, ``long`` or none.
    """
    names = columns(rows)
    of_words = {name for name in names if any(isinstance(row.get(name), str) for row in rows)}
    return {"headings": names, "rows": [[_html_cell(row.get(n), n in of_words, digits) for n in names] for row in rows]}


def _html_cell(value: Any, of_words: bool, digits: int) -> tuple[str, str]:
    """Text and style class of one cell; an empty one stands as its column does."""
    shown = text(value, digits)
    if _is_number(value) or (value is None and not of_words):
        return shown, "number"
    return shown, {True: "good", False: "bad", None: "long" if len(shown) > LONG_TEXT else ""}[is_good(shown)]
