"""The repaired model: calm water and what was found, free to run with a recorded rudder."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.recorded_inputs import held_columns
from manoeuvre_nn.dynamics.replay import integrate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.estimation.corrections import Calibrated
from manoeuvre_nn.estimation.effect_columns import (
    beside_it,
    contribution,
    latency_column,
    own_states,
    perfect,
)
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, heel_of, integrated, linearise, sides_of
from manoeuvre_nn.estimation.prepared_run import process_time, start_spread, typical_rates
from manoeuvre_nn.estimation.rudder_blades import behind_record, blade_along, indicated
from manoeuvre_nn.estimation.smoothed_run import first_guess
from manoeuvre_nn.recording.holes import rudder_known_until
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.preparation import measured, without_samples

STEPS_PER_LENGTH = 10
"""Runge-Kutta steps of a free run in the time L/U0: the test of :func:`.integrate` says how good its track is."""


def predict(
    dynamics: Model, hypothesis: Hypothesis, runs: Sequence[Recording], warmup: float, latency: float = 0.0
) -> list[pd.DataFrame]:
    """Free runs from the end of each run's warm-up with its recorded rudder, as its recorder would show them.

    Args:
        dynamics: Calm-water model.
        hypothesis: What acts on it, values of each run.
        runs: The recordings of a case, with one step; nothing but the rudder is taken from them after the warm-up.
        warmup: End of the warm-up [s].
        latency: Delay of the satellite receiver [s].

    Returns:
        Per run: t, x, y [m], psi [deg, continuous], u, v [m/s] along and across the recorded heading, r [deg/s], u_log.
    """
    hypothesis = steady(hypothesis)
    starts = np.stack(_starts(dynamics, hypothesis, runs, warmup, latency))
    return free_runs(dynamics, hypothesis, runs, starts, warmup, latency)


def predict_corrected(
    dynamics: Model,
    shares: Float[torch.Tensor, " k"],
    hypothesis: Hypothesis,
    runs: Sequence[Recording],
    warmup: float,
    latency: float,
) -> tuple[list[pd.DataFrame], list[pd.DataFrame]]:
    """The same without and with corrections of coefficients, side by side: steps of few rows cost as much as of many.

    Args:
        dynamics: Calm-water model.
        shares: Size of every correction.
        hypothesis: What acts on it, values of each run.
        runs: The recordings of a case.
        warmup: End of the warm-up [s].
        latency: Delay of the satellite receiver [s].

    Returns:
        What :func:`predict` gives for the model, and for the model with its corrections.
    """
    hypothesis, rows = steady(hypothesis), [row for row in range(len(runs)) for _ in range(2)]
    alone, corrected = (_starts(d, hypothesis, runs, warmup, latency) for d in (dynamics, Calibrated(dynamics, shares)))
    starts = np.stack([start for both in zip(alone, corrected, strict=True) for start in both])
    both = torch.stack([torch.zeros_like(shares), shares]).repeat(len(runs), 1)
    doubled = [runs[row] for row in rows]
    made = free_runs(dynamics, hypothesis.of_runs(rows), doubled, starts, warmup, latency, Calibrated(dynamics, both))
    return made[::2], made[1::2]


def steady(hypothesis: Hypothesis) -> Hypothesis:
    """Of gusts only the size is known: a prediction is the mean over their courses, which is the steady wind."""
    steady = tuple(e.steady(v) for e, v in zip(hypothesis.effects, hypothesis.values, strict=True))
    return replace(hypothesis, values=steady)


def _starts(
    dynamics: Model, hypothesis: Hypothesis, runs: Sequence[Recording], warmup: float, latency: float
) -> list[Float[np.ndarray, " k"]]:
    """State of every run at the end of its warm-up."""
    warm = [run.between(0.0, warm_up_end(run, warmup)) for run in runs]
    return [start_state(dynamics, hypothesis.of_runs([row]), run, latency) for row, run in enumerate(warm)]


def warm_up_end(run: Recording, warmup: float) -> float:
    """Time of the first sample after a warm-up [s]."""
    return float(run.time[np.searchsorted(run.time, warmup - 1e-9)])


def free_runs(
    dynamics: Model,
    hypothesis: Hypothesis,
    runs: Sequence[Recording],
    starts: Float[np.ndarray, "rows k"],
    warmup: float,
    latency: float = 0.0,
    model: Model | None = None,
) -> list[pd.DataFrame]:
    """The same from states that are known.

    Args:
        dynamics: Calm-water model.
        hypothesis: What acts on it, values of each row.
        runs: The recording of each row.
        starts: States at the end of the warm-up, of :func:`start_state`.
        warmup: End of the warm-up [s].
        latency: Delay of the satellite receiver [s].
        model: What moves the ship, if that is not the calm-water model itself; it may have coefficients for each row.

    Returns:
        As :func:`predict`.
    """
    each = [hypothesis.of_runs([row]) for row in range(len(runs))]
    begin, step = warm_up_end(runs[0], warmup), runs[0].step
    k = int(np.searchsorted(runs[0].time, begin - 1e-9))
    columns = controls(dynamics, runs, k) | held_columns({"delta": [d[k:] for d in _wheels(hypothesis, runs)]})
    moving = Vessel(model or dynamics, _acting(hypothesis)).model
    largest = dynamics.particulars.time_unit / STEPS_PER_LENGTH
    with torch.inference_mode():
        states = integrate(moving, torch.tensor(starts), columns, interval=step, start=begin, largest_step=largest)
    shown = []
    for row, (h, run) in enumerate(zip(each, runs, strict=True)):
        seen, n = run.between(begin, run.time[-1]), len(run) - k
        shown.append(_written(dynamics, h, seen, states[:n, row], columns["delta"][row, :n], latency))
    return shown


def controls(dynamics: Model, runs: Sequence[Recording], k: int) -> dict[str, Float[torch.Tensor, "rows n"]]:
    """Inputs of free runs as they were recorded: rudder, shaft where it was not nominal, sides, heel.

    Args:
        dynamics: Calm-water model.
        runs: The recording of each row.
        k: Number of the sample at which they begin.

    Returns:
        Name of an input -> its samples, a row each; short rows hold their last value.
    """
    rows = {"delta": [run["delta"][k:] for run in runs]}
    if any((run["shaft"] != 1).any() for run in runs):
        rows["shaft"] = [run["shaft"][k:] for run in runs]
    sides = [sides_of(run, dynamics) for run in runs]
    for name in sorted({name for of_run in sides for name in of_run}):
        rows[name] = [
            of_run.get(name, torch.zeros(len(run))).numpy()[k:] for of_run, run in zip(sides, runs, strict=True)
        ]
    heels = [heel_of(run, dynamics) for run in runs]
    for name in heels[0] if all(heels) else ():
        rows[name] = [of_run[name].numpy()[k:] for of_run in heels]
    return held_columns(rows)


def _acting(hypothesis: Hypothesis) -> list[Effect]:
    """The effects at their values."""
    return [e.at(torch.tensor(v)) for e, v in zip(hypothesis.effects, hypothesis.values, strict=True)]


def _wheels(hypothesis: Hypothesis, runs: Sequence[Recording]) -> list[Float[np.ndarray, " n"]]:
    """Angle of the blade over each whole run, so that its memory is right when the prediction begins."""
    made: list[np.ndarray] = []
    for _, same in groupby(range(len(runs)), key=lambda row: id(runs[row])):
        rows = list(same)
        run, mine = runs[rows[0]], hypothesis.of_runs(rows)
        blade = torch.tensor(run["delta"]).expand(len(rows), -1)
        with torch.no_grad():
            for effect, value in zip(mine.effects, mine.values, strict=True):
                acting = effect.at(torch.tensor(value)[:, None, :])
                blade = indicated(acting, run, blade)
                if effect.overrides("blade"):
                    blade = blade_along(acting, run, blade)
        made += list(blade.expand(len(rows), -1).numpy())
    return made


def start_state(
    dynamics: Model, hypothesis: Hypothesis, run: Recording, latency: float = 0.0
) -> Float[np.ndarray, " k"]:
    """State at the end of the warm-up: the smoother's, with the model and its effects.

    Args:
        dynamics: Calm-water model.
        hypothesis: What acts on it, values of this run.
        run: The run up to there.
        latency: Delay of the satellite receiver [s].

    Returns:
        u, v, r, x, y, psi, own states, then those of the effects; u and v through the water.
    """
    return start_state_and_covariance(dynamics, hypothesis, run, latency)[0]


def start_state_and_covariance(
    dynamics: Model,
    hypothesis: Hypothesis,
    run: Recording,
    latency: float = 0.0,
    process_sd: Float[np.ndarray, " p"] | None = None,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "m m"]]:
    """The same, and how well the samples of the warm-up tell all of it but the states of the effects.

    Args:
        dynamics: Calm-water model.
        hypothesis: What acts on it, values of this run.
        run: The run up to there.
        latency: Delay of the satellite receiver [s].
        process_sd: S.d. of the process noise [m/s^2, m/s^2, rad/s^2, rad/s^2]; None takes next to none.

    Returns:
        State and covariance.
    """
    rate, p = Rate(dynamics), dynamics.particulars
    unit = p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
    noise = 1e-3 * np.append(unit, typical_rates(dynamics)[3:]) if process_sd is None else process_sd
    time, spread, channels = process_time(dynamics), start_spread(dynamics), rate.states.channels
    # Few samples tell the state: a wild one would move it by itself.
    run = without_samples(run, np.apply_along_axis(spikes, 0, measured(run, channels), min_spread_share=0.0), channels)
    track = first_guess(run, rate.states.own)
    for _ in range(3):
        linearised = linearise(run, rate, track)
        effects, here = hypothesis.effects, [v[0] for v in hypothesis.values]
        line = behind_record(linearised, effects, here)
        beside = [beside_it(effects, here, k, line) for k in range(len(effects))]
        each = zip(effects, hypothesis.values, beside, strict=True)
        added = [contribution(e, v, line, beside=others) for e, v, others in each]
        linearised = replace(linearised, receiver=sum((c.measured[:, :4, 0] for c in added), np.zeros((1, 4))))
        # Data less latency and effects at their values.
        all_of_them = joined([linearised.data, latency_column(linearised), *added])
        left = all_of_them.combined(np.array([1.0, -latency, *[-1.0] * len(added)]))
        solved = integrated(linearised, rate.states.first_noise, noise, time, spread)
        track = track + solved.states(solved.embed(left))[:, : rate.states.count, 0]
    linearised = behind_record(linearise(run, rate, track), effects, here)
    covariance = solved.covariances[0][-1][: rate.states.count, : rate.states.count]
    return np.concatenate([track[-1], *(_memory_at_end(hypothesis, linearised))]), covariance


def _memory_at_end(hypothesis: Hypothesis, linearised: LinearisedRun) -> list[Float[np.ndarray, " m"]]:
    """Own states of the effects at the end of the warm-up: a ship that is in a turn by then heels already."""
    effects, here, made = hypothesis.effects, [v[0] for v in hypothesis.values], []
    for k, (effect, value) in enumerate(zip(effects, here, strict=True)):
        if effect.memory:
            s = beside_it(effects, here, k, linearised).drive(linearised.situation)
            with torch.no_grad():
                acting = effect.at(torch.tensor(value)[None, None, :])
                made.append(own_states(acting, s, 1, linearised.run.step)[0, -1].numpy())
    return made


def _written(
    dynamics: Model, hypothesis: Hypothesis, run: Recording, states: torch.Tensor, blade: torch.Tensor, latency: float
) -> pd.DataFrame:
    """What the recorder shows of predicted states."""
    time = torch.tensor(run.time)
    with torch.no_grad():
        effects = _acting(hypothesis)
        shaft = None if bool((run["shaft"] == 1).all()) else torch.tensor(run["shaft"])
        s = Vessel(dynamics, effects).situation(states, Inputs(blade, shaft, time=time))
        stream = sum((e.stream(s) for e in effects), torch.zeros_like(s.nu[..., :2]))
        channels = perfect(s)
        channels["vn"], channels["ve"] = channels["vn"] + stream[..., 0], channels["ve"] + stream[..., 1]
        for effect in effects:
            channels = effect.record(channels, s)
    c = {k: v.expand(len(time)).numpy() for k, v in channels.items()}
    for name in ("x", "y", "vn", "ve"):
        c[name] = c[name] - latency * np.gradient(c[name], run.step)
    return _table(run.time, c)


def recorded(run: Recording, warmup: float) -> pd.DataFrame:
    """A run's recording from the end of the warm-up [s] in the form of a prediction; NaN in gaps and at outliers."""
    m = measured(run)
    # No free run leads through a time in which nobody knows the rudder.
    m[run.time > rudder_known_until(run, warmup) + 1e-9] = np.nan
    m = np.where(np.apply_along_axis(spikes, 0, m, min_spread_share=0.0), np.nan, m)
    table = _table(run.time, dict(zip(MEASURED, m.T, strict=True)))
    return table[run.time >= warmup - 1e-9].reset_index(drop=True)


def _table(time: Float[np.ndarray, " n"], c: Mapping[str, Float[np.ndarray, " n"]]) -> pd.DataFrame:
    """Channels in degrees, velocities along and across the heading."""
    u, v = earth_to_body(c["vn"], c["ve"], c["psi"])
    table = {"t": time, "x": c["x"], "y": c["y"], "psi": c["psi"] / DEGREE, "u": u, "v": v, "r": c["r"] / DEGREE}
    return pd.DataFrame({**table, "u_log": c["u_log"]})
