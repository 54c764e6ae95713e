"""Figures of a diagnosis: recorded in grey, calm water dashed in orange, the repaired model in blue."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator

from manoeuvre_nn.diagnosis.result import Diagnosis, Proof, Residual
from manoeuvre_nn.report.chart import Arrow, Chart, along, draw_grid, draw_panel, legend_entries
from manoeuvre_nn.report.diagnosis_charts import (
    CALM,
    REPAIRED,
    TITLE_LETTERS,
    TRUTH,
    channel_chart,
    forecast_chart,
    forecast_tracks,
    found_arrows,
    residual_chart,
    run_title,
    start_of,
    track_chart,
    track_panel,
)
from manoeuvre_nn.report.diagnosis_tables import AFTER, BEFORE, CHANNELS, main_causes, percent
from manoeuvre_nn.report.style import COLOURS, legend_below, log_axis, new_figure, plain_axes, short_name
from manoeuvre_nn.report.tables import text

KINDS = {"in the repaired model": COLOURS[1], "not in the list": COLOURS[0], "other causes": "#A6A6A6"}
"""What the bars stand for."""
MAX_BARS = 8
"""Causes in the bar of probabilities."""


def draw_diagnosis(d: Diagnosis) -> dict[str, Figure]:
    """All figures of a diagnosis.

    Returns:
        Name -> figure: ``probabilities``; ``tracks`` and ``errors`` if runs were held out; ``residual/<run>`` for each
        fitted run; ``where`` if anything was located on a known track; ``channels/<run>`` for each held-out run;
        ``planned`` and ``planned/<run>`` if runs are planned.
    """
    repaired = d.repaired
    figures = {"probabilities": probability_figure(d)}
    if d.proofs:
        figures["tracks"] = track_figure(d.proofs, repaired, d.dimensions, found_arrows(d))
        figures["errors"] = error_figure(d)
    located = [r for r in d.residuals if r.windows and len(r.time) == len(d.tracks.get(r.run, ()))]
    if located:
        figures["where"] = _window_figure(d.tracks, located)
    figures |= {f"residual/{residual.run}": residual_figure(residual, bool(d.model)) for residual in d.residuals}
    if d.forecasts:
        figures["planned"] = _maps(forecast_tracks(d.forecasts))
    for planned in d.forecasts:
        figures[f"planned/{planned.run}"] = in_pairs(forecast_chart(planned), run_title(planned, 44))
    return figures | {f"channels/{proof.run}": channel_figure(proof, d.noise, repaired) for proof in d.proofs}


def probability_figure(d: Diagnosis) -> Figure:
    """How probable each cause is, those of the repaired model in blue; a sentence if there is no candidate."""
    causes = main_causes(d, MAX_BARS)
    if not causes:
        return _only("No candidate was tried.")
    figure = new_figure(0.8 + 0.46 * len(causes))
    axes = plain_axes(figure.subplots(), "probability of being present [%]", "")
    shares = 100 * np.nan_to_num([cause.probability for cause in causes])
    kinds = [_kind(cause.name, d) for cause in causes]
    bars = axes.barh(range(len(causes)), shares, height=0.62, color=[KINDS[kind] for kind in kinds])
    axes.bar_label(bars, [percent(cause.probability) for cause in causes], padding=4, fontsize=10)
    axes.set_yticks(range(len(causes)), [short_name(cause.label, 30) for cause in causes])
    axes.invert_yaxis()
    axes.set(xlim=(0.0, 114.0), xticks=range(0, 101, 25))
    axes.grid(visible=False, axis="y")
    if set(kinds) != {"other causes"}:
        legend_below(figure, [Patch(color=colour, label=kind) for kind, colour in KINDS.items() if kind in kinds])
    return figure


def _only(sentence: str) -> Figure:
    """A figure that says why there is none."""
    figure = new_figure(1.2)
    figure.text(0.5, 0.5, sentence, ha="center", va="center", fontsize=11)
    return figure


def _kind(name: str, d: Diagnosis) -> str:
    """What a bar stands for."""
    return "in the repaired model" if name in d.model else "not in the list" if name == "unknown" else "other causes"


def track_figure(
    proofs: Sequence[Proof],
    repaired: bool,
    dimensions: tuple[float, float] | None = None,
    arrows: Sequence[Arrow] = (),
) -> Figure:
    """Held-out runs from above, as :func:`.diagnosis_charts.track_chart` says."""
    return _maps(track_chart(proofs, repaired, dimensions, arrows))


def _window_figure(tracks: Mapping[str, Float[np.ndarray, "_ 2"]], residuals: Sequence[Residual]) -> Figure:
    """Fitted runs in which something was located, seen from above, with the places at which it is missing."""
    place: dict[str, Any] = {"color": COLOURS[4], "linewidth": 5.0, "solid_capstyle": "round"}
    panels = []
    for residual in residuals:
        time, track = residual.time, tracks[residual.run][:, ::-1]
        track = track - start_of(track)
        inside = np.any([(time >= start) & (time <= end) for start, end in residual.windows], axis=0)
        curves = [
            along(np.where(inside[:, None], track, np.nan), place, "something missing"),
            along(track, TRUTH, "recorded"),
        ]
        panels.append(track_panel(curves, short_name(residual.run, TITLE_LETTERS)))
    return _maps(Chart(panels, columns=min(len(panels), 2)))


def _maps(chart: Chart) -> Figure:
    """A figure with a map for each panel."""
    count, columns = len(chart.panels), chart.columns
    rows = -(-count // columns)
    figure = new_figure(0.6 + rows * (5.0 if columns == 1 else 3.3))
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes, panel in zip(grid, chart.panels, strict=False):
        draw_panel(axes, panel).margins(0.08)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(4))
    for axes in grid[count:]:
        axes.set_visible(False)
    legend_below(figure, legend_entries(chart.panels), columns=4)
    return figure


def error_figure(d: Diagnosis) -> Figure:
    """RMS errors on the held-out runs over the measurement noise, before and after; a right model comes near 1."""
    before, after = d.rmse("before"), d.rmse("after")
    scored = [c for c in before if d.noise.get(c, 0.0) > 0 and np.isfinite(before[c]) and before[c] > 0]
    if not scored:
        return _only("The measurement noise is not known.")
    figure = new_figure(1.2 + 0.52 * len(scored))
    axes = plain_axes(figure.subplots(), "RMS error over measurement noise [-]", "")
    axes.axvline(1.0, color="#4D4D4D", linewidth=1.6)
    for row, channel in enumerate(scored):
        unit = CHANNELS[channel][2]
        noise, values = d.noise[channel], [before[channel], *([after[channel]] if d.repaired else [])]
        axes.plot(np.array(values) / noise, [row] * len(values), color="#BBBBBB", linewidth=2.5, zorder=1)
        for value, style, marker in zip(values, (CALM, REPAIRED), "Do", strict=False):
            axes.plot(value / noise, row, marker, color=style["color"], markersize=7)
        shown = " → ".join(text(value, 3) for value in values)
        axes.text(1.02, row, f"{shown} {unit}", transform=axes.get_yaxis_transform(), va="center", fontsize=9)
    axes.set_yticks(range(len(scored)), [CHANNELS[channel][0] for channel in scored])
    axes.set_ylim(len(scored) - 0.5, -0.5)
    low, high = log_axis(axes, "x").get_xlim()
    axes.set_xlim(min(low, 0.7), max(high, 3.0))
    if high < 5.5:  # even ticks would leave out 1, by which all is measured
        below = [tick for tick in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5) if tick >= low]
        axes.xaxis.set_major_locator(FixedLocator([*below, 1.0, *(() if below else (1.5,)), 2.0, 3.0, 4.0, 5.0]))
    handles = [
        Line2D([], [], label=BEFORE, color=CALM["color"], marker="D", linestyle=""),
        Line2D([], [], label=AFTER, color=REPAIRED["color"], marker="o", linestyle=""),
        Line2D([], [], label="measurement noise", color="#4D4D4D", linewidth=1.6),
    ]
    legend_below(figure, handles if d.repaired else [handles[0], handles[2]])
    return figure


def residual_figure(residual: Residual, repaired: bool) -> Figure:
    """X, Y and N that calm water lacks in one run, as :func:`.diagnosis_charts.residual_chart` says."""
    chart = residual_chart(residual, repaired)
    figure = new_figure(5.4, title=short_name(residual.run, 44))
    axes = list(figure.subplots(3, 1, sharex=True))
    for one, panel in zip(axes, chart.panels, strict=True):
        draw_panel(one, panel).label_outer()
    figure.align_ylabels(axes)
    legend_below(figure, legend_entries(chart.panels), columns=2)
    return figure


def channel_figure(proof: Proof, noise: Mapping[str, float], repaired: bool) -> Figure:
    """Channels of a held-out run over time and their errors, as :func:`.diagnosis_charts.channel_chart` says."""
    return in_pairs(channel_chart(proof, noise, repaired), run_title(proof, 44))


def in_pairs(chart: Chart, title: str) -> Figure:
    """A figure of two columns, the left one wider, over one time."""
    rows = len(chart.panels) // 2
    figure = new_figure(1.2 + 1.4 * rows, title=title)
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False, width_ratios=[1.35, 1.0])
    draw_grid(grid, chart.panels)
    for axes in grid[-1]:
        axes.xaxis.set_major_locator(MaxNLocator(4))
    for column in grid.T:
        figure.align_ylabels(column)
    legend_below(figure, legend_entries(chart.panels), columns=4)
    return figure
