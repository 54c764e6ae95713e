"""One HTML file that holds a whole report: no external resource, opens offline, on a phone, light or dark."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import yaml
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from manoeuvre_nn.core.plain_text import as_file_name, harmless
from manoeuvre_nn.core.writing import draft_of, write_file
from manoeuvre_nn.report.tables import Row, columns, html_cells, text

TRAINING = "training"
"""Section of the figures that belong to no manoeuvre."""
LONG_TABLE = 12
"""Tables with more rows are folded away until they are asked for."""


@dataclass(frozen=True)
class Report:
    """What a page shows: the summary first, then tables, figures by section, notes, and how to repeat the run.

    Attributes:
        title: Heading.
        summary: What came out, one sentence.
        tables: Heading -> rows; a table without rows is left out.
        figures: Name -> figure. ``zz20/track`` goes to the section ``zz20``; ``training/...`` and a name without a
            stroke to the one about training.
        config: Resolved configuration.
        versions: Package, system, seed or commit -> what it was.
        notes: Sentences on what it was trained on and on what to mind.
        unfolded: Headings of tables that are shown whatever their length.
        good: Whether the summary is good news, None if neither: the colour of its bar.
    """

    title: str
    summary: str
    tables: Mapping[str, Sequence[Row]] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    unfolded: Sequence[str] = ()
    good: bool | None = None


def write_report(path: Path, report: Report) -> Path:
    """Write a report of tables and figures, and return the file."""
    sections: dict[str, list[tuple[str, str]]] = {}
    for name, figure in report.figures.items():
        section, _, caption = name.rpartition("/")
        section = section or TRAINING
        words = f"{'Training' if section == TRAINING else section}: {caption}"
        sections.setdefault(section, []).append((words, data_address(figure)))
    training = sections.pop(TRAINING, [])
    config = yaml.safe_dump(dict(report.config), sort_keys=False, allow_unicode=True)
    return write_page(path, "report.html", report=report, config=config, sections=sections, training=training)


def save_figures(figures: Mapping[str, Figure], folder: Path) -> dict[str, Path]:
    """Write figures as PNG: ``zz20/time series`` as ``zz20_time_series.png``.

    They are laid out once: a page that draws them again has them as they are in the files.

    Args:
        figures: Name -> figure; changed in place.
        folder: Folder to write, made if need be.

    Returns:
        Name -> file.
    """
    paths = {name: folder / f"{as_file_name(name)}.png" for name in figures}
    for name, figure in figures.items():
        save_figure(figure, paths[name], dpi=110)
        figure.set_layout_engine("none")
    return paths


def save_figure(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure to a file of the kind that its ending says."""
    with draft_of(path) as draft:
        figure.savefig(draft, format=path.suffix.removeprefix("."), dpi=dpi)


def write_page(path: Path, template: str, package: str = "manoeuvre_nn.report", **content: Any) -> Path:
    """Write a page of any kind; everything that is given as text is escaped, and a forgotten value is an error.

    Args:
        path: File to write; its folder is made.
        template: File of the template, which extends ``base.html`` and uses the macros of ``parts.html``.
        package: Package that holds the template.
        content: What the template shows.

    Returns:
        The file.
    """
    write_file(path, harmless(_environment(package).get_template(template).render(content)))
    return path


@cache
def _environment(package: str) -> Environment:
    """Templates of a package, and those of this room that they extend."""
    made = Environment(
        loader=ChoiceLoader([PackageLoader(name, ".") for name in dict.fromkeys((package, "manoeuvre_nn.report"))]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals |= {"columns": columns, "html_cells": html_cells, "long_table": LONG_TABLE, "text": text}
    return made


def data_address(figure: Figure) -> str:
    """A figure as an address that carries the image itself; the same figure always gives the same text."""
    # An image of its own, unlike SVG among the page's elements, cannot share identifiers with another one.
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "manoeuvre-nn"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=150)
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
