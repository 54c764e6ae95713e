"""Figure of a planned run: track and channels as predicted, with the band that 95 % of recordings lie in."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.report.diagnosis_tables import AFTER, BEFORE, CHANNELS
from manoeuvre_nn.report.style import COLOURS, PREDICTED, legend_below, new_figure, plain_axes

MODEL: dict[str, Any] = {"color": COLOURS[1], "linestyle": "-", "linewidth": 1.2}
BAND: dict[str, Any] = {"color": COLOURS[1], "alpha": 0.22, "linewidth": 0}
START: dict[str, Any] = {"color": "black", "marker": "*", "markersize": 9, "linestyle": ""}
PLACES = 7
"""Places of the track at which the band is drawn."""


def forecast_figure(planned: Proof) -> Figure:
    """A planned run from above and over time, by calm water and by the model; beside it the band about the model."""
    rows = [channel for channel in CHANNELS if channel != "pos"]
    figure = new_figure(4.4 + 1.2 * len(rows), title=f"{planned.run}, {planned.kind}".strip(", "))
    grid = figure.add_gridspec(1 + len(rows), 2, height_ratios=[3.0, *[1.0] * len(rows)], width_ratios=[1.35, 1.0])
    before, after = planned.before, planned.after
    _draw_track(figure.add_subplot(grid[0, :]), before, after)
    columns: list[list[Axes]] = [[], []]
    for row, name in enumerate(rows, 1):
        words, _, unit = CHANNELS[name]
        axes, beside = (figure.add_subplot(grid[row, k], sharex=columns[0][0] if columns[0] else None) for k in (0, 1))
        plain_axes(axes, "", f"{words}\n[{unit}]")
        plain_axes(beside, "", f"band [{unit}]").axhline(0.0, color=MODEL["color"], linewidth=0.8)
        low, high = after[f"{name}_low"], after[f"{name}_high"]
        axes.fill_between(after["t"], low, high, **BAND)
        beside.fill_between(after["t"], low - after[name], high - after[name], **BAND)
        for table, style in ((before, PREDICTED), (after, MODEL)):
            axes.plot(table["t"], table[name], **style)
        for column, part in zip(columns, (axes, beside), strict=True):
            column.append(part)
            part.tick_params(labelbottom=row == len(rows))
    for column in columns:
        column[-1].set_xlabel("time t [s]")
        figure.align_ylabels(column)
    styles = {BEFORE: PREDICTED, AFTER: MODEL, "start": START}
    handles: list[Any] = [Line2D([], [], label=name, **style) for name, style in styles.items()]
    legend_below(figure, [*handles, Patch(**BAND, label="95 % of recordings")], columns=4)
    return figure


def _draw_track(axes: Axes, before: pd.DataFrame, after: pd.DataFrame) -> None:
    """The tracks, the band at some places, and its half width at the end in numbers."""
    plain_axes(axes, "east y [m]", "north x [m]")
    for table, style in ((before, PREDICTED), (after, MODEL)):
        axes.plot(table["y"], table["x"], **style)
    axes.plot(after["y"].iloc[0], after["x"].iloc[0], zorder=5, **START)
    for k in np.linspace(0, len(after) - 1, PLACES).astype(int):
        at = after.iloc[k]
        corner, size = (at["y_low"], at["x_low"]), (at["y_high"] - at["y_low"], at["x_high"] - at["x_low"])
        axes.add_patch(Rectangle(corner, *size, **BAND))
    axes.set_aspect("equal", adjustable="datalim")
    last = after.iloc[-1]
    north, east = ((last[f"{c}_high"] - last[f"{c}_low"]) / 2 for c in ("x", "y"))
    axes.set_title(f"band at the end ± {north:.2g} m north, ± {east:.2g} m east", fontsize=9, loc="left")
