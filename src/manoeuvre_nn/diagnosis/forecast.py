"""Planned runs: what the repaired model predicts of a rudder that nobody has sailed to its end, with bands.

A band holds what is not known: numbers and coefficients (drawn together from their posterior), the state at the end of
the warm-up, forces that no hypothesis explains (process noise of the size that the fitted runs need), the size and
phase of what is periodic with its own in each run, and the noise of the sensors. No event has a time in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from scipy.stats import norm
from torch import Tensor

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.repair import (
    free_runs,
    predict,
    recorded,
    start_state,
    start_state_and_covariance,
    steady,
    warm_up_end,
)
from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.dynamics.base import Model, ModelAround, is_fitted
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet, same_campaigns
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import LATENCY, process_time
from manoeuvre_nn.estimation.process_noise import drawn_process
from manoeuvre_nn.estimation.relinearise import refined
from manoeuvre_nn.scoring.free_runs import errors

DRAWS = 100
"""Free runs that a band is taken from: its edges are then good to a tenth of its width."""
BAND = (0.025, 0.975)
"""Quantiles between which a band lies."""
SEED = 18
"""Of the draws, so that an answer is the same twice."""
COLUMNS = ("x", "y", "psi", "u", "v", "r", "u_log")
NUDGE = 0.5
"""Step of the difference quotient of the start by the numbers, in standard errors."""


class _Pushed(ModelAround):
    """A model that is pushed by accelerations over time, one row of a batch each.

    Attributes:
        calm: The model.
    """

    def __init__(self, calm: Model, pushes: Float[Tensor, "times rows p"], start: float, interval: float) -> None:
        """Take the pushes [m/s^2, rad/s^2] at times [s] from a start."""
        super().__init__(calm)
        self._pushes, self._start, self._interval = pushes, start, interval

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state with the push of the sample before."""
        assert inputs.time is not None
        at = int((float(inputs.time.reshape(-1)[0]) - self._start) / self._interval + 1e-6)
        push = self._pushes[min(at, len(self._pushes) - 1)]
        rate = self.calm(state, inputs)
        added = torch.zeros_like(rate)
        added[..., :3] = push[..., :3]
        added[..., 6 + len(self.own_names) - (push.shape[-1] - 3) :] = push[..., 3:]
        return rate + added

    def on_approach(self, speed: float) -> Model:
        """The pushed ship at another approach speed [m/s]."""
        return _Pushed(self.calm.on_approach(speed), self._pushes, self._start, self._interval)


def forecasts(question: Question, data_set: WhitenedDataSet, chosen: FittedHypothesis) -> list[Proof]:
    """Planned runs by calm water and by the repaired model, this with bands.

    Args:
        question: What is asked.
        data_set: The fitted runs.
        chosen: What was found; calm water is predicted with its coefficients corrected, too.

    Returns:
        One a planned run; its errors are NaN.
    """
    dynamics, runs, warmup = question.dynamics, question.case.planned, question.case.warmup
    if not runs:
        return []
    known = known_of(data_set, chosen)
    there = chosen.hypothesis.in_other_runs(known.rows(runs))
    befores = predict(dynamics, Hypothesis((), ()), runs, warmup)
    noise, drawn = _noise(known), drawn_tables(known, there, runs, warmup)
    made = []
    for run, before, (after, *others) in zip(runs, befores, drawn, strict=True):
        record = recorded(run, warmup)
        record[record.columns[1:]] = np.nan
        none = errors(before, record)
        made.append(Proof(run.name, run.meta["kind"], record, before, after.join(_band(others, noise)), none, none))
    return made


def unplaced_events(question: Question, chosen: FittedHypothesis) -> list[str]:
    """A sentence on everything that planned runs are predicted without."""
    runs, effects = ", ".join(run.name for run in question.case.planned), chosen.hypothesis.effects
    events = [f"When {e.label} acts in {runs} is" for e in effects if e.timed]
    events += [f"Size and phase of {e.label} in {runs} are" for e in effects if _sized_by_run(e)]
    return [f"{what} not known beforehand: predicted without it." for what in events] if runs else []


@dataclass(frozen=True)
class _Known:
    """What the fitted runs say of coefficients and numbers.

    Attributes:
        data_set: The fitted runs about the states that the hypothesis implies.
        chosen: What was found.
        mean: Most likely combinations of coefficients, then latencies of the runs.
        latency: Usual delay of the satellite receiver [s].
        covariance: Of combinations, latencies and numbers.
    """

    data_set: WhitenedDataSet
    chosen: FittedHypothesis
    mean: Float[np.ndarray, " c"]
    latency: float
    covariance: Float[np.ndarray, "m m"]

    def corrected(
        self, combinations: Float[np.ndarray, "*rows c"], unseen: Float[np.ndarray, "*rows k"] | float = 0.0
    ) -> Calibrated:
        """The calm-water model with such coefficients; a fitted one is left as it is but for what is drawn."""
        dynamics = self.data_set.dynamics
        if is_fitted(dynamics):
            combinations = combinations - self.mean[: self.data_set.combinations]
        shares = combinations @ self.data_set.rotation.T + unseen
        return Calibrated(dynamics, dynamics.hull.inertia.new_tensor(shares))

    def rows(self, runs: Sequence[Recording]) -> list[int]:
        """For each of other runs a fitted one of the same campaign."""
        return same_campaigns([prepared.linearised.run for prepared in self.data_set.runs], runs)


def known_of(data_set: WhitenedDataSet, chosen: FittedHypothesis) -> _Known:
    """Posterior of everything at the noise that is most likely, about the states that the hypothesis implies."""
    data_set = refined(data_set, chosen) if chosen.names else data_set
    level, scatter = chosen.best
    lin = hypothesis_columns(data_set, chosen.hypothesis) if chosen.names else None
    found = MarginalLikelihood(data_set).posterior(lin, level)
    mean, kept = found.mean(scatter), data_set.combinations
    base = kept + len(data_set.runs)
    latency = LATENCY + float(np.mean(mean[kept:base]))
    return _Known(data_set, chosen, mean[:base], latency, found.covariance(scatter))


def unseen_scatter(
    data_set: WhitenedDataSet, scatter: int, draws: int, g: np.random.Generator
) -> Float[np.ndarray, "draws k"]:
    """Errors of coefficients, drawn, of which the fitted runs show nothing: other runs may.

    Args:
        data_set: The fitted runs.
        scatter: Level of the coefficients' standard deviation.
        draws: How many; the first has none.
        g: Source of chance.

    Returns:
        Sizes of the corrections.
    """
    root = data_set.coefficient_prior.root(Corrections(data_set.dynamics).names)
    chance, seen = g.standard_normal((draws, len(data_set.rotation))), np.linalg.solve(root, data_set.rotation)
    chance[0] = 0.0
    return COEFFICIENT_SD_LEVELS[scatter] * (chance - chance @ seen @ seen.T) @ root.T  # what is seen is orthonormal


def drawn_tables(
    known: _Known, there: Hypothesis, runs: Sequence[Recording], warmup: float, least_level: int = 0
) -> list[list[pd.DataFrame]]:
    """Free runs with everything that is not known drawn, sensors' noise excepted.

    Args:
        known: What the fitted runs say, see :func:`known_of`.
        there: What was found, in these runs; what each run has of its own is theirs.
        runs: The runs.
        warmup: End of the warm-up [s].
        least_level: Grid point whose process noise is allowed, whatever the fitted runs need.

    Returns:
        Per run tables as :func:`~manoeuvre_nn.diagnosis.repair.predict` gives: the most likely one, then
        :data:`DRAWS`.
    """
    g, data_set, chosen = np.random.default_rng(SEED), known.data_set, known.chosen
    off = g.multivariate_normal(np.zeros(len(known.covariance)), known.covariance, DRAWS, method="eigh")
    off, kept, rows = np.vstack([0 * off[:1], off]), data_set.combinations, known.rows(runs)
    numbers = off[:, kept + len(data_set.runs) :]
    scatter = (data_set, chosen.best[1], len(off), g)
    unseen = np.zeros((len(off), 1)) if is_fitted(data_set.dynamics) else unseen_scatter(*scatter)
    driving = known.corrected(*(np.tile(part, (len(runs), 1)) for part in (known.mean[:kept] + off[:, :kept], unseen)))
    draws = [chosen.hypothesis.within_bounds(chosen.hypothesis.vector() + change) for change in numbers]
    draws[0] = steady(chosen.hypothesis)
    drawn = _in_turn([_timed(d.in_other_runs([row]), there.of_runs([k])) for k, row in enumerate(rows) for d in draws])
    _draw_sizes(drawn, chosen.hypothesis, len(draws), g)
    starts = np.concatenate([_starts(g, known, run, warmup, numbers, there.of_runs([k])) for k, run in enumerate(runs)])
    size = np.maximum(*(data_set.levels.sd(point, data_set.unit) for point in (chosen.best[0], least_level)))
    copies, pushed = [run for run in runs for _ in draws], with_process_noise(driving, size, runs, warmup, g)
    tables = free_runs(data_set.dynamics, drawn, copies, starts, warmup, known.latency, pushed)
    return [tables[k * len(draws) : (k + 1) * len(draws)] for k in range(len(runs))]


def with_process_noise(
    model: Calibrated, sd: Float[np.ndarray, " p"], runs: Sequence[Recording], warmup: float, g: np.random.Generator
) -> Model:
    """A model that is pushed at random, in every row by itself.

    Args:
        model: The model, with coefficients for each of as many rows a run; the first one of each run has no noise.
        sd: S.d. of the process noise [m/s^2, m/s^2, rad/s^2, rad/s^2].
        runs: The runs that are drawn.
        warmup: End of the warm-up [s].
        g: Source of chance.

    Returns:
        The model.
    """
    begin, step, rows = warm_up_end(runs[0], warmup), runs[0].step, len(model.shares)
    instants = step * np.arange(max(len(run) for run in runs))
    pushes = sd * drawn_process(g, instants, process_time(model.calm), (rows, len(sd)))
    pushes[:, :: rows // len(runs)] = 0.0
    return _Pushed(model, torch.tensor(pushes), begin, step)


def _sized_by_run(effect: Effect) -> list[int]:
    """Columns of the sizes that each run has of its own."""
    return [column for column, p in enumerate(effect.declared) if p.per_run and not p.is_time]


def _draw_sizes(drawn: Hypothesis, fitted: Hypothesis, draws: int, g: np.random.Generator) -> None:
    """Draw sizes that are each run's own and not told there, as large as in the fitted runs; none in the first draw."""
    for effect, values, known in zip(drawn.effects, drawn.values, fitted.values, strict=True):
        for column in _sized_by_run(effect):
            untold = values[:, column] == effect.declared[column].null
            untold[::draws] = False
            values[untold, column] = g.normal(0.0, np.sqrt(np.mean(known[:, column] ** 2)), untold.sum())


def _timed(numbers: Hypothesis, there: Hypothesis) -> Hypothesis:
    """A hypothesis with what each run of another has of its own."""
    values = tuple(
        np.where([p.per_run for p in effect.declared], theirs, mine)
        for effect, mine, theirs in zip(numbers.effects, numbers.values, there.values, strict=True)
    )
    return replace(numbers, values=values)


def _in_turn(each: Sequence[Hypothesis]) -> Hypothesis:
    """One hypothesis of many rows, each with gusts of its own."""
    values = tuple(np.concatenate(of_effect) for of_effect in zip(*(h.values for h in each), strict=True))
    chance = torch.Generator().manual_seed(SEED)
    effects = tuple(effect.drawn(len(each), chance) for effect in each[0].effects)
    return Hypothesis(effects, values, each[0].fixed)


def _starts(
    g: np.random.Generator,
    known: _Known,
    run: Recording,
    warmup: float,
    numbers: Float[np.ndarray, "draws m"],
    there: Hypothesis,
) -> Float[np.ndarray, "draws k"]:
    """States at the end of a run's warm-up: they go with the numbers and scatter, but for the first."""
    chosen, latency, dynamics = known.chosen, known.latency, known.corrected(known.mean[: known.data_set.combinations])
    warm = run.between(0.0, warm_up_end(run, warmup))
    row = known.rows([run])
    mean, covariance = start_state_and_covariance(dynamics, there, warm, latency)
    spread = np.zeros((len(mean), len(mean)))
    spread[: len(covariance), : len(covariance)] = covariance
    slopes = np.zeros((numbers.shape[1], len(mean)))
    for k, error in enumerate(chosen.errors):
        step = NUDGE * error * np.eye(numbers.shape[1])[k]
        nudged = chosen.hypothesis.within_bounds(chosen.hypothesis.vector() + step)
        size = float((nudged.vector() - chosen.hypothesis.vector())[k])
        if abs(size) > 1e-9 * error:
            slopes[k] = (start_state(dynamics, _timed(nudged.in_other_runs(row), there), warm, latency) - mean) / size
    chance = g.multivariate_normal(np.zeros(len(mean)), spread, len(numbers), method="eigh")
    chance[0] = 0.0
    return mean + numbers @ slopes + chance


def _noise(known: _Known) -> dict[str, float]:
    """Standard deviation of a single sample about the repaired model's states, in the units of a prediction."""
    data_set, kept, squares = known.data_set, known.data_set.combinations, []
    lin = hypothesis_columns(data_set, known.chosen.hypothesis) if known.chosen.names else None
    for k, (run, white) in enumerate(zip(data_set.runs, data_set.at(known.chosen.best[0]).white, strict=True)):
        left, shares = [run.base], np.r_[1.0, -known.mean[:kept], -known.mean[kept + k]]
        if lin is not None:
            left, shares = [run.base, lin.columns[k][:1]], np.append(lin.of_base(k, shares), -1.0)
        data = joined(left).combined(shares)
        states = white.states(white.embed(data))[..., 0]
        rest = data.measured[..., 0] - np.einsum("kci,ki->kc", run.linearised.observed, states)
        there = run.linearised.present
        own = (rest**2 * there).sum(0) / np.maximum(there.sum(0), 1)
        # Of averages: single samples lie off these besides.
        beside = run.sample_noise**2 - run.noise**2 / run.inflation
        squares.append(np.where(there.any(0), own + beside, run.sample_noise**2))
    s = np.sqrt(np.mean(squares, axis=0))
    return dict(zip(COLUMNS, s[[0, 1, 4, 2, 3, 5, 6]] / (1, 1, DEGREE, 1, 1, DEGREE, 1), strict=True))


def _band(tables: Sequence[pd.DataFrame], noise: dict[str, float]) -> pd.DataFrame:
    """What most recordings of the same run lie between, column by column: quantiles of the draws, widened by noise."""
    found = {}
    for name in COLUMNS:
        drawn = np.stack([table[name] for table in tables])
        low, middle, high = np.quantile(drawn, (BAND[0], 0.5, BAND[1]), axis=0)
        room = norm.ppf(BAND[1]) * noise[name]
        found[f"{name}_low"] = middle - np.hypot(middle - low, room)
        found[f"{name}_high"] = middle + np.hypot(high - middle, room)
    return pd.DataFrame(found)
