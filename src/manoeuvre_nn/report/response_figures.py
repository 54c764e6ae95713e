"""Figures of a response in a seaway and of what approximates it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from manoeuvre_nn.core.response import Records, Response, Variable
from manoeuvre_nn.report.style import COLOURS, MARKERS, RECORDED, legend_below, new_figure, plain_axes
from manoeuvre_nn.training.response_data import LEARNING, TESTING, ResponseData

POINTS = 181
"""Points of a curve."""
BINS = 8
"""Intervals of a variable that has more values than that."""


def response_figures(data: ResponseData, response: Response) -> dict[str, Figure]:
    """All figures of an approximation.

    Args:
        data: The records.
        response: The approximation.

    Returns:
        Name -> figure.
    """
    return {
        "Curves/through the largest response": profile_figure(data, response),
        "Errors/approximated over records": scatter_figure(data.sets, response),
        "Errors/by variable": error_figure(data.sets, response),
    }


def scatter_figure(sets: Mapping[str, Records], response: Response) -> Figure:
    """Approximated over recorded values, a panel a set of records.

    Args:
        sets: Name -> records.
        response: The approximation.

    Returns:
        The figure.
    """
    output = response.output
    figure = new_figure(3.2, width=2.9 * len(sets))
    grid = figure.subplots(1, len(sets), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (name, records) in zip(grid, sets.items(), strict=True):
        recorded, found = records.values / output.size, response.at(records.conditions) / output.size
        ends = [min(recorded.min(), found.min()), max(recorded.max(), found.max())]
        plain_axes(axes, f"recorded [{output.unit}]", f"approximated [{output.unit}]" if axes is grid[0] else "")
        axes.plot(ends, ends, **{**RECORDED, "linewidth": 1.0})
        axes.plot(recorded, found, linestyle="", marker=".", markersize=2.5, color=COLOURS[0], rasterized=True)
        rms = np.sqrt(np.mean((found - recorded) ** 2))
        axes.set_title(f"{name}: {len(records)}, RMS {rms:.3g} {output.unit}", fontsize=9, loc="left")
        axes.set_aspect("equal")
    return figure


def error_figure(sets: Mapping[str, Records], response: Response) -> Figure:
    """Root mean square error over each variable: where the approximation is poor.

    Args:
        sets: Name -> records.
        response: The approximation.

    Returns:
        The figure, a panel a variable.
    """
    inputs, output = response.inputs, response.output
    rows = -(-len(inputs) // 3)
    figure = new_figure(0.6 + 2.2 * rows, width=7.2)
    grid = figure.subplots(rows, 3, sharey=True, squeeze=False).ravel()
    looks: dict[str, dict[str, Any]] = {
        name: {"color": COLOURS[k], "marker": MARKERS[k], "markersize": 3.5} for k, name in enumerate(sets)
    }
    for axes, (k, variable) in zip(grid, enumerate(inputs), strict=False):
        label = f"RMS error [{output.unit}]" if axes.get_subplotspec().is_first_col() else ""
        plain_axes(axes, f"{variable.name} [{variable.unit}]", label)
        for name, records in sets.items():
            squared = ((response.at(records.conditions) - records.values) / output.size) ** 2
            places, errors = by_value(records.conditions[:, k] / variable.size, squared)
            axes.plot(places, np.sqrt(errors), linewidth=1.2, **looks[name])
    grid[0].set_ylim(bottom=0)
    for axes in grid[len(inputs) :]:
        axes.set_visible(False)
    legend_below(figure, [Line2D([], [], label=name, **look) for name, look in looks.items()])
    return figure


def by_value(
    values: Float[np.ndarray, " n"], what: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Means over each value of a variable, or over even intervals where it has many.

    Args:
        values: The variable.
        what: What the mean is taken of.

    Returns:
        Values or middles of intervals, and means there.
    """
    places = np.unique(values)
    if len(places) <= 2 * BINS:
        return places, np.array([what[values == place].mean() for place in places])
    edges = np.linspace(values.min(), values.max(), BINS + 1)
    which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, BINS - 1)
    held = np.unique(which)
    return (0.5 * (edges[:-1] + edges[1:]))[held], np.array([what[which == k].mean() for k in held])


def profile_figure(data: ResponseData, response: Response) -> Figure:
    """The response along each variable through the record with the largest one, with the records on these lines.

    Args:
        data: The records.
        response: The approximation.

    Returns:
        The figure, a panel a variable.
    """
    records, output = data.records, response.output
    peak = records.conditions[int(np.argmax(records.values))]
    inputs = response.inputs
    rows = -(-len(inputs) // 3)
    figure = new_figure(0.9 + 2.2 * rows, width=7.2, title=_held(inputs, peak))
    grid = figure.subplots(rows, 3, sharey=True, squeeze=False).ravel()
    for axes, (k, variable) in zip(grid, enumerate(inputs), strict=False):
        label = f"{output.name} [{output.unit}]" if axes.get_subplotspec().is_first_col() else ""
        plain_axes(axes, f"{variable.name} [{variable.unit}]", label)
        along = np.repeat(peak[None], POINTS, 0)
        along[:, k] = np.linspace(variable.low, variable.high, POINTS)
        axes.plot(along[:, k] / variable.size, response.at(along) / output.size, color=COLOURS[0], linewidth=1.5)
        for name, face in ((LEARNING, "#4D4D4D"), (TESTING, "white")):
            some = records.at(data.rows[name])
            on = np.isclose(np.delete(some.conditions, k, 1), np.delete(peak, k)).all(1)
            x, y = some.conditions[on, k] / variable.size, some.values[on] / output.size
            axes.plot(x, y, linestyle="", marker="o", markersize=4, color="#4D4D4D", markerfacecolor=face)
    for axes in grid[len(inputs) :]:
        axes.set_visible(False)
    point: dict[str, Any] = {"linestyle": "", "marker": "o", "color": "#4D4D4D"}
    handles = [
        Line2D([], [], label="approximation", color=COLOURS[0]),
        Line2D([], [], label="records learnt from", **point),
        Line2D([], [], label="records that test", markerfacecolor="white", **point),
    ]
    legend_below(figure, handles)
    return figure


def _held(inputs: Sequence[Variable], values: Float[np.ndarray, " k"]) -> str:
    """The condition that the curves go through, in words."""
    return ", ".join(f"{v.name} {value / v.size:.3g} {v.unit}" for v, value in zip(inputs, values, strict=True))
