"""One page a recording: its channels with what is odd in them, and what the channels leave of each other."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.inspection import Inspection
from manoeuvre_nn.recording.check.motion import smoothed_motion
from manoeuvre_nn.report.style import COLOURS, legend_below, new_figure, plain_axes

LEFT_CHANNELS = (("u", "u [m/s]", 1.0), ("v", "v [m/s]", 1.0), ("r", "r [deg/s]", DEGREE), ("psi", "ψ [deg]", DEGREE))
"""Channel, label and its unit in SI."""
SHADE, ODD, LINE = "#F3D9B1", COLOURS[0], "#4D4D4D"
MAX_POINTS = 4000
"""Most samples that a line is drawn with."""

Series = Float[np.ndarray, " n"]


def check_figure(one: Inspection, ship: Particulars) -> Figure | None:
    """Channels on the left, the rudder and what identities leave on the right; None for a file that was not read."""
    run, clean = one.recording, one.clean
    if run is None or clean is None:
        return None
    figure = new_figure(7.6, width=9.0, title=one.name)
    axes = figure.subplots(4, 2, sharex=True)
    for row, (name, label, unit) in enumerate(LEFT_CHANNELS):
        _draw_channel(axes[row, 0], one, run, name, label, unit)
    _draw_channel(axes[0, 1], one, run, "delta", "δ [deg]", DEGREE)
    m = smoothed_motion(clean, ship)
    ahead, abeam = earth_to_body(m["xdot"], m["ydot"], m["psi"])
    tracked = not run.derived & {"u", "v", "x", "y"}
    rests = (
        ((m["psidot"] - m["r"]) / DEGREE, "dψ/dt − r [deg/s]", "r" not in run.derived, ("r", "psi")),
        (ahead - m["u"], "track − u [m/s]", tracked, ("u", "x", "y")),
        (abeam - m["v"], "track − v [m/s]", tracked, ("v", "x", "y")),
    )
    for row, (values, label, recorded, names) in enumerate(rests, start=1):
        _draw_rest(axes[row, 1], m.time, values, label, recorded)
        _shade(axes[row, 1], one, names)
    for column in axes[-1]:
        column.set_xlabel("t [s]")
    handles = [
        Line2D([], [], color=LINE, label="recorded"),
        Line2D([], [], color=COLOURS[1], label="what one channel leaves of another"),
        Line2D([], [], linestyle="", marker="o", color=ODD, markersize=4, label="outlier"),
        Patch(color=SHADE, label="gap, stuck, jump, unsteady"),
    ]
    legend_below(figure, handles, columns=4)
    return figure


def _draw_channel(axes: Axes, one: Inspection, run: Recording, name: str, label: str, unit: float) -> None:
    """A channel with its odd samples."""
    plain_axes(axes, "", label)
    _line(axes, run.time, run[name] / unit, LINE)
    if name in run.derived:
        axes.text(0.02, 0.92, "derived", transform=axes.transAxes, fontsize=8, color="#777777", va="top")
    flags = one.flags.get(name)
    if flags is not None and flags.any():
        axes.plot(run.time[flags], run[name][flags] / unit, "o", color=ODD, markersize=4, zorder=3)
    _shade(axes, one, (name,))


def _draw_rest(axes: Axes, time: Series, values: Series, label: str, recorded: bool) -> None:
    """What one channel leaves of another."""
    plain_axes(axes, "", label)
    if not recorded:
        axes.text(0.5, 0.5, "nothing to compare: derived", transform=axes.transAxes, ha="center", color="#777777")
        axes.set_yticks([])
        return
    axes.axhline(0.0, color="#999999", linewidth=0.8)
    _line(axes, time, values, COLOURS[1])
    low, high = np.quantile(values, [0.005, 0.995])
    room = 0.25 * max(high - low, 1e-9)
    axes.set_ylim(min(low, 0.0) - room, max(high, 0.0) + room)


def _line(axes: Axes, time: Series, values: Series, colour: str) -> None:
    """A line of as many samples as can be seen."""
    every = max(len(time) // MAX_POINTS, 1)
    axes.plot(time[::every], values[::every], color=colour, linewidth=1.0, rasterized=True)


def _shade(axes: Axes, one: Inspection, names: Sequence[str]) -> None:
    """Times that findings on some channels are about; those on no channel are about all."""
    if one.recording is None:
        return
    least = 0.004 * one.recording.duration
    for f in one.findings:
        if f.verdict == "ok" or f.check == "outliers" or (f.channels and not set(f.channels) & set(names)):
            continue
        for begin, end in f.spans:
            wider = max(least - (end - begin), 0.0) / 2
            axes.axvspan(begin - wider, end + wider, color=SHADE, linewidth=0, zorder=0)
