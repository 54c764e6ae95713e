"""A predicted manoeuvre beside the recorded one: track from above, channels over time, yaw rate over rudder."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.manoeuvre.criteria import reversal_times, spiral_holds, spiral_loop, trace
from manoeuvre_nn.report.chart import Arrow, Band, Chart, ChartPanel, Curve, Mark, Span, along
from manoeuvre_nn.report.style import COLOURS, PREDICTED, RECORDED
from manoeuvre_nn.report.track_marks import BREADTH, Track, recorded_wind, rudder_marks, ships

PANELS: dict[str, tuple[str, float]] = {
    "psi": ("heading ψ [deg]", 1 / DEGREE),
    "delta": ("rudder δ [deg]\n+ starboard", 1 / DEGREE),
    "r": ("yaw rate r [deg/s]", 1 / DEGREE),
    "u": ("surge u [m/s]", 1.0),
    "v": ("sway v [m/s]", 1.0),
}
"""Channels over time from the top down: axis label, factor from SI."""
MEMBER: dict[str, Any] = {"color": COLOURS[0], "linewidth": 0.6, "alpha": 0.5}
MEMBERS: dict[str, Any] = {"color": COLOURS[0], "alpha": 0.2, "linewidth": 0}
ENDED: dict[str, Any] = {"color": COLOURS[0], "alpha": 0.12, "linewidth": 0}
MEASURE: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 1.0}
APART: dict[str, Any] = {"color": COLOURS[1], "linestyle": "-", "linewidth": 1.5}
LOOP: dict[str, Any] = {**MEASURE, "linestyle": "-", "linewidth": 3.0, "alpha": 0.6}
MAX_OVERSHOOTS = 8
"""Overshoots that are marked: the first ones."""
MEMBER_POINTS = 150
"""About how many points the track of a member has: they are many."""
OUTLINES = 8
"""Ships on a track, at even times."""


def comparison_charts(
    reference: Recording,
    prediction: Recording,
    members: Sequence[Recording] = (),
    breadth: float = BREADTH,
    arrows: Sequence[Arrow] = (),
) -> dict[str, Chart]:
    """Everything that compares one predicted manoeuvre with the recorded one.

    Args:
        reference: What was recorded; its ``meta`` says the ship's length L [m] and the kind of manoeuvre.
        prediction: What was predicted.
        members: What each member of an ensemble predicts.
        breadth: B/L of the ship [-].
        arrows: Wind and current of which the recording has no channel.

    Returns:
        Name -> chart: ``track``, ``time series`` and, where the rudder moves both ways, ``rate against rudder``.
    """
    charts = {
        "track": track_chart(reference, prediction, members, breadth, arrows),
        "time series": time_chart(reference, prediction, members),
    }
    if reference.meta.get("kind") in {"spiral", "zigzag", "mixed_zigzag"}:
        charts["rate against rudder"] = Chart([_rate_panel(reference, prediction)])
    return charts


def track_chart(
    reference: Recording,
    prediction: Recording,
    members: Sequence[Recording] = (),
    breadth: float = BREADTH,
    arrows: Sequence[Arrow] = (),
) -> Chart:
    """Both tracks from above, and the distance between them over time.

    North is up and east to the right, in ship lengths from where the recording starts. Ships to scale, at the same
    times on both tracks, show heading, rudder and drift, and how far one lags behind the other.

    Args:
        reference: What was recorded.
        prediction: What was predicted.
        members: What each member of an ensemble predicts.
        breadth: B/L of the ship [-].
        arrows: Wind and current of which the recording has no channel.

    Returns:
        A map and the distance.
    """
    length = float(reference.meta["length"])
    start = np.array([reference["y"][0], reference["x"][0]])

    def seen_from_start(run: Recording) -> Track:
        return (np.stack([run["y"], run["x"]], axis=-1) - start) / length

    tracks = [seen_from_start(run) for run in (reference, prediction)]
    curves = [
        along(seen_from_start(member)[:: 1 + len(member) // MEMBER_POINTS], MEMBER, "members", name=f"member {number}")
        for number, member in enumerate(members, start=1)
    ]
    times = np.linspace(reference.time[0], reference.time[-1], OUTLINES)
    runs = ((reference, tracks[0], RECORDED, "recorded"), (prediction, tracks[1], PREDICTED, "predicted"))
    for run, track, style, label in runs:
        curves += [ships(run, track, times, (1.0, breadth), style), along(track, style, label, times=run.time)]
    measures, marks = _turning_measures(reference, start, length)
    winds = [*recorded_wind(reference), *arrows]
    low, high = _limits([*tracks, *(np.stack([m.x, m.y], axis=-1) for m in measures)])
    map_panel = ChartPanel(
        "east y/L [-]", "north x/L [-]", [*curves, *measures], marks=[*rudder_marks(reference, tracks[0]), *marks],
        arrows=winds, equal=True, limits=(low[0], high[0], low[1], high[1] + 0.08 * len(winds) * (high[1] - low[1])),
        title=_predicted_measures(prediction, length) if measures else "",
    )  # fmt: skip
    return Chart([map_panel, _distance_panel(reference, prediction, length)])


def _limits(tracks: Sequence[Track]) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Corners of the map: all points, half a ship around them, and never so narrow that the axis has no room."""
    points = np.concatenate(tracks)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0) - 0.7, points.max(axis=0) + 0.7
    lacking = np.maximum(0.25 * (high - low).max() - (high - low), 0.0)
    return low - lacking / 2, high + lacking / 2


def _turning_measures(
    reference: Recording, start: Float[np.ndarray, " 2"], length: float
) -> tuple[list[Curve], list[Mark]]:
    """Advance, transfer and tactical diameter of a recorded turning circle, drawn where they are read."""
    circle = reference.meta.get("kind") == "turning_circle"
    seen = trace(reference) if circle else None
    if seen is None:
        return [], []
    course, *execute = (float(np.interp(seen.execute, reference.time, reference[k])) for k in ("psi", "y", "x"))
    forward, abeam = (np.array([np.sin(a), np.cos(a)]) for a in (course, course + seen.side * 0.5 * pi))
    curves, marks = [], []
    for name, segment in turning_segments(reference, length).items():
        ends = (execute - start) / length + segment @ np.stack([forward, abeam])
        curves.append(along(ends, MEASURE))
        east, north = ends.mean(axis=0).tolist()
        marks.append(Mark(east, north, f"{name} {_size(segment):.3g} L"))
    return curves, marks


def _predicted_measures(prediction: Recording, length: float) -> str:
    """The same measures of the prediction, in words."""
    found = [f"{name} {_size(segment):.3g} L" for name, segment in turning_segments(prediction, length).items()]
    return f"predicted: {', '.join(found[:2])},\n{', '.join(found[2:])}".strip(",\n") if found else ""


def turning_segments(run: Recording, length: float) -> dict[str, Float[np.ndarray, "2 2"]]:
    """Where the measures of a turning circle begin and end.

    Args:
        run: The circle; one that was ended early, or of which no positions are known, has none.
        length: L [m].

    Returns:
        Name -> both ends: distance over L ahead of the execute, and to the side of the turn.
    """
    seen = trace(run) if run.status == OK else None
    if seen is None or seen.ahead is None:
        return {}
    (advance, transfer), (behind, diameter) = (seen.place_at(seen.time_at(turn)) for turn in (0.5 * pi, pi))
    ends = {
        "advance": [(0.0, 0.0), (advance, 0.0)],
        "transfer": [(advance, 0.0), (advance, transfer)],
        "tactical diameter": [(behind, 0.0), (behind, diameter)],
    }
    segments = {name: np.array(pair) / length for name, pair in ends.items()}
    return {name: segment for name, segment in segments.items() if np.isfinite(segment).all()}


def _size(segment: Float[np.ndarray, "2 2"]) -> float:
    """Length of a straight line."""
    return float(np.hypot(*(segment[1] - segment[0])))


def _distance_panel(reference: Recording, prediction: Recording, length: float) -> ChartPanel:
    """Distance between the tracks; a prediction that ended early rests, as the score has it."""
    ended = prediction.status != OK
    times = reference.time if ended else reference.time[reference.time <= prediction.time[-1] + 1e-9]
    gaps = [
        np.interp(times, prediction.time, prediction[k]) - np.interp(times, reference.time, reference[k]) for k in "xy"
    ]
    distance = np.hypot(*gaps) / length
    peak = int(distance.argmax())
    high = 1.08 * float(distance[peak]) or 1.0
    return ChartPanel(
        "time t [s]", "distance / L [-]", [Curve(times, distance, APART)], spans=_ended(reference, prediction),
        marks=[Mark(float(times[peak]), float(distance[peak]), "", "o", COLOURS[1])],
        limits=(float(reference.time[0]), float(reference.time[-1]), 0.0, high),
        title=f"largest: {distance[peak]:.3g} L at {times[peak]:.0f} s",
    )  # fmt: skip


def _ended(reference: Recording, prediction: Recording) -> list[Span]:
    """The time that an ended prediction did not live to see."""
    if prediction.status == OK:
        return []
    return [Span(float(prediction.time[-1]), float(reference.time[-1]), ENDED)]


def time_chart(reference: Recording, prediction: Recording, members: Sequence[Recording] = ()) -> Chart:
    """Heading and rudder, yaw rate, surge and sway over time in stacked panels.

    Heading and rudder share a panel, as in a zigzag diagram, the heading counted from that of the approach, unless it
    goes so far that the rudder would look flat beside it.

    Args:
        reference: What was recorded.
        prediction: What was predicted.
        members: What each member of an ensemble predicts: all lie in the shaded band.

    Returns:
        A panel a row. Time that a prediction did not reach is shaded, and its status written above.
    """
    together = np.ptp(reference["psi"]) < 4.0 * max(np.ptp(reference["delta"]), 1e-3)
    rows = [("psi", "delta"), ("r",), ("u",), ("v",)] if together else [(name,) for name in PANELS]
    marks = _overshoots(reference, prediction)
    if together:
        course = float(reference["psi"][0])
        reference, prediction, *members = (
            run.with_channels(psi=run["psi"] - course) for run in (reference, prediction, *members)
        )
        marks = [mark._replace(y=mark.y - course / DEGREE) for mark in marks]
    panels = []
    for names in rows:
        label = "ψ − ψ(0), and δ thin\n[deg]" if len(names) > 1 else PANELS[names[0]][0].replace(" [", "\n[", 1)
        curves = [
            Curve(run.time, PANELS[name][1] * run[name], {**style, "linewidth": 0.9} if thin else style, said)
            for thin, name in enumerate(names)
            for run, style, said in ((reference, RECORDED, "recorded"), (prediction, PREDICTED, "predicted"))
        ]
        band = _members_band(names[0], prediction, members)
        panels.append(ChartPanel("time t [s]", label, curves, bands=band, spans=_ended(reference, prediction)))
    said = ["● overshoot, recorded (predicted)"] if marks else []
    said += [f"prediction {prediction.status}"] if prediction.status != OK else []
    panels[0] = replace(panels[0], marks=marks, title="; ".join(said), limits=_roomy(panels[0]) if marks else None)
    return Chart(panels, one_time=True)


def _roomy(panel: ChartPanel) -> tuple[float, float, float, float]:
    """Ends of axes with room for words above and below the curves."""
    low, high = (float(end([end(curve.y) for curve in panel.curves])) for end in (np.nanmin, np.nanmax))
    time = panel.curves[0].x
    return float(time[0]), float(time[-1]), low - 0.25 * (high - low), high + 0.25 * (high - low)


def _members_band(name: str, prediction: Recording, members: Sequence[Recording]) -> list[Band]:
    """What the members of an ensemble say of a channel."""
    if not members or name == "delta":
        return []
    said = PANELS[name][1] * np.array([np.interp(prediction.time, m.time, m[name]) for m in members])
    return [Band(prediction.time, said.min(axis=0), said.max(axis=0), MEMBERS, "members")]


def _overshoots(reference: Recording, prediction: Recording) -> list[Mark]:
    """Where the heading of a zigzag turns back, with the overshoots: recorded, and predicted in brackets."""
    if reference.meta.get("kind") != "zigzag":
        return []
    recorded, predicted = _swings(reference), _swings(prediction)
    marks, mean = [], float(np.mean([heading for _, heading, _ in recorded] or [0.0]))
    for k, (time, heading, overshoot) in enumerate(recorded[:MAX_OVERSHOOTS]):
        model = f" ({predicted[k][2]:.3g}°)" if k < len(predicted) else ""
        place = f"{'top' if heading > mean else 'bottom'} center"
        marks.append(Mark(time, heading, f"{overshoot:.3g}°{model}", "o", place=place))
    return marks


def _swings(run: Recording) -> list[tuple[float, float, float]]:
    """Time [s], heading [deg] and overshoot [deg] of each swing of a zigzag that is whole."""
    seen = trace(run)
    if seen is None:
        return []
    reversals, end = reversal_times(seen)
    swings = []
    for k, (start, stop) in enumerate(pairwise([*reversals, end])):
        side = (-1) ** k
        time = seen.peak_time(start, stop, side)
        overshoot = side * (float(seen.turn(time)) - float(seen.turn(start)))
        if np.isfinite(overshoot):
            swings.append((time, float(np.interp(time, run.time, run["psi"])) / DEGREE, overshoot / DEGREE))
    return swings


def _rate_panel(reference: Recording, prediction: Recording) -> ChartPanel:
    """Yaw rate over rudder angle; of a spiral the ends of the holds, and how wide and high its loop is."""
    spiral = reference.meta.get("kind") == "spiral"
    curves = []
    for run, style, said, marker in ((reference, RECORDED, "recorded", "o"), (prediction, PREDICTED, "predicted", "D")):
        seen = trace(run) if spiral else None
        if seen is None:
            curves.append(Curve(run["delta"] / DEGREE, run["r"] / DEGREE, style, said, run.time))
            continue
        delta, rate = spiral_holds(seen).T / DEGREE
        face = {"marker": marker, "markersize": 5, "markerfacecolor": style["color"] if marker == "o" else "none"}
        curves.append(Curve(delta, rate, {**style, **face}, f"{said}, end of each hold"))
    measures, marks = _loop_measures(reference) if spiral else ([], [])
    labels = "rudder δ [deg], positive to starboard", "yaw rate r [deg/s], positive to starboard"
    return ChartPanel(*labels, [*curves, *measures], marks=marks, level=0.0)


def _loop_measures(run: Recording) -> tuple[list[Curve], list[Mark]]:
    """Width of a spiral's loop along the axis of no yaw, and its height with the rudder amidships."""
    seen = trace(run)
    loop = spiral_loop(seen) if seen else None
    if loop is None:
        return [], []
    (left, right), (low, high) = (np.array(pair) / DEGREE for pair in loop)
    curves, marks = [], []
    if np.isfinite([left, right]).all():
        curves.append(Curve(np.array([left, right]), np.zeros(2), LOOP))
        marks.append(Mark(float(max(left, right)), 0.0, f"loop width {abs(left - right):.3g}°", place="bottom right"))
    if np.isfinite([low, high]).all():
        curves.append(Curve(np.zeros(2), np.array([low, high]), LOOP))
        marks.append(Mark(0.0, float(max(low, high)), f"loop height {abs(low - high):.3g}°/s", place="top left"))
    return curves, marks
