"""What can be zoomed of a diagnosis: held-out and planned tracks, channels over time, the missing force over time."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.result import Diagnosis, Interval, Proof, Residual
from manoeuvre_nn.report.chart import Arrow, Band, Chart, ChartPanel, Curve, Mark, Samples, Span, along
from manoeuvre_nn.report.diagnosis_tables import AFTER, BEFORE, CHANNELS
from manoeuvre_nn.report.style import COLOURS, PREDICTED, RECORDED, short_name
from manoeuvre_nn.report.tables import text
from manoeuvre_nn.report.track_marks import effect_arrows, rudder_marks, ships

TRUTH: dict[str, Any] = RECORDED
CALM: dict[str, Any] = PREDICTED
REPAIRED: dict[str, Any] = {"color": COLOURS[1], "linestyle": "-", "linewidth": 1.2}
STYLES = {"recorded": TRUTH, BEFORE: CALM, AFTER: REPAIRED}
"""How the curves of a comparison look, by what they are called."""
WINDOW: dict[str, Any] = {"facecolor": COLOURS[4], "alpha": 0.22, "linewidth": 0}
BAND: dict[str, Any] = {"alpha": 0.25, "linewidth": 0}
WITHIN: dict[str, Any] = {"color": COLOURS[1], "alpha": 0.22, "linewidth": 0}
WITHIN_LABEL = "95 % of recordings"
MISSING: dict[str, Any] = {"color": CALM["color"], "linewidth": 1.3}
FORCES = ("surge X", "sway Y", "yaw N")
TITLE_LETTERS = 28
"""Letters on a line above a map."""
MAX_SPACING = 2.5
"""Largest distance between two values, over the usual one, that a line bridges."""
OUTLINES = 7
"""Ships on a track, and places at which the band of a planned one is drawn, at even times."""


def diagnosis_charts(d: Diagnosis) -> dict[str, Chart]:
    """Charts by the names of the figures that show them."""
    charts = {"tracks": track_chart(d.proofs, d.repaired, d.dimensions, found_arrows(d))} if d.proofs else {}
    charts |= {f"residual/{residual.run}": residual_chart(residual, bool(d.model)) for residual in d.residuals}
    if d.forecasts:
        charts["planned"] = forecast_tracks(d.forecasts)
    charts |= {f"planned/{planned.run}": forecast_chart(planned) for planned in d.forecasts}
    return charts | {f"channels/{proof.run}": channel_chart(proof, d.noise, d.repaired) for proof in d.proofs}


def found_arrows(d: Diagnosis) -> list[Arrow]:
    """Winds and currents of the repaired model."""
    named = {c.name: {v.name: v.value for v in c.parameters} for c in d.causes if c.name in d.model}
    return effect_arrows(named, ", as found")


def track_chart(
    proofs: Sequence[Proof],
    repaired: bool,
    dimensions: tuple[float, float] | None = None,
    arrows: Sequence[Arrow] = (),
) -> Chart:
    """Held-out runs from above, north up: recorded, by calm water, repaired; ships of a look at the same times.

    Args:
        proofs: The runs.
        repaired: Whether there is a repaired model.
        dimensions: L and B of the ship [m]; None draws no ships.
        arrows: Winds and currents.

    Returns:
        A map a run, two side by side.
    """
    return Chart([_map(proof, repaired, dimensions, arrows) for proof in proofs], columns=min(len(proofs), 2))


def _map(proof: Proof, repaired: bool, dimensions: tuple[float, float] | None, arrows: Sequence[Arrow]) -> ChartPanel:
    """One run."""
    tables = dict(zip(STYLES, models(proof, repaired), strict=False))
    origin = start_of(proof.recorded[["y", "x"]].to_numpy(float))
    tables["recorded"] = proof.recorded.iloc[_as_sampled(proof.recorded["x"].to_numpy(float))]
    runs = {name: _as_recording(table, proof) for name, table in tables.items()}
    curves, time = [], proof.recorded["t"].to_numpy(float)
    for name, run in runs.items():
        track = np.stack([run["y"], run["x"]], axis=-1) - origin
        if dimensions is not None:
            curves.append(ships(run, track, np.linspace(time[0], time[-1], OUTLINES), dimensions, STYLES[name]))
        curves.append(along(track, STYLES[name], name, times=run.time))
    recorded = runs["recorded"]
    marks = rudder_marks(recorded, np.stack([recorded["y"], recorded["x"]], axis=-1) - origin)
    before, after = (errors.get("pos", np.nan) for errors in (proof.rmse_before, proof.rmse_after))
    missed = " → ".join(f"{text(gap, 3)} m" for gap in ([before, after] if repaired else [before]))
    return track_panel(curves, f"{run_title(proof, TITLE_LETTERS)}\noff by {missed}", marks, arrows)


def track_panel(
    curves: Sequence[Curve], title: str, marks: Sequence[Mark] = (), arrows: Sequence[Arrow] = ()
) -> ChartPanel:
    """A map in metres from where the tracks start."""
    start = Mark(0.0, 0.0, "" if marks else "start", "*")
    labels = "east y [m]", "north x [m]"
    return ChartPanel(*labels, curves, marks=[start, *marks], arrows=arrows, equal=True, title=title)


def start_of(track: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " 2"]:
    """The first place that is known."""
    known = track[np.isfinite(track).all(axis=1)]
    return known[0] if len(known) else np.zeros(2)


def _as_recording(table: pd.DataFrame, proof: Proof) -> Recording:
    """A track in SI with the rudder that was recorded, by which the models were steered too."""
    c = {k: table[k].to_numpy(float) for k in ("x", "y", "u", "v")}
    time, recorded = table["t"].to_numpy(float), proof.recorded
    rudder = np.zeros(len(time))
    if "delta" in recorded:
        rudder = np.interp(time, recorded["t"].to_numpy(float), recorded["delta"].to_numpy(float)) * DEGREE
    angles = {"psi": continuous(table["psi"].to_numpy(float)) * DEGREE, "r": table["r"].to_numpy(float) * DEGREE}
    return Recording(proof.run, time, {**c, **angles, "delta": rudder})


def models(proof: Proof, repaired: bool) -> list[pd.DataFrame]:
    """Recorded, before and, if there is a repaired model, after."""
    return [proof.recorded, proof.before, *([proof.after] if repaired else [])]


def run_title(proof: Proof, width: int) -> str:
    """Run and manoeuvre."""
    return short_name(f"{proof.run}, {proof.kind}" if proof.kind else proof.run, width)


def channel_chart(proof: Proof, noise: Mapping[str, float], repaired: bool) -> Chart:
    """Heading, yaw rate, surge, sway and log of a held-out run over time, as far as recorded, and errors and noise."""
    time = proof.recorded["t"].to_numpy(float)
    panels, told = [], [channel for channel in CHANNELS if channel != "pos"]
    for name in [channel for channel in told if proof.recorded[channel].notna().any()] or told:
        words, _, unit = CHANNELS[name]
        truth, *predicted = _series(proof, name, repaired)
        rows = _as_sampled(truth)
        drawn = [(time[rows], truth[rows]), *((time, values) for values in predicted)]
        curves = [Curve(*one, style, said) for one, (said, style) in zip(drawn, STYLES.items(), strict=False)]
        panels.append(ChartPanel("time t [s]", f"{words}\n[{unit}]", curves))
        errors = [(values - truth)[rows] for values in predicted]
        panels.append(_error_panel(time[rows], errors, float(np.nan_to_num(noise.get(name, 0.0))), unit))
    return Chart(panels, columns=2, one_time=True)


def _as_sampled(values: Samples) -> Int[np.ndarray, " k"]:
    """Rows that a line is drawn through: all but the empty ones between two values at the usual distance.

    A sensor that is slower than the steps of the table has a value in every so many rows only; holes stay holes.

    Returns:
        Numbers of the rows.
    """
    rows, known = np.arange(len(values)), np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return rows
    apart = np.diff(known)
    after = np.clip(np.searchsorted(known, rows), 1, len(apart))
    between = (rows > known[after - 1]) & (rows < known[after])
    return rows[~(between & (apart[after - 1] <= MAX_SPACING * np.median(apart)))]


def continuous(angle: Samples) -> Samples:
    """An angle [deg] without jumps, gaps kept."""
    angle = np.array(angle, float)
    known = np.isfinite(angle)
    angle[known] = np.unwrap(angle[known], period=360.0)
    return angle


def _series(proof: Proof, name: str, repaired: bool) -> list[Samples]:
    """Recorded, before and after; headings without jumps and near each other at the start."""
    values = [np.array(table[name], float) for table in models(proof, repaired)]
    if name != "psi":
        return values
    values = [continuous(angle) for angle in values]
    together = np.flatnonzero(np.isfinite(values).all(axis=0))
    if not len(together):
        return values
    first = together[0]
    return [angle - 360.0 * np.round((angle[first] - values[0][first]) / 360.0) for angle in values]


def _error_panel(time: Samples, errors: Sequence[Samples], sigma: float, unit: str) -> ChartPanel:
    """Errors on the scale of the repaired model's; where calm water's leave it, the largest of them is written."""
    sigma = sigma if np.isfinite(sigma) else 0.0
    # Noise on a dashed line is a row of dots: here calm water is drawn through, and paler.
    looks = ({**CALM, "linestyle": "-", "alpha": 0.75}, REPAIRED)
    curves = [Curve(time, e, {**look, "linewidth": 0.9}) for e, look in zip(errors, looks, strict=False)]
    peaks = [float(np.abs(e[np.isfinite(e)]).max(initial=0.0)) for e in errors]
    height = max(3 * sigma, 1.2 * peaks[-1])
    level = np.full(2, 2 * sigma)
    ends = time[[0, -1]]
    return ChartPanel(
        "time t [s]", f"error [{unit}]", curves,
        bands=[Band(ends, -level, level, {**BAND, "color": TRUTH["color"]}, "± 2 measurement noise")],
        limits=(*ends.tolist(), -height, height) if height > 0 else None,
        title=f"{BEFORE}: up to {text(peaks[0], 2)} {unit}" if peaks[0] > height else "",
    )  # fmt: skip


def residual_chart(residual: Residual, repaired: bool) -> Chart:
    """X, Y and N that calm water lacks in one run, what the repair leaves of it, and when something is missing."""
    time, panels = residual.time, []
    for k, words in enumerate(FORCES):
        force, spread, left = residual.force[:, k], 2 * residual.error[:, k], residual.left[:, k]
        curves = [Curve(time, force, MISSING, "missing from the calm-water model")]
        if repaired:
            curves.append(Curve(time, left, REPAIRED, "missing from the repaired model"))
        about = {**BAND, "color": MISSING["color"]}
        panels.append(ChartPanel(
            "time t [s]", f"{words}\n[{residual.units[k]}]", curves,
            bands=[Band(time, force - spread, force + spread, about, "± 2 standard deviations")],
            spans=_windows(time, residual.windows), limits=_limits(time, [one.y for one in curves], spread), level=0.0,
        ))  # fmt: skip
    return Chart(panels, one_time=True)


def _windows(time: Samples, windows: Sequence[Interval]) -> list[Span]:
    """The windows as far as the run goes."""
    begin, stop = float(time[0]), float(time[-1])
    inside = [(max(start, begin), min(end, stop)) for start, end in windows if start <= stop and end >= begin]
    return [Span(start, end, WINDOW, "located") for start, end in inside]


def _limits(time: Samples, curves: Sequence[Samples], spread: Samples) -> tuple[float, float, float, float] | None:
    """Room for the curves and for the usual band; a band that opens wide at an end of the run is cut."""
    values = np.concatenate([*curves, np.zeros(1)])
    values = values[np.isfinite(values)]
    usual = spread[np.isfinite(spread)]
    room = float(np.median(usual)) if len(usual) else 0.0
    low, high = float(values.min()) - room, float(values.max()) + room
    edge = 0.05 * (high - low)
    return (float(time[0]), float(time[-1]), low - edge, high + edge) if high > low else None


def forecast_tracks(forecasts: Sequence[Proof]) -> Chart:
    """Planned runs from above, north up: by calm water and by the model, with the band at some places.

    Args:
        forecasts: The runs.

    Returns:
        A map a run, two side by side.
    """
    return Chart([_planned_map(planned) for planned in forecasts], columns=min(len(forecasts), 2))


def _planned_map(planned: Proof) -> ChartPanel:
    """One run, and the half width of its band at the end in numbers."""
    before, after = (table[["y", "x"]].to_numpy(float) for table in (planned.before, planned.after))
    low, high = (planned.after[[f"y_{side}", f"x_{side}"]].to_numpy(float) for side in ("low", "high"))
    origin, boxes = after[0], [np.empty((0, 2))]
    for k in np.linspace(0, len(after) - 1, OUTLINES).astype(int):
        (west, south), (east, north) = low[k] - origin, high[k] - origin
        boxes.append(np.array([[west, south], [east, south], [east, north], [west, north], [np.nan, np.nan]]))
    east, north = (high[-1] - low[-1]) / 2
    wide = f"band at the end ± {text(north, 2)} m north, ± {text(east, 2)} m east"
    curves = [
        along(np.concatenate(boxes), WITHIN, WITHIN_LABEL, filled=True),
        along(before - origin, CALM, BEFORE),
        along(after - origin, REPAIRED, AFTER),
    ]
    return track_panel(curves, f"{run_title(planned, TITLE_LETTERS)}\n{wide}")


def forecast_chart(planned: Proof) -> Chart:
    """Heading, yaw rate, surge, sway and log of a planned run over time, and beside each the band about the model.

    Args:
        planned: The run.

    Returns:
        Two columns over one time.
    """
    before, after, panels = planned.before, planned.after, []
    time = after["t"].to_numpy(float)
    for name in [channel for channel in CHANNELS if channel != "pos"]:
        words, _, unit = CHANNELS[name]
        model, low, high = (after[column].to_numpy(float) for column in (name, f"{name}_low", f"{name}_high"))
        curves = [
            Curve(before["t"].to_numpy(float), before[name].to_numpy(float), CALM, BEFORE),
            Curve(time, model, REPAIRED, AFTER),
        ]
        about = [Band(time, low - shift, high - shift, WITHIN, WITHIN_LABEL) for shift in (0.0, model)]
        panels.append(ChartPanel("time t [s]", f"{words}\n[{unit}]", curves, about[:1]))
        panels.append(ChartPanel("time t [s]", f"band [{unit}]", bands=about[1:], level=0.0))
    return Chart(panels, columns=2, one_time=True)
