"""Figures of a paper drawn again: what is to be met in grey, ours in orange, published numbers in blue."""

from collections.abc import Mapping, Sequence
from itertools import count
from math import ceil
from typing import Any

import numpy as np
from jaxtyping import Bool
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from manoeuvre_nn.report.style import COLOURS, FIGURE_WIDTH_IN, MARKERS, legend_below, log_axis, new_figure, plain_axes
from studies.reproduction.section import Line, Panel, Plot

PALETTE: dict[str, tuple[str, ...]] = {
    "reference": ("#4D4D4D", "#8C8C8C", "#B8B8B8"),
    "ours": (COLOURS[0], COLOURS[6], COLOURS[7]),
    "paper": (COLOURS[1], COLOURS[5]),
    "other": (COLOURS[2], COLOURS[3], COLOURS[5], COLOURS[4], COLOURS[6], COLOURS[7]),
}
"""Role -> colours of its first, second, ... label."""
DASHES: dict[str, Any] = {"reference": "-", "ours": (0, (4, 2)), "paper": (0, (1, 1)), "other": "-"}
WIDTHS = {"reference": 1.9, "ours": 1.5, "paper": 1.5, "other": 1.1}
MANY = 150
"""Points beyond which they are drawn small and as pixels."""
MOST_IN_ONE = 9
"""Labels that a legend below all panels has room for."""

Look = Mapping[str, Any]


def reproduction_figure(plot: Plot) -> Figure:
    """Draw a figure.

    Args:
        plot: What is drawn.

    Returns:
        The figure: a panel alone, up to three below one another, more or those with one scale two abreast.
    """
    columns, height = _layout(plot.panels)
    rows = ceil(len(plot.panels) / columns)
    looks = _looks(plot.panels)
    figure = new_figure(0.5 + height * rows, width=FIGURE_WIDTH_IN if columns < 3 else 8.4)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in grid[len(plot.panels) :]:
        axes.set_visible(False)
    for axes, panel in zip(grid, plot.panels, strict=False):
        draw_panel(axes, panel, looks)
    if columns == 1:
        figure.align_ylabels(grid)
        if len({panel.x_label for panel in plot.panels}) == 1:
            for axes in grid[:-1]:
                axes.set_xlabel("")
    _legends(figure, grid, looks)
    return figure


def _legends(figure: Figure, grid: Sequence[Axes], looks: Mapping[tuple[str, str], "Look"]) -> None:
    """One legend below all panels; beside them where it is long, in each panel where each has labels of its own."""
    handles = [Line2D([], [], label=label, **look) for (_, label), look in looks.items() if label]
    own = [axes.get_legend_handles_labels()[1] for axes in grid]
    if not handles:
        return
    if len(handles) <= MOST_IN_ONE:
        short = max(len(str(handle.get_label())) for handle in handles) < 26
        legend_below(figure, handles, columns=3 if short else 2)
    elif max(map(len, own)) > MOST_IN_ONE:
        figure.legend(handles=handles, loc="outside right center", frameon=False, fontsize=8)
    else:
        for axes, labels in zip(grid, own, strict=True):
            if labels:
                axes.legend(fontsize=7.5, framealpha=0.8, edgecolor="none", handlelength=1.6)


def _layout(panels: Sequence[Panel]) -> tuple[int, float]:
    """Panels abreast, and the height of a row [in]."""
    maps = any(panel.equal for panel in panels)
    if len(panels) <= 1:
        return 1, 4.6 if maps else 3.5
    if len(panels) <= 3 and not maps:
        return 1, 2.3 if len(panels) == 2 else 1.9
    return (2, 3.0 if maps else 2.4) if len(panels) <= 8 else (3, 2.7 if maps else 2.3)


def _looks(panels: Sequence[Panel]) -> dict[tuple[str, str], Look]:
    """How the lines of each role and label are drawn, the same in all panels."""
    looks: dict[tuple[str, str], Look] = {}
    numbers: dict[str, count[int]] = {role: count() for role in PALETTE}
    lines = [line for panel in panels for line in panel.lines]
    alone = not any(line.role == "reference" for line in lines)
    for line in lines:
        if (line.role, line.label) not in looks:
            looks[line.role, line.label] = _look(line, next(numbers[line.role]) if line.label else 0, alone)
    return looks


def _look(line: Line, number: int, alone: bool) -> Look:
    """Colour, and dashes or marker, of the label with this number in its role; ours is dashed over a reference."""
    colours = PALETTE[line.role]
    colour = colours[number % len(colours)]
    if line.points:
        many = len(line.x) > MANY
        hollow = line.role == "ours"
        return {
            "color": colour,
            "linestyle": "",
            "marker": "." if many else MARKERS[(number + list(PALETTE).index(line.role)) % len(MARKERS)],
            "markersize": 2.5 if many else 5.0,
            "markerfacecolor": "white" if hollow and not many else colour,
        }
    again = number >= len(colours)  # colours are used up: the second round is told apart by its dashes
    whole = alone and line.role == "ours"
    faint = line.role == "other" and not line.label  # one of many
    return {
        "color": colour,
        "linestyle": "-." if again else "-" if whole else DASHES[line.role],
        "linewidth": WIDTHS[line.role],
        "alpha": 0.5 if faint else 1.0,
    }


def draw_panel(axes: Axes, panel: Panel, looks: Mapping[tuple[str, str], Look]) -> None:
    """Draw one pair of axes.

    Args:
        axes: The axes; changed in place.
        panel: What is drawn.
        looks: Role and label -> how it is drawn.
    """
    plain_axes(axes, panel.x_label, panel.y_label)
    if panel.title:
        axes.set_title(panel.title, fontsize=9.5, loc="left")
    drawn = {(line.role, line.label): 0 for line in panel.lines}
    for line in panel.lines:
        seen = _visible(line, panel.log_y)
        x, y = (np.where(seen, values, np.nan) for values in (line.x, line.y))
        key = line.role, line.label
        label = line.label if line.label and not drawn[key] else "_"
        drawn[key] += 1
        crowded = bool(line.points and len(x) > MANY)
        axes.plot(x, y, label=label, rasterized=crowded, zorder=1.5 if line.role == "reference" else 2, **looks[key])
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.08)
    if panel.log_y:
        log_axis(axes)
    else:
        axes.yaxis.set_major_locator(MaxNLocator(5))
        axes.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    axes.xaxis.set_major_locator(MaxNLocator(6))


def _visible(line: Line, log_y: bool) -> Bool[np.ndarray, " n"]:
    """Points that can be drawn."""
    return np.isfinite(line.x) & np.isfinite(line.y) & ((line.y > 0) | (not log_y))
