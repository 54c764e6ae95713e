"""The repaired model: calm water and what was found, free to run with a recorded rudder."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.recorded_inputs import held_table
from manoeuvre_nn.dynamics.replay import integrate
from manoeuvre_nn.dynamics.vessel import Affected, Vessel
from manoeuvre_nn.estimation.data_set import FIRST_NOISE, process_time, start_spread
from manoeuvre_nn.estimation.effect_columns import blade_along, contribution, latency_column, perfect
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.linearised_run import NoiseLevels, calm_rate, integrated, linearise
from manoeuvre_nn.estimation.smoothed_run import first_guess
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.preparation import measured


@dataclass(frozen=True)
class Repaired:
    """A model that can be run.

    Attributes:
        calm: Calm-water model.
        hypothesis: What acts on it; values of row 0 are those of any run, but for times of its own.
        latency: Delay of the satellite receiver [s].
    """

    calm: Model
    hypothesis: Hypothesis
    latency: float = 0.0

    def acting(self, values: Sequence[Float[np.ndarray, "rows p"]]) -> list[Effect]:
        """The effects at values of several rows.

        Args:
            values: One table an effect.

        Returns:
            Effects.
        """
        return [e.at(torch.tensor(v)) for e, v in zip(self.hypothesis.effects, values, strict=True)]


def predict(
    model: Repaired,
    runs: Sequence[Recording],
    warmup: float,
    values: Sequence[Float[np.ndarray, "rows p"]] | None = None,
) -> list[pd.DataFrame]:
    """Free runs from the end of each run's warm-up with its recorded rudder, as its recorder would show them.

    Args:
        model: The model.
        runs: The recordings of a case, with one step; nothing but the rudder is taken from them after the warm-up.
        warmup: End of the warm-up [s].
        values: Parameters of each run; None takes those of the model.

    Returns:
        Per run: t, x, y [m], psi [deg, continuous], u, v [m/s] along and across the recorded heading, r [deg/s], u_log.
    """
    if values is None:
        values = [np.repeat(v[:1], len(runs), axis=0) for v in model.hypothesis.values]
    # Of gusts only the size is known: the prediction is the mean over their courses, which is the steady wind.
    values = [e.steady(v) for e, v in zip(model.hypothesis.effects, values, strict=True)]
    k = int(np.searchsorted(runs[0].time, warmup - 1e-9))
    begin, step = float(runs[0].time[k]), runs[0].step
    starts = [start_state(model, run.between(0.0, begin), [v[row] for v in values]) for row, run in enumerate(runs)]
    wheels = [_wheel(model, run, [v[[row]] for v in values]) for row, run in enumerate(runs)]
    columns = {"delta": [wheel[k:] for wheel in wheels]}
    if any((run["shaft"] != 1).any() for run in runs):
        columns["shaft"] = [run["shaft"][k:] for run in runs]
    table = held_table(columns, step, begin)
    blade = table.columns["delta"]
    dynamics = Vessel(model.calm, model.acting(values)).model
    first = torch.tensor(np.stack(starts))
    with torch.no_grad():
        states = integrate(dynamics, dynamics.start(first, table.at(begin)), table)
    return [
        _written(model, run, k, states[: len(run) - k, row], blade[row, : len(run) - k], [v[[row]] for v in values])
        for row, run in enumerate(runs)
    ]


def _wheel(model: Repaired, run: Recording, values: Sequence[Float[np.ndarray, "1 p"]]) -> Float[np.ndarray, " n"]:
    """Angle of the blade over the whole run, so that its memory is right when the prediction begins."""
    blade = torch.tensor(run["delta"])[None]
    with torch.no_grad():
        for effect, value in zip(model.hypothesis.effects, values, strict=True):
            acting = effect.at(torch.tensor(value)[:, None, :])
            blade = acting.indicated(blade, torch.tensor(run.time))
            if type(effect).blade is not Effect.blade:
                blade = blade_along(acting, run, blade)
    return blade[0].numpy()


def start_state(model: Repaired, run: Recording, values: Sequence[Float[np.ndarray, " p"]]) -> Float[np.ndarray, " 6"]:
    """State at the end of the warm-up: the smoother's, with the model and its effects.

    Args:
        model: The model.
        run: The run up to there.
        values: Parameters of this run.

    Returns:
        u, v, r, x, y, psi; u and v through the water.
    """
    rate, p = calm_rate(model.calm), model.calm.particulars
    unit = p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
    noise, spread = NoiseLevels(FIRST_NOISE, 1e-3 * unit, process_time(model.calm)), start_spread(p)
    track = first_guess(run)
    for _ in range(3):
        linearised = linearise(run, rate, track, noise.process_time)
        added = [contribution(e, v[None], linearised) for e, v in zip(model.hypothesis.effects, values, strict=True)]
        # Data less latency and effects at their values.
        all_of_them = joined([linearised.data, latency_column(linearised), *added])
        left = all_of_them.combined(np.array([1.0, -model.latency, *[-1.0] * len(added)]))
        solved = integrated(linearised, noise, spread)
        track = track + solved.states(solved.embed(left))[:, :6, 0]
    return track[-1]


def _written(
    model: Repaired, run: Recording, first: int, states: torch.Tensor, blade: torch.Tensor, values: Sequence[np.ndarray]
) -> pd.DataFrame:
    """What the recorder shows of predicted states."""
    time = torch.tensor(run.time[first:])
    with torch.no_grad():
        effects = model.acting(values)
        shaft = None if bool((run["shaft"] == 1).all()) else torch.tensor(run["shaft"][first:])
        s = Affected(model.calm, effects).situation(states, Inputs(blade, shaft, time=time))
        stream = sum((e.stream(s) for e in effects), torch.zeros_like(s.nu[..., :2]))
        channels = perfect(s)
        channels["vn"], channels["ve"] = channels["vn"] + stream[..., 0], channels["ve"] + stream[..., 1]
        for effect in effects:
            channels = effect.record(channels, s)
    c = {k: v.expand(len(time)).numpy() for k, v in channels.items()}
    for name in ("x", "y", "vn", "ve"):
        c[name] = c[name] - model.latency * np.gradient(c[name], run.step)
    cos, sin = np.cos(c["psi"]), np.sin(c["psi"])
    return pd.DataFrame(
        {
            "t": run.time[first:], "x": c["x"], "y": c["y"], "psi": c["psi"] / DEGREE,
            "u": c["vn"] * cos + c["ve"] * sin, "v": -c["vn"] * sin + c["ve"] * cos,
            "r": c["r"] / DEGREE, "u_log": c["u_log"],
        }
    )  # fmt: skip


def recorded(run: Recording, warmup: float) -> pd.DataFrame:
    """A run's recording in the form of a prediction; NaN in gaps and at single-sample outliers.

    Args:
        run: The run.
        warmup: End of the warm-up [s].

    Returns:
        The same columns from the end of the warm-up.
    """
    m = measured(run)
    m = np.where(np.apply_along_axis(spikes, 0, m, min_spread_share=0.0), np.nan, m)
    x, y, vn, ve, psi, r, log = m[:, :7].T
    cos, sin = np.cos(psi), np.sin(psi)
    table = pd.DataFrame(
        {"t": run.time, "x": x, "y": y, "psi": psi / DEGREE, "u": vn * cos + ve * sin, "v": -vn * sin + ve * cos,
         "r": r / DEGREE, "u_log": log}
    )  # fmt: skip
    return table[run.time >= warmup - 1e-9].reset_index(drop=True)


def errors(prediction: pd.DataFrame, record: pd.DataFrame) -> dict[str, float]:
    """RMS errors of a prediction per channel; pos is the distance.

    Args:
        prediction: From :func:`predict`.
        record: From :func:`recorded`.

    Returns:
        pos [m], psi [deg], u, v [m/s], r [deg/s], u_log [m/s]; NaN for a channel that was not recorded.
    """
    off = prediction[["x", "y", "psi", "u", "v", "r", "u_log"]] - record[["x", "y", "psi", "u", "v", "r", "u_log"]]
    off["psi"] = (off["psi"] + 180) % 360 - 180
    off["pos"] = np.hypot(off["x"], off["y"])
    return {c: float(np.sqrt((off[c] ** 2).mean())) for c in ("pos", "psi", "u", "v", "r", "u_log")}
