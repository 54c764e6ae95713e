"""Figures of coefficients: intervals before and after the recordings, beside captive tests; forces by both."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.captive_fit import Towed, forces
from manoeuvre_nn.estimation.coefficients import EQUATIONS, REACH, Coefficient, Fitted, coefficient_table
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
    parts = [[r for r in told.rows if r.symbol[0] == e] for e in EQUATIONS]
    captive = {} if told.captive is None else {r.symbol: r for r in coefficient_table(told.captive)}
    heights = [max(len(p), 1) for p in parts]
    figure = new_figure(1.6 + 0.23 * sum(heights), title="Coefficients: before and after the recordings")
    panels = figure.subplots(3, 1, height_ratios=heights, sharex=True)
    reach = _farthest([*told.rows], captive)
    for axes, equation, rows in zip(panels, EQUATIONS, parts, strict=True):
        _draw_intervals(axes, rows, captive)
        axes.set_xlim(-reach, reach)
        axes.set_ylabel(equation, rotation=0, labelpad=10, fontweight="bold")
    panels[-1].set_xlabel("(coefficient - assumed) / standard deviation of what was assumed [-]")
    handles = [
        Line2D([], [], color=BEFORE, linewidth=5, label="assumed"),
        Line2D([], [], color=AFTER, marker="o", markersize=4, linewidth=2, label="recordings"),
    ]
    if captive:
        handles.append(Line2D([], [], color=CAPTIVE, marker="s", markersize=4, linewidth=2, label="captive tests"))
    legend_below(figure, handles)
    return figure


def _draw_intervals(axes: Axes, rows: Sequence[Coefficient], captive: dict[str, Coefficient]) -> None:
    """One force's coefficients, the first on top."""
    plain_axes(axes, "", "")
    axes.axvspan(-REACH, REACH, color="#EFEFEF", zorder=0)
    places = np.arange(len(rows))[::-1]
    for place, r in zip(places, rows, strict=True):
        axes.plot([-REACH, REACH], [place, place], color=BEFORE, linewidth=4, zorder=1, solid_capstyle="butt")
        lift = 0.16 if captive else 0.0
        for one, colour, marker, shift in ((r, AFTER, "o", lift), (captive.get(r.symbol), CAPTIVE, "s", -lift)):
            if one is None:
                continue
            ends = _over_assumed(one, r)
            axes.plot(ends[[0, 2]], [place + shift] * 2, color=colour, linewidth=1.8, zorder=3)
            axes.plot(ends[1], place + shift, marker, color=colour, markersize=3.5, zorder=4)
    axes.set_yticks(places, [_written(r.symbol) for r in rows], fontsize=8)
    axes.set_ylim(-0.7, max(len(rows), 1) - 0.3)


def _over_assumed(one: Coefficient, assumed: Coefficient) -> np.ndarray:
    """Lower end, value and upper end, from what was assumed and over its standard deviation."""
    unit = max(assumed.prior_error, MIN_PRIOR_RATIO * max(abs(assumed.prior), 1.0))
    return (np.array([one.low, one.value, one.high]) - assumed.prior) / unit


def _farthest(rows: Sequence[Coefficient], captive: dict[str, Coefficient]) -> float:
    """Half width of the axis: no interval is cut off."""
    ends = [_over_assumed(one, r) for r in rows for one in (r, captive.get(r.symbol)) if one is not None]
    return 1.05 * max(MIN_HALF_WIDTH, float(np.abs(ends).max(initial=0.0)))


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
