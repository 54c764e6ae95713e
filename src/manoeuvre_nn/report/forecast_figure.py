"""Figure of a planned run: track and channels as predicted, with the band that 95 % of recordings lie in."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.report.diagnosis_tables import AFTER, BEFORE, CHANNELS
from manoeuvre_nn.report.style import COLOURS, PREDICTED, legend_below, new_figure, plain_axes

MODEL: dict[str, Any] = {"color": COLOURS[1], "linestyle": "-", "linewidth": 1.2}
BAND: dict[str, Any] = {"color": COLOURS[1], "alpha": 0.22, "linewidth": 0}
PLACES = 7
"""Places of the track at which the band is drawn."""


def forecast_figure(planned: Proof) -> Figure:
    """A planned run from above and over time, by calm water and by the model with its band."""
    rows = [channel for channel in CHANNELS if channel != "pos"]
    figure = new_figure(4.2 + 1.2 * len(rows), title=f"{planned.run}, {planned.kind}".strip(", "))
    panels = figure.subplots(1 + len(rows), 1, height_ratios=[3.0, *[1.0] * len(rows)])
    before, after = planned.before, planned.after
    track = plain_axes(panels[0], "east y [m]", "north x [m]")
    for table, style in ((before, PREDICTED), (after, MODEL)):
        track.plot(table["y"], table["x"], **style)
    for k in np.linspace(0, len(after) - 1, PLACES).astype(int):
        at = after.iloc[k]
        corner, size = (at["y_low"], at["x_low"]), (at["y_high"] - at["y_low"], at["x_high"] - at["x_low"])
        track.add_patch(Rectangle(corner, *size, **BAND))
    track.set_aspect("equal", adjustable="datalim")
    for axes, name in zip(panels[1:], rows, strict=True):
        words, _, unit = CHANNELS[name]
        plain_axes(axes, "", f"{words}\n[{unit}]")
        axes.fill_between(after["t"], after[f"{name}_low"], after[f"{name}_high"], **BAND)
        for table, style in ((before, PREDICTED), (after, MODEL)):
            axes.plot(table["t"], table[name], **style)
    panels[-1].set_xlabel("time t [s]")
    figure.align_ylabels(list(panels[1:]))
    styles = {BEFORE: PREDICTED, AFTER: MODEL}
    handles: list[Any] = [Line2D([], [], label=name, **style) for name, style in styles.items()]
    legend_below(figure, [*handles, Patch(**BAND, label="95 % of recordings")])
    return figure
