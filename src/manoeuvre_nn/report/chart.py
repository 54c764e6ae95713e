"""What a figure shows, apart from how it is drawn: the same curves go to matplotlib and to the script of a page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.report.style import plain_axes

ARROW = "→"
"""What is turned to show a direction."""
MAX_POINTS = 1000
"""Most points that are drawn of a line."""
Samples = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Curve:
    """A line through points; gaps are NaN.

    Attributes:
        x: Along the axis.
        y: Above it.
        style: Colour, line style, width and marker as matplotlib calls them.
        label: What it is.
        times: Time of each point of a track [s], for whoever points at it.
        filled: Whether it is an outline, or several with a gap after each.
        name: What it is called where it is pointed at, if that is more than the label, which several may share.
    """

    x: Samples
    y: Samples
    style: Mapping[str, Any]
    label: str = ""
    times: Samples | None = None
    filled: bool = False
    name: str = ""

    @property
    def drawn(self) -> slice:
        """Which points are drawn: all, or of a long line every second, third, ..."""
        return slice(None, None, 1 if self.filled else max(-(-len(self.x) // MAX_POINTS), 1))


def along(track: Float[np.ndarray, "n 2"], style: Mapping[str, Any], label: str = "", **more: Any) -> Curve:
    """A curve through places (east, north)."""
    return Curve(track[:, 0], track[:, 1], style, label, **more)


@dataclass(frozen=True)
class Band:
    """The room between two curves over the same points."""

    x: Samples
    low: Samples
    high: Samples
    style: Mapping[str, Any]
    label: str = ""


class Span(NamedTuple):
    """A stretch of the axis that is shaded."""

    start: float
    end: float
    style: Mapping[str, Any]
    label: str = ""


class Mark(NamedTuple):
    """A marker with a word beside it (``place``: top or bottom; right, left or center), or a word alone."""

    x: float
    y: float
    text: str
    symbol: str = ""
    colour: str = "black"
    place: str = "top right"


class Arrow(NamedTuple):
    """A direction over the whole map: what it is, and where it points, clockwise from north [rad]."""

    text: str
    toward: float
    colour: str


@dataclass(frozen=True)
class ChartPanel:
    """One pair of axes.

    Attributes:
        xlabel: What goes along, with its unit.
        ylabel: What goes up, with its unit.
        curves: Lines and outlines, the first at the bottom.
        bands: Below all curves.
        spans: Shaded stretches.
        marks: Points with a word.
        arrows: Wind and current over a map.
        equal: Whether a unit is as long up as along, as on a map.
        limits: Ends of the axes (x low, x high, y low, y high); None leaves them to the curves.
        level: Height of a thin line right across, None for none.
        title: What stands above.
    """

    xlabel: str
    ylabel: str
    curves: Sequence[Curve] = ()
    bands: Sequence[Band] = ()
    spans: Sequence[Span] = ()
    marks: Sequence[Mark] = ()
    arrows: Sequence[Arrow] = ()
    equal: bool = False
    limits: tuple[float, float, float, float] | None = None
    level: float | None = None
    title: str = ""


@dataclass(frozen=True)
class Chart:
    """Panels of one figure.

    Attributes:
        panels: Row by row.
        columns: How many stand side by side.
        one_time: Whether all have the same time along, so that they are zoomed together.
    """

    panels: Sequence[ChartPanel]
    columns: int = 1
    one_time: bool = False


def draw_panel(axes: Axes, panel: ChartPanel) -> Axes:
    """Draw a panel on axes, and return them."""
    plain_axes(axes, panel.xlabel, panel.ylabel)
    if panel.level is not None:
        axes.axhline(panel.level, color="#777777", linewidth=0.8)
    for span in panel.spans:
        axes.axvspan(span.start, span.end, zorder=0, **span.style)
    for band in panel.bands:
        axes.fill_between(band.x, band.low, band.high, **band.style)
    for curve in panel.curves:
        if curve.filled:
            axes.add_patch(PathPatch(_outlines(curve), **curve.style))
        else:
            axes.plot(curve.x[curve.drawn], curve.y[curve.drawn], **curve.style)
    for mark in panel.marks:
        if mark.symbol:
            axes.plot(mark.x, mark.y, mark.symbol, color=mark.colour, markersize=6, zorder=5)
        _write(axes, mark)
    for row, arrow in enumerate(panel.arrows):
        _draw_arrow(axes, arrow, row)
    if panel.limits:
        axes.set(xlim=panel.limits[:2], ylim=panel.limits[2:])
    if panel.equal:
        axes.set_aspect("equal", adjustable="box" if panel.limits else "datalim")
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    if panel.title:
        axes.set_title(panel.title, fontsize=9, loc="left")
    return axes


def draw_grid(grid: np.ndarray, panels: Sequence[ChartPanel]) -> None:
    """Draw panels on axes in rows and columns; what goes along stands below the last row alone."""
    for axes, panel in zip(grid.ravel(), panels, strict=True):
        draw_panel(axes, panel)
        axes.set_xlabel(panel.xlabel if axes.get_subplotspec().is_last_row() else "")


def _write(axes: Axes, mark: Mark) -> None:
    """The word of a mark, beside it."""
    height, side = mark.place.split()
    up, aligned = {"top": (3, "bottom"), "bottom": (-3, "top")}[height]
    beside, put = {"right": (5, "left"), "left": (-5, "right"), "center": (0, "center")}[side]
    look: dict[str, Any] = {"va": aligned, "ha": put, "fontsize": 8, "color": mark.colour, "zorder": 6}
    axes.annotate(mark.text, (mark.x, mark.y), (beside, up), textcoords="offset points", **look, **_halo(axes))


def _outlines(curve: Curve) -> Path:
    """All outlines of a filled curve, each closed where its gap is."""
    corners = np.stack([curve.x, curve.y], axis=-1)
    whole = np.all(np.isfinite(corners), axis=1)
    begins = whole & ~np.concatenate([[False], whole[:-1]])
    codes = np.select([begins, whole], [Path.MOVETO, Path.LINETO], Path.CLOSEPOLY)
    return Path(np.where(whole[:, None], corners, 0.0), codes)


def _draw_arrow(axes: Axes, arrow: Arrow, row: int) -> None:
    """An arrow in the upper corner of a map, its word beside it; the next one stands below."""
    place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "color": arrow.colour}
    height, turned = -14.0 - 22.0 * row, 90.0 - arrow.toward / DEGREE
    axes.annotate(ARROW, (0, 1), (14, height), fontsize=20, rotation=turned, ha="center", va="center", **place)
    lines = arrow.text.replace(", ", ",\n", 1)  # a zigzag's map is narrow
    axes.annotate(lines, (0, 1), (28, height), fontsize=8, va="center", zorder=6, **place, **_halo(axes))


def _halo(axes: Axes) -> dict[str, Any]:
    """What keeps a word readable that lies on a curve."""
    return {"path_effects": [withStroke(linewidth=2.5, foreground=axes.get_facecolor())]}


def legend_entries(panels: Sequence[ChartPanel]) -> list[Any]:
    """Entries of a legend for all that has a label, each once."""
    found: dict[str, Any] = {}
    for panel in panels:
        shown: list[Curve | Band | Span] = [*panel.curves, *panel.bands, *panel.spans]
        for one in shown:
            patch = not isinstance(one, Curve) or one.filled
            if one.label and one.label not in found:
                found[one.label] = (
                    Patch(label=one.label, **one.style) if patch else Line2D([], [], label=one.label, **one.style)
                )
    return list(found.values())
