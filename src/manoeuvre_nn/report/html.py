"""One HTML file that holds a whole report: no external resource, opens offline, on a phone, light or dark."""

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from manoeuvre_nn.report.tables import Row, columns, is_good, text

TRAINING = "training"
"""Section of the figures that belong to no manoeuvre."""
LONG_TABLE = 12
"""Tables with more rows are folded away until they are asked for."""
LONG_TEXT = 40
"""Letters from which on a cell may be broken into lines."""


def write_report(
    path: Path,
    *,
    title: str,
    summary: str,
    tables: Mapping[str, Sequence[Row]],
    figures: Mapping[str, Figure],
    config_yaml: str,
    versions: Mapping[str, Any],
    notes: Sequence[str] = (),
    unfolded: Sequence[str] = (),
) -> Path:
    """Write a report.

    The verdict comes first, then the tables, the figures of each manoeuvre, what the network was trained on, and folded
    away the resolved configuration and the versions. Everything that is given as text is escaped.

    Args:
        path: File to write.
        title: Heading.
        summary: The verdict, one sentence.
        tables: Heading -> rows.
        figures: Name -> figure. ``zz20/track`` goes to the section ``zz20``; ``training/...`` and a name without a
            stroke to the one about training.
        config_yaml: Resolved configuration.
        versions: Package, system, seed or commit -> what it was.
        notes: Sentences on what it was trained on and on what to mind.
        unfolded: Headings of tables that are shown whatever their length.

    Returns:
        The file.
    """
    sections = _sections(figures)
    page = environment().get_template("page.html")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        page.render(
            title=title,
            summary=summary,
            tables={heading: _cells(rows, heading in unfolded) for heading, rows in tables.items() if rows},
            training=sections.pop(TRAINING, []),
            sections=sections,
            notes=notes,
            config_yaml=config_yaml,
            versions=versions,
        ),
        encoding="utf-8",
    )
    return path


def environment() -> Environment:
    """Templates of this shelf; every value is escaped, a forgotten one is an error.

    Returns:
        The environment.
    """
    return Environment(
        loader=PackageLoader("manoeuvre_nn.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _sections(figures: Mapping[str, Figure]) -> dict[str, list[tuple[str, str]]]:
    """Section -> (caption, image as a data address) in the order given."""
    sections: dict[str, list[tuple[str, str]]] = {}
    for name, figure in figures.items():
        section, _, caption = name.rpartition("/")
        sections.setdefault(section or TRAINING, []).append((caption, data_address(figure)))
    return sections


def _cells(rows: Sequence[Row], unfolded: bool = False) -> dict[str, Any]:
    """Headings and cells of a table: (text, style class)."""
    names = columns(rows)
    folded = len(rows) > LONG_TABLE and not unfolded
    words = {name for name in names if any(isinstance(row.get(name), str) for row in rows)}
    cells = [[_cell(row.get(name), name in words) for name in names] for row in rows]
    return {"folded": folded, "headings": names, "rows": cells}


def _cell(value: Any, of_words: bool) -> tuple[str, str]:
    """Text and style class of one cell; an empty one stands as its column does."""
    shown = text(value, 3)
    if (value is None and not of_words) or (isinstance(value, int | float) and not isinstance(value, bool)):
        return shown, "number"
    return shown, {True: "good", False: "bad", None: "long" if len(shown) > LONG_TEXT else ""}[is_good(shown)]


def data_address(figure: Figure) -> str:
    """A figure as an address that carries the image itself.

    An image of its own, unlike SVG among the page's elements, cannot share identifiers with another one.

    Args:
        figure: The figure.

    Returns:
        ``data:image/svg+xml;base64,...``; the same figure always gives the same text.
    """
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "manoeuvre-nn"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=150)
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
