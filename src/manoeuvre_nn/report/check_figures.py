"""One figure a recording: its channels with what is odd in them, and what the channels leave of each other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.inspection import Inspection
from manoeuvre_nn.recording.check.motion import smoothed_motion
from manoeuvre_nn.report.chart import Chart, ChartPanel, Curve, Span, draw_grid, legend_entries
from manoeuvre_nn.report.style import COLOURS, legend_below, new_figure

CHANNELS = (("u", "u\n[m/s]", 1.0), ("v", "v\n[m/s]", 1.0), ("r", "r\n[deg/s]", DEGREE), ("psi", "ψ\n[deg]", DEGREE))
"""Channel, label and its unit in SI, down the left side."""
POSITIONS = (("x", "x north\n[m]", 1.0), ("y", "y east\n[m]", 1.0))
"""The same on the right, where no velocity but that of the positions can be compared with them."""
LINE: dict[str, Any] = {"color": "#4D4D4D", "linewidth": 1.0}
REST: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.0}
ODD: dict[str, Any] = {"color": COLOURS[0], "linestyle": "", "marker": "o", "markersize": 4, "linewidth": 0}
SHADE: dict[str, Any] = {"facecolor": "#F3D9B1", "linewidth": 0}

Series = Float[np.ndarray, " n"]


def check_chart(one: Inspection, ship: Particulars) -> Chart | None:
    """Channels on the left, the rudder and what identities leave on the right; None for a file that was not read."""
    run, clean = one.recording, one.clean
    if run is None or clean is None:
        return None
    m = smoothed_motion(clean, ship)
    ahead, abeam = earth_to_body(m["xdot"], m["ydot"], m["psi"])
    right = [
        _channel(one, "delta", "δ\n[deg]", DEGREE),
        _rest(one, m.time, (m["psidot"] - m["r"]) / DEGREE, "dψ/dt − r\n[deg/s]", ("r", "psi"), "r" not in run.derived),
    ]
    if run.derived & {"u", "v", "x", "y"}:
        right += [_channel(one, *channel) for channel in POSITIONS]
    else:
        right.append(_rest(one, m.time, ahead - m["u"], "track − u\n[m/s]", ("u", "x", "y")))
        right.append(_rest(one, m.time, abeam - m["v"], "track − v\n[m/s]", ("v", "x", "y")))
    left = [_channel(one, *channel) for channel in CHANNELS]
    return Chart([panel for row in zip(left, right, strict=True) for panel in row], columns=2, one_time=True)


def check_figure(chart: Chart, name: str) -> Figure:
    """The chart of a recording, drawn."""
    figure = new_figure(7.6, width=9.0, title=name)
    grid = figure.subplots(len(chart.panels) // 2, 2, sharex=True)
    draw_grid(grid, chart.panels)
    for line in (line for axes in grid.ravel() for line in axes.get_lines()):
        line.set_rasterized(True)
    legend_below(figure, legend_entries(chart.panels), columns=4)
    return figure


def _channel(one: Inspection, name: str, label: str, unit: float) -> ChartPanel:
    """A channel with its odd samples."""
    run = one.recording
    assert run is not None
    values, flags = run[name] / unit, one.flags.get(name)
    curves = [Curve(run.time, values, LINE, "recorded")]
    if flags is not None and flags.any():
        curves.append(Curve(run.time[flags], values[flags], ODD, "outlier"))
    title = "derived" if name in run.derived else ""
    return ChartPanel("t [s]", label, curves, spans=_spans(one, (name,)), title=title)


def _rest(
    one: Inspection, time: Series, values: Series, label: str, names: Sequence[str], recorded: bool = True
) -> ChartPanel:
    """What one channel leaves of another."""
    spans = _spans(one, names)
    if not recorded:
        return ChartPanel("t [s]", label, spans=spans, title="nothing to compare: derived")
    low, high = np.quantile(values, [0.005, 0.995])
    room = 0.25 * max(high - low, 1e-9)
    limits = float(time[0]), float(time[-1]), float(min(low, 0.0) - room), float(max(high, 0.0) + room)
    curve = Curve(time, values, REST, "what one channel leaves of another")
    return ChartPanel("t [s]", label, [curve], spans=spans, limits=limits, level=0.0)


def _spans(one: Inspection, names: Sequence[str]) -> list[Span]:
    """Times that findings on some channels are about; those on no channel are about all."""
    assert one.recording is not None
    least, found = 0.004 * one.recording.duration, []
    for f in one.findings:
        if f.verdict == "ok" or f.check == "outliers" or (f.channels and not set(f.channels) & set(names)):
            continue
        for begin, end in f.spans:
            wider = max(least - (end - begin), 0.0) / 2
            found.append(Span(begin - wider, end + wider, SHADE, "gap, stuck, jump, unsteady"))
    return found
