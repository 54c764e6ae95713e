"""A chart as the page's script draws it with plotly.js: plain numbers and words, nothing that names code."""

import html
import math
from base64 import b64encode
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.report.chart import ARROW, Band, Chart, ChartPanel, Curve, Mark, Samples

DIGITS = 5
"""Significant digits of a number on a page."""
PX_PER_POINT = 4 / 3
DASHES = {"": "solid", "-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
"""Names of line styles: matplotlib's -> plotly's."""
SYMBOLS = {"o": "circle", "D": "diamond-open", "*": "star", ">": "triangle-right", "<": "triangle-left-open"}
"""Names of markers: matplotlib's -> plotly's."""


@cache
def scripts() -> tuple[str, str]:
    """plotly.js with its licence, and the script that draws with it.

    ``plotly-basic.min.js`` is what ``npm pack plotly.js-basic-dist-min@4.1.1`` brings, unchanged: the part of plotly.js
    that draws lines and bars, 1.2 MB, where the Python package carries all of it, 4.5 MB.

    Returns:
        Both, as a page holds them.
    """
    here = files("manoeuvre_nn.report")
    names = ("plotly-basic.LICENSE", "plotly-basic.min.js", "interactive.js")
    licence, library, ours = ((here / name).read_text(encoding="utf-8").strip() for name in names)
    return f"/*\n{licence}\n*/\n{library}", ours


def script_policy() -> str:
    """What a page's security policy allows: these scripts, known by their digest, and no others."""
    digests = (b64encode(sha256(script.encode()).digest()).decode() for script in scripts())
    return "script-src " + " ".join(f"'sha256-{digest}'" for digest in digests)


def as_data(chart: Chart) -> dict[str, Any]:
    """A chart as JSON can hold it.

    Args:
        chart: The chart.

    Returns:
        ``columns``, ``one_time`` and ``panels``: of each its plotly traces, labels, ends of its axes, shapes and
        annotations. Words have no markup that plotly would obey.
    """
    return {
        "columns": chart.columns,
        "one_time": chart.one_time,
        "panels": [_panel(panel, named) for panel, named in zip(chart.panels, _first_labels(chart), strict=True)],
    }


def _first_labels(chart: Chart) -> list[set[str]]:
    """Labels that each panel is the first to show, if the panels share a legend."""
    seen: set[str] = set()
    found = []
    for panel in chart.panels:
        labels = ({curve.label for curve in panel.curves} | {band.label for band in panel.bands}) - {""}
        found.append(labels - seen if chart.one_time else labels)
        seen |= labels
    return found


def _panel(panel: ChartPanel, named: set[str]) -> dict[str, Any]:
    """One panel."""
    traces = [trace for band in panel.bands for trace in _band(band)]
    traces += [_curve(curve) for curve in panel.curves]
    for trace in traces:
        shown = trace.get("name", "") in named
        trace["showlegend"] = shown
        if shown:
            named.discard(trace["name"])
    traces += [_mark(mark) for mark in panel.marks]
    return {
        "traces": traces,
        "xlabel": _plain(panel.xlabel),
        "ylabel": _plain(panel.ylabel).replace("\n", "<br>"),
        "title": _plain(panel.title).replace("\n", "<br>"),
        "equal": panel.equal,
        "limits": [_short(float(end)) for end in panel.limits] if panel.limits else None,
        "level": panel.level,
        "spans": [[_short(s.start), _short(s.end), _rgba(s.style)] for s in panel.spans],
        "arrows": [[_plain(a.text), ARROW, round(a.toward / DEGREE - 90.0), a.colour] for a in panel.arrows],
    }


def _plain(words: str) -> str:
    """Words in which plotly finds no tag."""
    return html.escape(words.replace(r"\$", "$"), quote=False)


def _curve(curve: Curve) -> dict[str, Any]:
    """A line or an outline."""
    keep = curve.drawn
    trace: dict[str, Any] = {**_along(curve.x[keep]), "y": _numbers(curve.y[keep]), "mode": "lines"}
    trace |= {"line": _line(curve.style), "name": _plain(curve.label)}
    if marker := curve.style.get("marker"):
        mode = "lines+markers" if curve.style.get("linestyle", "-") else "markers"
        trace |= {"mode": mode, "marker": {"symbol": SYMBOLS[marker], "size": 7, "color": _rgba(curve.style)}}
    if curve.filled:
        return trace | {"fill": "toself", "fillcolor": _rgba(curve.style, "facecolor"), "hoverinfo": "skip"}
    if curve.name:
        trace |= {"meta": _plain(curve.name), "legendgroup": _plain(curve.label)}
    if curve.times is not None:
        trace |= {"customdata": _numbers(curve.times[keep])}
    return trace


def _line(style: Mapping[str, Any]) -> dict[str, Any]:
    """Colour, width and dash of a line."""
    width = PX_PER_POINT * style.get("linewidth", 1.5)
    dash = style.get("linestyle", "-")
    if not isinstance(dash, str):  # (offset, lengths), over the width of the line
        dash = ",".join(f"{length * width:.3g}px" for length in dash[1])
    return {
        "color": _rgba(style, "edgecolor"),
        "width": round(width, 2),
        "dash": DASHES.get(dash, dash),
        "simplify": False,
    }


def _rgba(style: Mapping[str, Any], which: str = "facecolor") -> str:
    """Colour of a line or an area with what shines through."""
    red, green, blue = (round(255 * part) for part in to_rgb(style.get(which, style.get("color"))))
    alpha = 1.0 if which == "edgecolor" and which in style else style.get("alpha", 1.0)
    return f"rgba({red},{green},{blue},{alpha:g})"


def _band(band: Band) -> list[dict[str, Any]]:
    """A lower edge that is not seen, and an upper one that is filled down to it."""
    edges = [_curve(Curve(band.x, y, {"color": "black", "linewidth": 0})) for y in (band.low, band.high)]
    edges[1] |= {"fill": "tonexty", "fillcolor": _rgba(band.style), "name": _plain(band.label)}
    return [{**edge, "hoverinfo": "skip"} for edge in edges]


def _mark(mark: Mark) -> dict[str, Any]:
    """A marker with a word."""
    trace: dict[str, Any] = {
        "x": [_short(mark.x)],
        "y": [_short(mark.y)],
        "mode": "markers+text" if mark.symbol else "text",
    }
    trace |= {
        "text": [_plain(mark.text)],
        "textposition": mark.place,
        "textfont": {"color": mark.colour, "size": 12},
    }
    if mark.symbol:
        trace["marker"] = {"symbol": SYMBOLS[mark.symbol], "size": 9, "color": mark.colour}
    return trace | {"showlegend": False, "hoverinfo": "skip", "cliponaxis": False}


def _along(x: Samples) -> dict[str, Any]:
    """Where the points are along the axis: even steps by the first and the step, which a page has room for."""
    steps = np.diff(x)
    even = len(steps) > 2 and steps[0] > 0 and np.allclose(steps, steps[0], rtol=1e-6)
    return {"x0": float(x[0]), "dx": float(steps.mean())} if even else {"x": _numbers(x)}


def _numbers(values: Samples) -> list[float | None]:
    """Numbers as a page holds them; a gap is null."""
    return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]


def _short(value: float) -> float | None:
    """A number to some digits."""
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
