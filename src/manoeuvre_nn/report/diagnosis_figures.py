"""Figures of a diagnosis: recorded in grey, calm water dashed in orange, the repaired model in blue."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator

from manoeuvre_nn.diagnosis.result import Diagnosis, Interval, Proof, Residual
from manoeuvre_nn.report.diagnosis_tables import AFTER, BEFORE, CHANNELS, main_causes, percent
from manoeuvre_nn.report.forecast_figure import forecast_figure
from manoeuvre_nn.report.style import COLOURS, PREDICTED, RECORDED, legend_below, log_axis, new_figure, plain_axes
from manoeuvre_nn.report.tables import text

TRUTH: dict[str, Any] = {**RECORDED, "color": "#8C8C8C", "linewidth": 2.6}
CALM: dict[str, Any] = PREDICTED
REPAIRED: dict[str, Any] = {"color": COLOURS[1], "linestyle": "-", "linewidth": 1.2}
WINDOW: dict[str, Any] = {"facecolor": COLOURS[4], "alpha": 0.22, "linewidth": 0}
BAND: dict[str, Any] = {"alpha": 0.25, "linewidth": 0}
FORCES = ("surge X", "sway Y", "yaw N")
KINDS = {"in the repaired model": COLOURS[1], "not in the list": COLOURS[0], "other causes": "#A6A6A6"}
"""What the bars stand for."""
MAX_BARS = 8
"""Causes in the bar of probabilities."""

Curve = tuple[Float[np.ndarray, "_ 2"], dict[str, Any]]
"""Points on a map (north, east) and how they are drawn."""


def draw_diagnosis(d: Diagnosis) -> dict[str, Figure]:
    """All figures of a diagnosis.

    Returns:
        Name -> figure: ``probabilities``; ``tracks`` and ``errors`` if runs were held out; ``residual/<run>`` for each
        fitted run; ``where`` if anything was located on a known track; ``channels/<run>`` for each held-out run;
        ``planned/<run>`` for each planned one.
    """
    repaired = d.repaired
    figures = {"probabilities": probability_figure(d)}
    if d.proofs:
        figures |= {"tracks": track_figure(d.proofs, repaired), "errors": error_figure(d)}
    located = [r for r in d.residuals if r.windows and len(r.time) == len(d.tracks.get(r.run, ()))]
    if located:
        figures["where"] = _window_figure(d.tracks, located)
    figures |= {f"residual/{residual.run}": residual_figure(residual, bool(d.model)) for residual in d.residuals}
    figures |= {f"planned/{planned.run}": forecast_figure(planned) for planned in d.forecasts}
    return figures | {f"channels/{proof.run}": channel_figure(proof, d.noise, repaired) for proof in d.proofs}


def _wrapped(words: str, width: int) -> str:
    """Words on two lines of a width at most, without their middle if need be, and never taken for a formula."""
    if len(words) > 2 * width:
        words = f"{words[: width - 1]}… {words[1 - width :]}"
    return "\n".join(textwrap.wrap(words, width)).replace("$", r"\$")


def _models(repaired: bool) -> list[Line2D]:
    """Legend entries of a comparison with the recording."""
    styles = {"recorded": TRUTH, BEFORE: CALM, **({AFTER: REPAIRED} if repaired else {})}
    return [Line2D([], [], label=name, **style) for name, style in styles.items()]


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
    axes.set_yticks(range(len(causes)), [_wrapped(cause.label, 30) for cause in causes])
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


def track_figure(proofs: Sequence[Proof], repaired: bool) -> Figure:
    """Held-out runs from above, north up: recorded, by calm water, repaired; dots of a shape at the same times."""
    figure, panels = _maps(len(proofs))
    for axes, proof in zip(panels, proofs, strict=True):
        tables = zip(_tables(proof, repaired), (TRUTH, CALM, REPAIRED), strict=False)
        _draw_map(axes, [(table[["x", "y"]].to_numpy(float), style) for table, style in tables])
        before, after = (errors.get("pos", np.nan) for errors in (proof.rmse_before, proof.rmse_after))
        missed = " → ".join(f"{text(gap, 3)} m" for gap in ([before, after] if repaired else [before]))
        axes.set_title(f"{_title(proof, 28)}\noff by {missed}", fontsize=9, loc="left")
    start = Line2D([], [], label="start", color="black", marker="*", markersize=9, linestyle="")
    legend_below(figure, [*_models(repaired), start], columns=4)
    return figure


def _window_figure(tracks: Mapping[str, Float[np.ndarray, "_ 2"]], residuals: Sequence[Residual]) -> Figure:
    """Fitted runs in which something was located, seen from above, with the places at which it is missing."""
    figure, panels = _maps(len(residuals))
    place: dict[str, Any] = {"color": COLOURS[4], "linewidth": 5.0, "solid_capstyle": "round"}
    for axes, residual in zip(panels, residuals, strict=True):
        time, track = residual.time, tracks[residual.run]
        inside = np.any([(time >= start) & (time <= end) for start, end in residual.windows], axis=0)
        _draw_map(axes, [(np.where(inside[:, None], track, np.nan), place), (track, TRUTH)], track)
        axes.set_title(_wrapped(residual.run, 28), fontsize=9, loc="left")
    start = Line2D([], [], label="start", color="black", marker="*", markersize=9, linestyle="")
    handles = [Line2D([], [], label="recorded", **TRUTH), Line2D([], [], label="something missing", **place), start]
    legend_below(figure, handles)
    return figure


def _tables(proof: Proof, repaired: bool) -> list[pd.DataFrame]:
    """Recorded, before and, if there is a repaired model, after."""
    return [proof.recorded, proof.before, *([proof.after] if repaired else [])]


def _title(proof: Proof, width: int) -> str:
    """Run and manoeuvre."""
    return _wrapped(f"{proof.run}, {proof.kind}" if proof.kind else proof.run, width)


def _maps(count: int) -> tuple[Figure, list[Axes]]:
    """A figure with a map for each run, two side by side."""
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = new_figure(0.6 + rows * (5.0 if columns == 1 else 3.3))
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def _draw_map(axes: Axes, curves: Sequence[Curve], reference: Float[np.ndarray, "_ 2"] | None = None) -> None:
    """Tracks from where the reference (the first by default) starts."""
    plain_axes(axes, "east y [m]", "north x [m]")
    reference = curves[0][0] if reference is None else reference
    known = reference[np.isfinite(reference).all(axis=1)]
    origin = known[0] if len(known) else np.zeros(2)
    for track, style in curves:
        east, north = (track - origin).T[::-1]
        marks = list(np.linspace(0, len(track) - 1, 7)[1:].astype(int)) if len(track) > 7 else []
        axes.plot(east, north, marker="o", markersize=3.6, markevery=marks, **style)
    axes.plot(0.0, 0.0, "*", color="black", markersize=9, zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))


def error_figure(d: Diagnosis) -> Figure:
    """RMS errors on the held-out runs over the measurement noise, before and after; 1 cannot be beaten."""
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
        axes.xaxis.set_major_locator(FixedLocator([1.0, 1.5, 2.0, 3.0, 4.0, 5.0]))
    handles = [
        Line2D([], [], label=BEFORE, color=CALM["color"], marker="D", linestyle=""),
        Line2D([], [], label=AFTER, color=REPAIRED["color"], marker="o", linestyle=""),
        Line2D([], [], label="measurement noise", color="#4D4D4D", linewidth=1.6),
    ]
    legend_below(figure, handles if d.repaired else [handles[0], handles[2]])
    return figure


def residual_figure(residual: Residual, repaired: bool) -> Figure:
    """X, Y and N that calm water lacks in one run, what the repair leaves of it, and when something is missing."""
    figure = new_figure(5.4, title=_wrapped(residual.run, 44))
    panels = list(figure.subplots(3, 1, sharex=True))
    time, colour = residual.time, CALM["color"]
    for k, (axes, words) in enumerate(zip(panels, FORCES, strict=True)):
        plain_axes(axes, "", f"{words}\n[{residual.units[k]}]").axhline(0.0, color="#777777", linewidth=0.8)
        force, spread, left = residual.force[:, k], 2 * residual.error[:, k], residual.left[:, k]
        axes.fill_between(time, force - spread, force + spread, color=colour, **BAND)
        axes.plot(time, force, color=colour, linewidth=1.3)
        shown = [force]
        if repaired:
            axes.plot(time, left, **REPAIRED)
            shown.append(left)
        _shade(axes, time, residual.windows)
        _fit_height(axes, shown, spread)
    panels[-1].set_xlabel("time t [s]")
    figure.align_ylabels(panels)
    handles: list[Any] = [Line2D([], [], color=colour, linewidth=1.3, label="missing from the calm-water model")]
    if repaired:
        handles.append(Line2D([], [], label="missing from the repaired model", **REPAIRED))
    handles.append(Patch(color=colour, **BAND, label="± 2 standard deviations"))
    if residual.windows:
        handles.append(Patch(**WINDOW, label="located"))
    legend_below(figure, handles, columns=2)
    return figure


def _shade(axes: Axes, time: Float[np.ndarray, " n"], windows: Sequence[Interval]) -> None:
    """Shade the windows as far as the run goes."""
    for start, end in windows:
        if start <= time[-1] and end >= time[0]:
            axes.axvspan(max(start, time[0]), min(end, time[-1]), zorder=0, **WINDOW)


def _fit_height(axes: Axes, curves: Sequence[Float[np.ndarray, " n"]], spread: Float[np.ndarray, " n"]) -> None:
    """Room for the curves and for the usual band; a band that opens wide at an end of the run is cut."""
    values = np.concatenate([*curves, np.zeros(1)])
    values = values[np.isfinite(values)]
    usual = spread[np.isfinite(spread)]
    room = float(np.median(usual)) if len(usual) else 0.0
    low, high = values.min() - room, values.max() + room
    if high > low:
        axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))


def channel_figure(proof: Proof, noise: Mapping[str, float], repaired: bool) -> Figure:
    """Heading, yaw rate, surge, sway and log of a held-out run over time, and the errors with the band of the noise."""
    rows = [channel for channel in CHANNELS if channel != "pos"]
    figure = new_figure(1.2 + 1.4 * len(rows), title=_title(proof, 44))
    grid = figure.subplots(len(rows), 2, sharex=True, squeeze=False, width_ratios=[1.35, 1.0])
    time = proof.recorded["t"].to_numpy(float)
    for (axes, beside), name in zip(grid, rows, strict=True):
        words, _, unit = CHANNELS[name]
        plain_axes(axes, "", f"{words}\n[{unit}]")
        plain_axes(beside, "", f"error [{unit}]")
        truth, *models = _series(proof, name, repaired)
        axes.plot(time, truth, **TRUTH)
        for values, style in zip(models, (CALM, REPAIRED), strict=False):
            axes.plot(time, values, **style)
        _draw_errors(beside, time, [values - truth for values in models], noise.get(name, 0.0), unit)
    for axes in grid[-1]:
        axes.set_xlabel("time t [s]")
        axes.xaxis.set_major_locator(MaxNLocator(4))
    for column in grid.T:
        figure.align_ylabels(column)
    legend_below(
        figure, [*_models(repaired), Patch(color=TRUTH["color"], **BAND, label="± 2 measurement noise")], columns=4
    )
    return figure


def _series(proof: Proof, name: str, repaired: bool) -> list[Float[np.ndarray, " n"]]:
    """Recorded, before and after; headings without jumps and near each other at the start."""
    values = [np.array(table[name], float) for table in _tables(proof, repaired)]
    if name != "psi":
        return values
    for angle in values:
        known = np.isfinite(angle)
        angle[known] = np.unwrap(angle[known], period=360.0)
    together = np.flatnonzero(np.isfinite(values).all(axis=0))
    if not len(together):
        return values
    first = together[0]
    return [angle - 360.0 * np.round((angle[first] - values[0][first]) / 360.0) for angle in values]


def _draw_errors(
    axes: Axes, time: Float[np.ndarray, " n"], errors: list[Float[np.ndarray, " n"]], sigma: float, unit: str
) -> None:
    """Errors on the scale of the repaired model's; where calm water's leave it, the largest of them is written."""
    sigma = sigma if np.isfinite(sigma) else 0.0
    axes.axhspan(-2 * sigma, 2 * sigma, color=TRUTH["color"], **BAND)
    # Noise on a dashed line is a row of dots: here calm water is drawn through, and paler.
    for error, style in zip(errors, ({**CALM, "linestyle": "-", "alpha": 0.75}, REPAIRED), strict=False):
        axes.plot(time, error, **{**style, "linewidth": 0.9})
    peaks = [float(np.abs(e[np.isfinite(e)]).max(initial=0.0)) for e in errors]
    height = max(3 * sigma, 1.2 * peaks[-1])
    if height > 0:
        axes.set_ylim(-height, height)
    if peaks[0] > height:
        axes.set_title(
            f"{BEFORE}: up to {text(peaks[0], 2)} {unit}", fontsize=8, loc="right", color=CALM["color"], pad=2
        )
