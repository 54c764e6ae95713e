"""Figures of a run: recorded in grey, predicted dashed in colour; degrees at the edge."""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
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
from manoeuvre_nn.dynamics.limits import OK
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

PANELS: dict[str, tuple[str, float]] = {
    "psi": ("heading ψ [deg]", 1 / DEGREE),
    "delta": ("rudder δ [deg]", 1 / DEGREE),
    "r": ("yaw rate r [deg/s]", 1 / DEGREE),
    "u": ("surge u [m/s]", 1.0),
    "v": ("sway v [m/s]", 1.0),
}
"""Channels of the time series from the top down: axis label, factor from SI."""


def _two_lines(recorded: str = "recorded", predicted: str = "predicted") -> list[Line2D]:
    """Legend entries of every comparison."""
    return [Line2D([], [], label=recorded, **RECORDED), Line2D([], [], label=predicted, **PREDICTED)]


def track_figure(reference: Recording, prediction: Recording, members: Sequence[Recording] = ()) -> Figure:
    """Both tracks seen from above, and the distance between them over time.

    North is up and east to the right, in ship lengths from where the recording starts. Ship shapes of length L at the
    same times on both tracks show heading and drift, and how far one lags behind the other.

    Args:
        reference: What was recorded; its ``meta`` says the ship's length L [m].
        prediction: What was predicted.
        members: What each member of an ensemble predicts: drawn thin.

    Returns:
        The figure.
    """
    length = float(reference.meta["length"])
    start = np.array([reference["y"][0], reference["x"][0]])

    def seen_from_start(run: Recording) -> Float[np.ndarray, "n 2"]:
        return (np.stack([run["y"], run["x"]], axis=-1) - start) / length

    tracks = [seen_from_start(run) for run in (reference, prediction)]
    low, high = _limits(tracks)
    wide, high_by = high - low
    tall, map_height, rest = high_by > 1.2 * wide, min(0.88 * FIGURE_WIDTH_IN * high_by / wide, 5.2), 1.1
    figure = new_figure(5.6 if tall else map_height + rest + 1.5, title=reference.name)
    if tall:
        map_axes, gap_axes = figure.subplots(1, 2, width_ratios=[0.9, 1.1])
    else:
        map_axes, gap_axes = figure.subplots(2, 1, height_ratios=[map_height, rest])
    for member in members:
        map_axes.plot(*seen_from_start(member).T, color=PREDICTED["color"], linewidth=0.5, alpha=0.35)
    _draw_tracks(map_axes, tracks, (reference, prediction))
    map_axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    _draw_distance(gap_axes, reference, prediction, length)
    legend_below(figure, _two_lines())
    return figure


def _limits(tracks: Sequence[Float[np.ndarray, "_ 2"]]) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Corners of the map: all points, half a ship around them, and never so narrow that the axis has no room."""
    points = np.concatenate(tracks)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0) - 0.7, points.max(axis=0) + 0.7
    lacking = np.maximum(0.25 * (high - low).max() - (high - low), 0.0)
    return low - lacking / 2, high + lacking / 2


def _draw_tracks(axes: Axes, tracks: Sequence[Float[np.ndarray, "_ 2"]], recordings: Sequence[Recording]) -> None:
    """Tracks with ship shapes at common times."""
    plain_axes(axes, "east y/L [-]", "north x/L [-]")
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    times = np.linspace(recordings[0].time[0], recordings[0].time[-1], 8)
    for track, rec, style in zip(tracks, recordings, (RECORDED, PREDICTED), strict=True):
        axes.plot(*track.T, **style)
        for time in times[times <= rec.time[-1] + 1e-9]:
            at = [np.interp(time, rec.time, column) for column in (*track.T, rec["psi"])]
            axes.fill(
                *_ship_shape(*at).T, facecolor=style["color"], alpha=0.35, edgecolor=style["color"], linewidth=0.8
            )


def _ship_shape(y: float, x: float, psi: float) -> Float[np.ndarray, "5 2"]:
    """Corners of a ship of length 1 seen from above, as (east, north)."""
    ahead, abeam = np.array([-0.5, 0.25, 0.5, 0.25, -0.5]), np.array([-0.08, -0.08, 0.0, 0.08, 0.08])
    cos, sin = np.cos(psi), np.sin(psi)
    return np.stack([y + ahead * sin + abeam * cos, x + ahead * cos - abeam * sin], axis=-1)


def _draw_distance(axes: Axes, reference: Recording, prediction: Recording, length: float) -> None:
    """Distance between the tracks; a prediction that ended early rests, as the score has it."""
    plain_axes(axes, "time t [s]", "distance / L [-]")
    ended = prediction.status != OK
    times = reference.time if ended else reference.time[reference.time <= prediction.time[-1] + 1e-9]
    gaps = [
        np.interp(times, prediction.time, prediction[k]) - np.interp(times, reference.time, reference[k]) for k in "xy"
    ]
    distance = np.hypot(*gaps) / length
    axes.plot(times, distance, color=COLOURS[1], linewidth=1.5)
    peak = int(distance.argmax())
    axes.plot(times[peak], distance[peak], "o", color=COLOURS[1], markersize=4)
    axes.set_title(f"largest: {distance[peak]:.3g} L at {times[peak]:.0f} s", fontsize=9, loc="left")
    axes.set_ylim(bottom=0.0)
    _mark_end([axes], reference, prediction)


def _mark_end(panels: Sequence[Axes], reference: Recording, prediction: Recording, write: bool = False) -> None:
    """Shade the time that an ended prediction did not live to see, and say why it ended."""
    if prediction.status == OK:
        return
    for axes in panels:
        axes.axvspan(prediction.time[-1], reference.time[-1], color="#D55E00", alpha=0.12, linewidth=0)
    if write:
        panels[0].set_title(f"prediction {prediction.status}", loc="right", fontsize=9, color=COLOURS[0])


def time_series_figure(reference: Recording, prediction: Recording, members: Sequence[Recording] = ()) -> Figure:
    """Heading and rudder, yaw rate, surge and sway over time in stacked panels.

    Heading and rudder share a panel, as in a zigzag diagram, unless the heading goes so far that the rudder would look
    flat beside it.

    Args:
        reference: What was recorded.
        prediction: What was predicted.
        members: What each member of an ensemble predicts: all lie in the shaded band.

    Returns:
        The figure. Time that a prediction did not reach is shaded, and its status written above.
    """
    together = np.ptp(reference["psi"]) < 4.0 * max(np.ptp(reference["delta"]), 1e-3)
    rows = [("psi", "delta"), *(("r",), ("u",), ("v",))] if together else [(name,) for name in PANELS]
    figure = new_figure(1.0 + 1.45 * len(rows), title=reference.name)
    panels = list(figure.subplots(len(rows), 1, sharex=True))
    for axes, names in zip(panels, rows, strict=True):
        for thin, name in enumerate(names):
            _draw_band(axes, name, prediction, members if name != "delta" else ())
            _draw_channel(axes, name, reference, prediction, bool(thin))
        label = "ψ, and δ thin [deg]" if len(names) > 1 else PANELS[names[0]][0]
        plain_axes(axes, "", label.replace(" [", "\n["))
    panels[-1].set_xlabel("time t [s]")
    panels[-1].set_xlim(reference.time[0], reference.time[-1])
    figure.align_ylabels(panels)
    _mark_end(panels, reference, prediction, write=True)
    legend_below(figure, _two_lines())
    return figure


def _draw_channel(axes: Axes, name: str, reference: Recording, prediction: Recording, thin: bool) -> None:
    """One channel, recorded and predicted."""
    factor = PANELS[name][1]
    for rec, style in ((reference, RECORDED), (prediction, PREDICTED)):
        axes.plot(rec.time, factor * rec[name], **{**style, "linewidth": 0.9} if thin else style)


def _draw_band(axes: Axes, name: str, prediction: Recording, members: Sequence[Recording]) -> None:
    """What the members of an ensemble say of a channel."""
    if members:
        said = PANELS[name][1] * np.array([np.interp(prediction.time, m.time, m[name]) for m in members])
        shade = {"color": PREDICTED["color"], "alpha": 0.2, "linewidth": 0}
        axes.fill_between(prediction.time, said.min(axis=0), said.max(axis=0), **shade)


def rate_against_rudder_figure(reference: Recording, prediction: Recording) -> Figure:
    """Yaw rate against rudder angle; of a spiral, the points at the end of each hold are marked."""
    figure = new_figure(4.6, title=reference.name)
    axes = plain_axes(
        figure.subplots(), "rudder δ [deg], positive to starboard", "yaw rate r [deg/s], positive to starboard"
    )
    axes.axhline(0.0, color="#AAAAAA", linewidth=0.8)
    axes.axvline(0.0, color="#AAAAAA", linewidth=0.8)
    handles = []
    spiral = reference.meta.get("kind") == "spiral"
    pairs = (("recorded", reference, RECORDED, "o"), ("predicted", prediction, PREDICTED, "D"))
    for label, rec, style, marker in pairs:
        delta, r = rec["delta"] / DEGREE, rec["r"] / DEGREE
        if spiral:
            axes.plot(delta, r, color=style["color"], linewidth=0.6, alpha=0.35)
            delta, r = (values[hold_ends(rec)] for values in (delta, r))
            face = style["color"] if label == "recorded" else "white"
            look = {**style, "marker": marker, "markersize": 5, "markerfacecolor": face}
        else:
            look = dict(style)
        handles += axes.plot(delta, r, label=f"{label}, end of each hold" if spiral else label, **look)
    legend_below(figure, handles)
    return figure


def comparison_figures(
    reference: Recording, prediction: Recording, members: Sequence[Recording] = ()
) -> dict[str, Figure]:
    """Every figure that compares one predicted manoeuvre with the recorded one: name -> figure."""
    figures = {
        "track": track_figure(reference, prediction, members),
        "time series": time_series_figure(reference, prediction, members),
    }
    if reference.meta.get("kind") in {"spiral", "zigzag", "mixed_zigzag"}:
        figures["rate against rudder"] = rate_against_rudder_figure(reference, prediction)
    return figures


def hold_ends(recording: Recording) -> Int[np.ndarray, " holds"]:
    """Samples at which the rudder order has stood longest: the last ones before it changes, and the last of all.

    Args:
        recording: A spiral; its ``delta_order`` is read, or its ``delta`` where orders were not recorded.

    Returns:
        Indices. An order that lasts for less than three samples is no hold.
    """
    order = recording.channels.get("delta_order", recording["delta"])
    changes = np.flatnonzero(np.abs(np.diff(order)) > 1e-6)
    edges = np.concatenate([[-1], changes, [len(order) - 1]])
    return np.array([end for start, end in pairwise(edges) if end - start >= 3], dtype=int)


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
    legend_below(figure, _two_lines("target", "network"))
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
    figure = new_figure(3.8, width=6.6, title="What the training saw")
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
