"""Figures of coefficients: intervals before and after the recordings, beside captive tests; forces by both."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.captive_fit import Towed, forces
from manoeuvre_nn.estimation.coefficients import EQUATIONS, REACH, Fitted, coefficient_table
from manoeuvre_nn.report.coefficient_tables import Coefficients
from manoeuvre_nn.report.style import COLOURS, legend_below, new_figure, plain_axes

BEFORE, AFTER, CAPTIVE = "#B5B5B5", COLOURS[0], COLOURS[1]
MIN_PRIOR_RATIO = 1e-9
MIN_HALF_WIDTH = 4.0
"""Least half width of the axis of intervals, in standard deviations of what was assumed."""
SWEEP_POINTS = 61


def figures(told: Coefficients) -> dict[str, Figure]:
    """All figures of a set of coefficients: name -> figure."""
    made = {"intervals": _interval_figure(told)}
    if told.tests is not None and told.captive is not None:
        made["forces"] = _force_figure(told.fitted, told.captive, told.tests)
    return made


def _interval_figure(told: Coefficients) -> Figure:
    """Every coefficient's 95 % intervals over the standard deviation of what was assumed: a panel a force.

    Zero is the value that was assumed; the grey band is what was thought possible.

    Args:
        told: The coefficients.

    Returns:
        The figure.
    """
    rows = told.rows.set_index("symbol")
    intervals = [(_over_assumed(rows, rows), AFTER, "o")]
    if told.captive is not None:
        intervals.append((_over_assumed(coefficient_table(told.captive).set_index("symbol"), rows), CAPTIVE, "s"))
    parts = [[s for s in rows.index if s[0] == e] for e in EQUATIONS]
    heights = [max(len(p), 1) for p in parts]
    figure = new_figure(1.6 + 0.23 * sum(heights), title="Coefficients: before and after the recordings")
    panels = figure.subplots(3, 1, height_ratios=heights, sharex=True)
    # No interval is cut off.
    reach = 1.05 * max(MIN_HALF_WIDTH, *(float(np.abs(ends.to_numpy()).max(initial=0.0)) for ends, *_ in intervals))
    for axes, equation, symbols in zip(panels, EQUATIONS, parts, strict=True):
        _draw_intervals(axes, symbols, intervals)
        axes.set_xlim(-reach, reach)
        axes.set_ylabel(equation, rotation=0, labelpad=10, fontweight="bold")
    panels[-1].set_xlabel("(coefficient - assumed) / standard deviation of what was assumed [-]")
    handles = [
        Line2D([], [], color=BEFORE, linewidth=5, label="assumed"),
        Line2D([], [], color=AFTER, marker="o", markersize=4, linewidth=2, label="recordings"),
    ]
    if told.captive is not None:
        handles.append(Line2D([], [], color=CAPTIVE, marker="s", markersize=4, linewidth=2, label="captive tests"))
    legend_below(figure, handles)
    return figure


def _draw_intervals(axes: Axes, symbols: Sequence[str], intervals: Sequence[tuple[pd.DataFrame, str, str]]) -> None:
    """One force's coefficients, the first on top; intervals with their colours and markers."""
    plain_axes(axes, "", "")
    axes.axvspan(-REACH, REACH, color="#EFEFEF", zorder=0)
    places = np.arange(len(symbols))[::-1]
    shifts = (0.0,) if len(intervals) == 1 else (0.16, -0.16)
    for place, symbol in zip(places, symbols, strict=True):
        axes.plot([-REACH, REACH], [place, place], color=BEFORE, linewidth=4, zorder=1, solid_capstyle="butt")
        for (ends, colour, marker), shift in zip(intervals, shifts, strict=True):
            if symbol in ends.index:
                low, value, high = ends.loc[symbol].to_numpy()
                axes.plot([low, high], [place + shift] * 2, color=colour, linewidth=1.8, zorder=3)
                axes.plot(value, place + shift, marker, color=colour, markersize=3.5, zorder=4)
    axes.set_yticks(places, [_written(s) for s in symbols], fontsize=8)
    axes.set_ylim(-0.7, max(len(symbols), 1) - 0.3)


def _over_assumed(rows: pd.DataFrame, assumed: pd.DataFrame) -> pd.DataFrame:
    """Lower ends, values and upper ends, from what was assumed and over its standard deviation."""
    prior, error = assumed["prior"][rows.index], assumed["prior_error"][rows.index]
    unit = np.maximum(error, MIN_PRIOR_RATIO * np.maximum(prior.abs(), 1.0))
    return rows[["low", "value", "high"]].sub(prior, axis=0).div(unit, axis=0)


def _written(symbol: str) -> str:
    """A symbol with its index below."""
    head, _, index = symbol.partition("_")
    return rf"${head}_{{{index}}}$"


def _force_figure(free: Fitted, captive: Fitted, measured: Towed) -> Figure:
    """Forces over drift and over rudder angle: measured in captive tests, by their fit and by that to recordings."""
    figure = new_figure(7.2, width=6.6, title="Forces at the approach speed: recordings and captive tests")
    panels = figure.subplots(3, 2, sharex="col", sharey="row")
    tests = measured.motion
    drift = np.arctan2(-tests[:, 1], tests[:, 0])
    near = np.abs(np.hypot(tests[:, 0], tests[:, 1]) - 1) < 0.02
    shown = (near & (tests[:, 3] == 0), near & (drift == 0))
    for column, (angle, chosen) in enumerate(zip((drift, tests[:, 3]), shown, strict=True)):
        largest = float(np.abs(angle[chosen]).max(initial=5 * DEGREE))
        sweep = np.linspace(-largest, largest, SWEEP_POINTS)
        motion = _swept(sweep, column == 0)
        for output in range(3):
            axes = plain_axes(panels[output, column], "", "")
            for one, colour in ((free, AFTER), (captive, CAPTIVE)):
                force, error = forces(one, motion)
                middle, width = force[:, output], REACH * error[:, output]
                axes.fill_between(sweep / DEGREE, middle - width, middle + width, color=colour, alpha=0.2, linewidth=0)
                axes.plot(sweep / DEGREE, middle, color=colour, linewidth=1.5)
            axes.plot(angle[chosen] / DEGREE, measured.force[chosen, output], "s", color="#4D4D4D", markersize=3.5)
    for output, axes in enumerate(panels[:, 0]):
        axes.set_ylabel(f"{EQUATIONS[output]}' [-]")
    panels[2, 0].set_xlabel("drift β [deg], rudder amidships")
    panels[2, 1].set_xlabel("rudder δ [deg], no drift")
    handles = [
        Line2D([], [], color=AFTER, linewidth=1.5, label="recordings"),
        Line2D([], [], color=CAPTIVE, linewidth=1.5, label="fit to captive tests"),
        Line2D([], [], color="#4D4D4D", marker="s", markersize=3.5, linestyle="", label="captive tests"),
    ]
    legend_below(figure, handles)
    return figure


def _swept(angle: np.ndarray, drifting: bool) -> np.ndarray:
    """Motions at U = U0 and nominal shaft speed."""
    motion = np.zeros((len(angle), 7))
    motion[:, 0] = motion[:, 4] = 1.0
    if drifting:
        motion[:, 0], motion[:, 1] = np.cos(angle), -np.sin(angle)
    else:
        motion[:, 3] = angle
    return motion
