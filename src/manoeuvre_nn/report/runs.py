"""Recordings beside each other: a table and a figure of all of them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.report.style import COLOURS, new_figure, plain_axes
from manoeuvre_nn.report.tables import Row


def run_rows(runs: Sequence[Recording], length: float) -> list[Row]:
    """A row each recording; ``length`` is the ship's L [m]."""
    return [
        {
            "run": run.name,
            "duration [s]": f"{run.duration:.0f}",
            "samples": len(run),
            "rudder [deg]": _range_deg(run, "delta"),
            "heading [deg]": _range_deg(run, "psi"),
            "way / L": f"{_way(run) / length:.1f}",
            "status": _status(run, length),
        }
        for run in runs
    ]


def _status(run: Recording, length: float) -> str:
    """How a run ended; of a zigzag that was too short for the heading at which the rudder is reversed, this."""
    whole = {"u", "v", "r", "psi", "delta"} <= set(run.channels)
    found = criteria(run, str(run.meta.get("kind", "")), length) if whole else {}
    return "never reversed" if run.status == "ok" and found.get("reversals") == 0 else run.status


def _range_deg(run: Recording, channel: str) -> str:
    """Least and largest value of an angle."""
    values = _degrees(run, channel)
    return f"{round(np.nanmin(values))} to {round(np.nanmax(values))}" if np.isfinite(values).any() else "–"


def _degrees(run: Recording, channel: str) -> Float[np.ndarray, " n"]:
    """An angle without the whole turns at its start, so that 359.9 and .1 deg stand beside each other."""
    values = run.channels.get(channel, np.array([])) / DEGREE
    return values - 360 * np.round(values[np.isfinite(values)][:1].sum() / 360)


def _way(run: Recording) -> float:
    """Length of the track [m]; NaN where no position was recorded."""
    if not {"x", "y"} <= set(run.channels):
        return float("nan")
    return float(np.nansum(np.hypot(np.diff(run["x"]), np.diff(run["y"]))))


def runs_figure(runs: Sequence[Recording], length: float) -> Figure:
    """All tracks from above, in ship lengths L [m], and rudder and heading over time."""
    figure = new_figure(5.0, title="")
    tracks, series = figure.subplots(1, 2)
    plain_axes(tracks, "east y/L [-]", "north x/L [-]")
    plain_axes(series, "time t [s]", "heading ψ (full), rudder δ (dotted) [deg]")
    for k, run in enumerate(runs):
        colour = COLOURS[k % len(COLOURS)]
        if {"x", "y"} <= set(run.channels):
            tracks.plot(run["y"] / length, run["x"] / length, color=colour, label=run.name)
        for channel, style in (("psi", "-"), ("delta", ":")):
            if channel in run.channels:
                series.plot(run.time, _degrees(run, channel), style, color=colour)
    tracks.set_aspect("equal", adjustable="datalim")
    tracks.legend(fontsize=7)
    return figure
