"""Figures of what to sail next: what each candidate would bring, and where the members disagree."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.report.design_tables import ManoeuvreAdvice
from manoeuvre_nn.report.style import COLOURS, legend_below, log_axis, new_figure, plain_axes


def gain_figure(a: ManoeuvreAdvice) -> Figure:
    """What is expected now and after each candidate, best on top; the advised one is filled."""
    figure = new_figure(1.4 + 0.27 * len(a.expected), title="What each manoeuvre would bring")
    what = "expected deviation on the targets / L [-]" if a.goal == "accuracy" else "standard errors / noise [-]"
    axes = plain_axes(figure.subplots(), what, "")
    places = np.arange(len(a.expected))[::-1]
    for place, e in zip(places, a.expected, strict=True):
        axes.plot([e.then, e.now], [place, place], color="#BBBBBB", linewidth=2.5, zorder=1)
        face = COLOURS[0] if e is a.best else "white"
        axes.plot(e.then, place, "o", markerfacecolor=face, markeredgecolor=COLOURS[0], markersize=6)
        axes.plot(e.now, place, "|", color="#4D4D4D", markersize=9, markeredgewidth=1.8)
    axes.set_ylim(-0.5, len(places) - 0.5)
    axes.set_yticks(places, [e.manoeuvre for e in a.expected], fontsize=9)
    if a.goal == "accuracy":
        axes.set_xlim(left=0.0)
    else:
        log_axis(axes, "x")
    handles = [
        Line2D([], [], linestyle="", marker="|", color="#4D4D4D", markersize=9, markeredgewidth=1.8, label="now"),
        Line2D([], [], linestyle="", marker="o", markerfacecolor="white", color=COLOURS[0], label="after it"),
        Line2D([], [], linestyle="", marker="o", color=COLOURS[0], label="advised"),
    ]
    legend_below(figure, handles)
    return figure


def where_figure(a: ManoeuvreAdvice) -> Figure:
    """Where in the planes of rudder, sway and yaw rate the members disagree, and what is recorded there."""
    figure = new_figure(4.2, width=6.6, title="Where the members disagree about the forces")
    left, right = figure.subplots(1, 2)
    assert a.where is not None
    motion, spread = a.where[["v", "r", "delta"]].to_numpy(), a.where["spread"].to_numpy()
    high = max(float(spread.max()), 1e-9)
    norm = LogNorm(max(float(np.quantile(spread, 0.05)), 1e-3 * high), high, clip=True)
    order = np.argsort(spread)
    dots = None
    for axes, column, factor, label in ((left, 2, 1 / DEGREE, "rudder δ [deg]"), (right, 0, 1.0, "sway v′ [-]")):
        plain_axes(axes, label, "yaw rate r′ [-]")
        recorded = factor * a.recorded[:, column], a.recorded[:, 1]
        axes.scatter(*recorded, s=22, marker="s", color="#D9D9D9", linewidth=0, rasterized=True)
        place = factor * motion[order, column], motion[order, 1]
        dots = axes.scatter(*place, c=spread[order], s=7, norm=norm, cmap="viridis", linewidth=0, rasterized=True)
    assert dots is not None
    bar = figure.colorbar(dots, ax=[left, right], shrink=0.9)
    bar.set_label("std of the members / RMS of the forces [-]")
    legend_below(figure, [Line2D([], [], linestyle="", marker="s", color="#D9D9D9", label="recorded")])
    return figure
