"""One HTML file that holds a whole report: no external resource, opens offline, on a phone, light or dark."""

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import yaml
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from manoeuvre_nn.core.plain_text import as_file_name, harmless
from manoeuvre_nn.core.writing import draft_of, write_file
from manoeuvre_nn.report.chart import Chart
from manoeuvre_nn.report.columns import explained
from manoeuvre_nn.report.interactive import as_data, script_policy, scripts
from manoeuvre_nn.report.tables import Row, columns, html_cells, text

OURS = "manoeuvre_nn.report"
"""Package of the templates of all commands."""
TRAINING = "training"
"""Section of the figures that belong to no manoeuvre."""
LONG_TABLE = 12
"""Tables with more rows are folded away until they are asked for."""
CONTENTS = "<!-- contents -->"
"""Where a template wants the list of its headings."""
NO_SCRIPT, SCRIPTS = "script-src 'none'", "<!-- scripts -->"
"""What the frame of all pages says of scripts, and where they go."""
CHART = re.compile(r'<figure class="chart">(?P<picture>.*?)<script type="application/json">.*?</figure>', re.DOTALL)
"""A figure that can be zoomed: the picture with its caption, and what the script draws in its place."""
LARGEST_PAGE = 5_000_000
"""Letters of a page; with pictures alone of many long runs it may be larger."""
WIDE_FIGURE = 2.2
"""Width over height from which a figure stands alone in its row."""


class Picture(NamedTuple):
    """A figure on a page: what it shows, the image's address, and what the script draws in its place on a screen."""

    words: str
    address: str
    chart: Mapping[str, Any] | None = None
    wide: bool = False


@dataclass(frozen=True)
class Report:
    """What a page shows: the summary first, then tables, figures by section, notes, and how to repeat the run.

    Attributes:
        title: Heading.
        summary: What came out, one sentence.
        tables: Heading -> rows; a table without rows is left out.
        figures: Name -> figure. ``zz20/track`` goes to the section ``zz20``; ``training/...`` and a name without a
            stroke to the one about training.
        charts: The same names -> what those figures show that can be zoomed.
        key: Name of the figure that stands below the summary; empty for none.
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
    charts: Mapping[str, Chart] = field(default_factory=dict)
    key: str = ""
    config: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    unfolded: Sequence[str] = ()
    good: bool | None = None


def write_report(path: Path, report: Report) -> Path:
    """Write a report of tables and figures, and return the file."""
    sections: dict[str, list[Picture]] = {}
    for name, figure in report.figures.items():
        section, _, caption = name.rpartition("/")
        section = section or TRAINING
        words = f"{'Training' if section == TRAINING else section}: {caption}"
        shown = picture(words, figure, report.charts.get(name))
        sections.setdefault("" if name == report.key else section, []).append(shown)
    key, training = sections.pop("", []), sections.pop(TRAINING, [])
    config = yaml.safe_dump(dict(report.config), sort_keys=False, allow_unicode=True)
    return write_page(path, "report.html", report=report, config=config, key=key, sections=sections, training=training)


def picture(words: str, figure: Figure, chart: Chart | None = None) -> Picture:
    """A figure for a page, with what it shows if it can be zoomed."""
    width, height = figure.get_size_inches()
    wide = bool(width > WIDE_FIGURE * height)  # beside another its panels would be too small
    return Picture(words, data_address(figure), None if chart is None else as_data(chart), wide)


def save_figures(figures: Mapping[str, Figure], folder: Path) -> dict[str, Path]:
    """Write figures as PNG: ``zz20/time series`` as ``zz20_time_series.png``.

    A page that draws them again has them laid out as they are in the files.

    Args:
        figures: Name -> figure; changed in place.
        folder: Folder to write, made if need be.

    Returns:
        Name -> file.
    """
    paths = {name: folder / f"{as_file_name(name)}.png" for name in figures}
    for name, figure in figures.items():
        save_figure(figure, paths[name], dpi=110)
    return paths


def save_figure(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure to a file of the kind that its ending says."""
    _lay_out(figure, dpi)
    with draft_of(path) as draft:
        figure.savefig(draft, format=path.suffix.removeprefix("."), dpi=dpi)


def _lay_out(figure: Figure, dpi: int) -> None:
    """Place all axes, once: with a layout engine matplotlib draws a figure one time more whenever it is saved."""
    engine = figure.get_layout_engine()
    if engine is not None and figure.axes:
        figure.set_dpi(dpi)
        engine.execute(figure)
        figure.set_layout_engine(None)


def write_page(path: Path, template: str, package: str = OURS, **content: Any) -> Path:
    """Write a page of any kind; everything that is given as text is escaped, and a forgotten value is an error.

    Args:
        path: File to write; its folder is made.
        template: File of the template, which extends ``base.html`` and uses the macros of ``parts.html``.
        package: Package that holds the template.
        content: What the template shows.

    Returns:
        The file.
    """
    made = harmless(_environment(package).get_template(template).render(content))
    write_file(path, _with_scripts(_small_enough(_with_contents(made))))
    return path


def _small_enough(page: str) -> str:
    """A page whose last figures are pictures only, as many as bring it below :data:`LARGEST_PAGE`, or all."""
    over = len(page) + sum(map(len, scripts())) - LARGEST_PAGE
    for chart in reversed(list(CHART.finditer(page))):
        if over <= 0:
            break
        drawn = f"<figure>{chart['picture']}</figure>"
        page = page[: chart.start()] + drawn + page[chart.end() :]
        over -= len(chart[0]) - len(drawn)
    return page


def _with_scripts(page: str) -> str:
    """A page with the scripts that its figures need, and leave to run them; one without such figures runs none."""
    if '<figure class="chart">' not in page:
        return page
    tags = "\n".join(f"<script>{script}</script>" for script in scripts())
    return page.replace(NO_SCRIPT, script_policy(), 1).replace(SCRIPTS, tags, 1)


def _with_contents(page: str) -> str:
    """A page with an address for each heading and the list of them; what is given as text is escaped: it has no tag."""
    headings: list[str] = []

    def numbered(found: re.Match[str]) -> str:
        headings.append(found[1])
        return f'<a id="part{len(headings)}"></a>{found[0]}'

    page = re.sub(r"<h2>(.*?)</h2>", numbered, page, flags=re.DOTALL)
    items = "".join(f'<li><a href="#part{k}">{heading}</a></li>' for k, heading in enumerate(headings, start=1))
    return page.replace(CONTENTS, f'<nav class="contents" aria-label="Contents"><ol>{items}</ol></nav>', 1)


@cache
def _environment(package: str) -> Environment:
    """Templates of a package, and those of this room that they extend."""
    made = Environment(
        loader=ChoiceLoader([PackageLoader(name, ".") for name in dict.fromkeys((package, OURS))]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    values: dict[str, Any] = made.globals
    tests: dict[str, Any] = made.tests
    values |= {"columns": columns, "html_cells": html_cells, "long_table": LONG_TABLE, "text": text}
    made.filters["breakable"] = _breakable
    # Pages of others, such as those of studies, may call other things by the same headings.
    values["explained"] = tests["explained"] = explained if package == OURS else _unknown
    return made


def _unknown(column: str, table: str = "") -> str:
    """No explanation."""
    return ""


def _breakable(escaped: str) -> str:
    """HTML of a name that a line may be broken in after a stroke, a comma or an equals sign, as in ``a/hidden=8,b=2``.

    Args:
        escaped: The name, escaped.

    Returns:
        The same with places to break at, still escaped.
    """
    return re.sub(r"(?<=[/,=])(?=\S)", "<wbr>", str(escaped))


def data_address(figure: Figure) -> str:
    """A figure as an address that carries the image itself, without ground; the same figure gives the same text."""
    # An image of its own, unlike SVG among the page's elements, cannot share identifiers with another one.
    buffer = io.BytesIO()
    _lay_out(figure, dpi=150)
    with mpl.rc_context({"svg.hashsalt": "manoeuvre-nn"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=150, transparent=True)
    # A hundredth of a point is not seen; more digits double the page.
    drawn = re.sub(rb' d="[^"]*"', lambda path: re.sub(rb"(\.\d\d)\d+", rb"\1", path[0]), buffer.getvalue())
    return "data:image/svg+xml;base64," + base64.b64encode(drawn).decode("ascii")
