"""Wang 1996, Figs 7.7 to 7.19: responses, autocorrelations and logarithms."""

import numpy as np

from studies.reproduction.section import Line, Panel, Plot
from studies.wang1996.free_decay import autocorrelation
from studies.wang1996.identification import ANGLES_DEG, DURATION, LONG, Voyages
from studies.wang1996.sway_yaw import START, STEP, System

RESPONSE = ("sway velocity [m/s]", "yaw rate [rad/s]")
LETTERS = ("v", "r")
FIRST_FIGURE = {"simplest": (7, 9), "linear": (12, 14), "nonlinear": (16, 18)}
"""System -> numbers of its first response and first autocorrelation."""


def _pair(voyages: Voyages, channel: int, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """The first sea's record at the chapter's angle and the free motion."""
    count = voyages.until(duration)
    return voyages.waves[ANGLES_DEG[0]][0, :count, channel], voyages.free[:count, channel]


def response_plots(name: str, voyages: Voyages) -> list[Plot]:
    """Responses of v and r with and without waves.

    Args:
        name: The system.
        voyages: Its motions.

    Returns:
        Two figures.
    """
    plots = []
    for channel, letter in enumerate(LETTERS):
        number = FIRST_FIGURE[name][0] + channel
        record, free = _pair(voyages, channel, DURATION)
        time = voyages.time[: len(free)]
        lines = [Line("in waves", time, record), Line("free", time, free, role="reference")]
        caption = f"Fig 7.{number}: {letter} in the {name} system, one sea at 45 deg"
        plots.append(Plot(f"figure_7_{number}", caption, [Panel("time [s]", RESPONSE[channel], lines)]))
    return plots


def autocorrelation_plots(name: str, voyages: Voyages) -> list[Plot]:
    """Autocorrelations of v and r with and without waves, for a short and a long observation.

    Args:
        name: The system.
        voyages: Its motions.

    Returns:
        Two figures.
    """
    plots, lags = [], voyages.until(50.0) - 1
    for channel, letter in enumerate(LETTERS):
        number, panels = FIRST_FIGURE[name][1] + channel, []
        for duration in (DURATION, LONG):
            record, free = (autocorrelation(x, lags) for x in _pair(voyages, channel, duration))
            lag = STEP * np.arange(lags + 1)
            lines = [Line("in waves", lag, record), Line("free", lag, free, role="reference")]
            panels.append(Panel("lag [s]", f"R_{letter}{letter}", lines, title=f"T* = {duration:g} s"))
        caption = f"Fig 7.{number}: autocorrelation of {letter} in the {name} system, one sea at 45 deg"
        plots.append(Plot(f"figure_7_{number}", caption, panels))
    return plots


def logarithm_plot(system: System, voyages: Voyages) -> Plot:
    """Fig 7.11: logarithms of the free motion and of the folded autocorrelation.

    Args:
        system: The simplest system.
        voyages: Its motions.

    Returns:
        The figure.
    """
    assert system.matrix is not None
    panels, lags = [], voyages.until(60.0) - 1
    lag = STEP * np.arange(lags + 1)
    for channel, letter in enumerate(LETTERS):
        record, free = _pair(voyages, channel, DURATION)
        logs = np.log(np.abs(autocorrelation(record, lags)))
        lines = [
            Line(f"ln |{letter}|, free", lag, np.log(np.abs(free[: lags + 1]))),
            Line(f"ln |R_{letter}{letter}|, in waves", lag[::4], logs[::4], points=True),
            Line("slope of the system", lag, logs[0] + system.matrix[channel, channel] * lag, role="reference"),
        ]
        title = f"start {START[channel]:g}"
        panels.append(Panel("time or lag [s]", "natural logarithm", lines, title=title))
    return Plot("figure_7_11", "Fig 7.11: logarithms in the simplest system, one sea at 45 deg", panels)
