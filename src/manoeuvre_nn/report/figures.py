"""Figures of a run: recorded in grey, predicted dashed in colour; degrees at the edge."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.report.chart import Chart, draw_panel, legend_entries
from manoeuvre_nn.report.manoeuvre_charts import comparison_charts, time_chart, track_chart
from manoeuvre_nn.report.style import (
    COLOURS,
    FIGURE_WIDTH_IN,
    MARKERS,
    PREDICTED,
    RECORDED,
    legend_below,
    log_axis,
    new_figure,
    plain_axes,
)
from manoeuvre_nn.report.track_marks import BREADTH


def track_figure(
    reference: Recording, prediction: Recording, members: Sequence[Recording] = (), breadth: float = BREADTH
) -> Figure:
    """Both tracks seen from above and the distance between them, as :func:`.manoeuvre_charts.track_chart` says."""
    return draw_track(track_chart(reference, prediction, members, breadth), reference.name)


def draw_track(chart: Chart, title: str) -> Figure:
    """A map with the distance beside it, or below it where the map is wide."""
    mapped, distance = chart.panels
    assert mapped.limits is not None
    west, east, south, north = mapped.limits
    tall, map_height, rest = (north - south) > 1.6 * (east - west), 0.88 * FIGURE_WIDTH_IN, 1.1
    map_height = min(map_height * (north - south) / (east - west), 5.2)
    figure = new_figure(5.6 if tall else map_height + rest + 1.5, title=title)
    if tall:
        map_axes, gap_axes = figure.subplots(1, 2, width_ratios=[0.9, 1.1])
    else:
        map_axes, gap_axes = figure.subplots(2, 1, height_ratios=[map_height, rest])
    draw_panel(map_axes, mapped)
    draw_panel(gap_axes, distance)
    legend_below(figure, legend_entries(chart.panels))
    return figure


def time_series_figure(reference: Recording, prediction: Recording) -> Figure:
    """Channels over time, as :func:`.manoeuvre_charts.time_chart` says."""
    return draw_series(time_chart(reference, prediction), reference.name)


def draw_series(chart: Chart, title: str) -> Figure:
    """Panels over one time."""
    figure = new_figure(1.0 + 1.45 * len(chart.panels), title=title)
    axes = list(figure.subplots(len(chart.panels), 1, sharex=True))
    for one, panel in zip(axes, chart.panels, strict=True):
        draw_panel(one, panel)
        one.label_outer()
    axes[-1].set_xlim(*chart.panels[0].curves[0].x[[0, -1]])
    figure.align_ylabels(axes)
    legend_below(figure, legend_entries(chart.panels))
    return figure


def draw_rates(chart: Chart, title: str) -> Figure:
    """Yaw rate over rudder angle."""
    figure = new_figure(4.6, title=title)
    axes = draw_panel(figure.subplots(), chart.panels[0])
    axes.axvline(0.0, color="#AAAAAA", linewidth=0.8)
    legend_below(figure, legend_entries(chart.panels))
    return figure


def draw_comparison(charts: Mapping[str, Chart], title: str) -> dict[str, Figure]:
    """A figure of each chart of :func:`.manoeuvre_charts.comparison_charts`: name -> figure."""
    draw = {"track": draw_track, "time series": draw_series, "rate against rudder": draw_rates}
    return {name: draw[name](chart, title) for name, chart in charts.items()}


def comparison_figures(reference: Recording, prediction: Recording) -> dict[str, Figure]:
    """Every figure that compares one predicted manoeuvre with the recorded one: name -> figure."""
    return draw_comparison(comparison_charts(reference, prediction), reference.name)


def force_figure(
    times: Float[np.ndarray, " n"],
    g_true: Float[np.ndarray, "n 3"],
    g_network: Float[np.ndarray, "n 3"],
) -> Figure:
    """g1', g2', g3' that the network was trained to give and those it gives, with the error beside them.

    Args:
        times: Sample times [s]; where they start anew (several recordings) the pieces are laid end to end.
        g_true: Targets [-].
        g_network: What the network gives [-].

    Returns:
        The figure.
    """
    figure = new_figure(5.4, width=6.6, title="Unknown forces: target and network")
    grid = figure.subplots(3, 2, sharex=True, width_ratios=[1.7, 1.0])
    clock, breaks = _end_to_end(times)
    apart = np.insert(clock, breaks, np.nan)  # no line from one recording to the next
    label = "time t [s]" if not len(breaks) else "time, recordings end to end [s]"
    for row, (axes, error_axes) in enumerate(grid):
        plain_axes(axes, label if row == 2 else "", f"g{row + 1}′ [-]")
        plain_axes(error_axes, "time [s]" if row == 2 else "", "error [-]")
        for values, style in ((g_true, RECORDED), (g_network, PREDICTED)):
            axes.plot(apart, np.insert(values[:, row], breaks, np.nan), **style)
        error = np.insert(g_network[:, row] - g_true[:, row], breaks, np.nan)
        error_axes.plot(apart, error, color=COLOURS[1], linewidth=1.0)
        for panel in (axes, error_axes):
            panel.ticklabel_format(axis="y", scilimits=(-2, 3), useMathText=True)
    grid[0, 1].set_title("network - target", fontsize=9, loc="right")
    grid[2, 1].xaxis.set_major_locator(MaxNLocator(4))
    legend_below(figure, [Line2D([], [], label="target", **RECORDED), Line2D([], [], label="network", **PREDICTED)])
    return figure


def _end_to_end(times: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " breaks"]]:
    """Times that never go back, and the samples before which a new recording starts."""
    steps = np.diff(times)
    usual = np.median(steps[steps > 0]) if (steps > 0).any() else 1.0
    clock = times[0] + np.concatenate([[0.0], np.cumsum(np.where(steps > 0, steps, usual))])
    return clock, np.flatnonzero(steps <= 0) + 1


def learning_figure(history: Sequence[Mapping[str, Any]]) -> Figure:
    """Training error and distance on held-out manoeuvres over the epochs, logarithmic.

    Args:
        history: One mapping an epoch (or scored epoch): ``epoch``, and columns whose names end in ``mse``, hold
            ``relrmse``, or end in ``dev_L`` or ``rms``, a panel each. Others are left out; values may be missing.

    Returns:
        The figure; a panel without data is left out.
    """
    table = pd.DataFrame(list(history)).astype(float)
    names = list(table.columns)
    panels = {
        "mean squared error\n(scaled) [-]": [n for n in names if n.endswith("mse")],
        "relative RMSE\nof g′ [-]": [n for n in names if "relrmse" in n],
        "held-out\ndev/L [-]": [n for n in names if n.endswith("dev_L")],
        "RMS error\n[unit of the response]": [n for n in names if n.endswith("/rms") and n != "score/rms"],
    }
    panels = {label: members for label, members in panels.items() if members}
    figure = new_figure(0.9 + 1.8 * max(len(panels), 1), title="Training")
    grid = figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, members) in zip(grid, panels.items(), strict=False):
        log_axis(plain_axes(axes, "", label))
        for index, name in enumerate(members):
            _draw_learning(axes, index, table.set_index("epoch")[name])
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, fontsize=9)
    grid[-1].set_xlabel("epoch")
    return figure


def _draw_learning(axes: Axes, index: int, column: pd.Series) -> None:
    """One curve of the learning figure, where a logarithm can show it; the mean is black, few points are marked."""
    values = column[np.isfinite(column) & (column > 0)]
    name, mean = str(column.name), column.name == "score/dev_L"
    axes.plot(
        values.index.to_numpy(),
        values.to_numpy(),
        color="black" if mean else COLOURS[index % len(COLOURS)],
        marker=MARKERS[index % len(MARKERS)] if len(values) <= 40 else "",
        markersize=3.5,
        linewidth=2.0 if mean else 1.2,
        label="mean" if mean else re.sub(r"train/|relrmse_|/?dev_L|_mse$|/rms$", "", name) or name,
    )


def excitation_figure(trained: Float[np.ndarray, "n 4"], held_out: Mapping[str, Float[np.ndarray, "_ 4"]]) -> Figure:
    """Where in the r-delta and v-r planes the training data lie, and where the held-out manoeuvres go.

    A held-out manoeuvre that leaves the cloud asks the network to extrapolate.

    Args:
        trained: u', v', r' [-], delta [rad] of the training data.
        held_out: The same along each held-out manoeuvre.

    Returns:
        The figure.
    """
    figure = new_figure(3.8, width=6.6, title="Coverage: trained on, and scored")
    left, right = figure.subplots(1, 2)
    plain_axes(left, "rudder δ [deg]", "yaw rate r′ [-]")
    plain_axes(right, "sway v′ [-]", "yaw rate r′ [-]")
    handles: list[Any] = []
    for axes, column, factor in ((left, 3, 1 / DEGREE), (right, 1, 1.0)):
        cloud = {"s": 14, "color": "#BBBBBB", "linewidth": 0, "label": "trained on", "rasterized": True}
        handles = [axes.scatter(factor * trained[:, column], trained[:, 2], **cloud)]
        for k, (name, inputs) in enumerate(held_out.items()):
            look = {"color": COLOURS[k % len(COLOURS)], "linestyle": ("-", "--", ":", "-.")[k % 4], "linewidth": 1.2}
            handles += axes.plot(factor * inputs[:, column], inputs[:, 2], label=name, **look)
    legend_below(figure, handles, columns=5)
    return figure
