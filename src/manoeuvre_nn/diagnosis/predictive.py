"""Whether calm water could have sailed the recorded runs: a posterior predictive test by free runs.

Free runs are drawn of all runs, fitted and held out, from their warm-up on: with coefficients as the fit corrected them
(the posterior of the empty hypothesis), and beside it as published, with their usual scatter; each with the process
noise that calm water is allowed, an uncertain start and the channels' noise. Recorded runs must not lie further from
the middle of the draws than the draws themselves do.

Source:
    Gelman, Meng & Stern 1996 (Statistica Sinica 6:733) for the test; Hill 1975 (Annals of Statistics 3:1163) for the
    tail beyond the largest draws; Westfall & Young 1993, Resampling-Based Multiple Testing, for many looks at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float

from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.forecast import COLUMNS, drawn_tables, known_of, unseen_scatter, with_process_noise
from manoeuvre_nn.diagnosis.repair import free_runs, recorded, start_state_and_covariance, warm_up_end
from manoeuvre_nn.diagnosis.result import Check
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.diagnosis.unknown import ReceiverWander, receiver_wander
from manoeuvre_nn.dynamics.base import Model, is_fitted
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR
from manoeuvre_nn.estimation.model_corrections import USUAL_SCATTER
from manoeuvre_nn.estimation.prepared_run import LATENCY, PreparedRun
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS, drawn_process
from manoeuvre_nn.estimation.relinearise import beside

DRAWS = 96
"""Free runs of every run, with coefficients as corrected and as published each."""
FALSE_ALARMS = 0.005
"""Probability, over all channels and parts of the runs, below which calm water did not sail these runs."""
TAIL = 0.2
"""Share of the draws that the tail is taken from."""
PRIOR_SDS = 2.0
"""Process noise and scatter that calm water is allowed, over the scale of their priors."""
BLOCK, WINDOW = 0.5, 3.0
"""Length of the means that are compared, and of the parts in which runs are looked at, over L/U0."""
REPAIRED_SAILS = "the repaired model sails the held-out runs"
"""Name of the test of the repaired model."""
NOISE_ERROR = 0.1
"""Relative standard error of the channels' noise."""


@dataclass(frozen=True)
class _Allowed:
    """What calm water may be: coefficients, process noise, in draws; the middle first.

    Attributes:
        shares: Corrections of each draw.
        latency: Delay of the receiver [s].
        process_sd: S.d. of the process noise [m/s^2, m/s^2, rad/s^2, rad/s^2].
    """

    shares: Float[np.ndarray, "draws k"]
    latency: float
    process_sd: Float[np.ndarray, " p"]


def calm_check(question: Question, tried: SearchResult) -> Check:
    """Test whether free runs of calm water miss the recorded ones by more than is unknown about it.

    Args:
        question: What is asked.
        tried: The search, for calm water's posterior.

    Returns:
        The test; the text says where the runs miss most.
    """
    prepared = [*tried.likelihood.data_set.runs]
    if question.case.held_out:
        prepared += question.held_out.data_set.runs
    runs = [p.linearised.run for p in prepared]
    rng = np.random.default_rng(0)
    kinds = {"as corrected": corrected(tried, rng), "as published": published(tried, rng)}
    warmup = question.case.warmup
    drawn = {how: drawn_runs(question.dynamics, runs, warmup, allowed, rng) for how, allowed in kinds.items()}

    def most_surprising(wander: ReceiverWander | None) -> tuple[float, str, str, float]:
        found = [(how, *surprise(question, runs, prepared, free, wander)) for how, free in drawn.items()]
        how, p, channel, ratio = min(found, key=lambda of: of[1])
        return min(1.0, len(found) * p), how, channel, ratio

    p, how, channel, ratio = most_surprising(None)
    if p <= FALSE_ALARMS and (wander := _slow_error(tried, tried.none)):
        p, how, channel, ratio = most_surprising(wander)
    text = (
        f"free runs of calm water with its coefficients {how} miss the recorded {channel} by {ratio:.1f} times what is "
        f"unknown about it: p = {p:.2g}"
    )
    return Check("calm water sails these runs", p > FALSE_ALARMS, text)


def repaired_check(question: Question, tried: SearchResult, chosen: FittedHypothesis, there: Hypothesis) -> Check:
    """Test whether free runs of the repaired model miss the held-out runs by more than is unknown about it.

    Drawn are its numbers and coefficients from their posterior, gusts, an uncertain start and the channels' noise, see
    :func:`~manoeuvre_nn.diagnosis.forecast.drawn_tables`, and the process noise that calm water is allowed.

    Args:
        question: What is asked, with held-out runs.
        tried: The search, for the fitted runs.
        chosen: What was found.
        there: It, in the held-out runs.

    Returns:
        The test; the text says where the runs miss most.
    """
    prepared, warmup = question.held_out.data_set.runs, question.case.warmup
    runs = [p.linearised.run for p in prepared]
    allowed = 0 if is_fitted(question.dynamics) else PROCESS_LEVELS.point(_most_allowed(), _most_allowed())
    drawn = drawn_tables(known_of(tried.likelihood.data_set, chosen), there, runs, warmup, allowed)
    shown_by = [_as_shown(tables) for tables in drawn]
    p, channel, ratio = surprise(question, runs, prepared, shown_by)
    if p <= FALSE_ALARMS and (wander := _slow_error(tried, chosen)):
        p, channel, ratio = surprise(question, runs, prepared, shown_by, wander)
    text = f"free runs of the repaired model miss the recorded {channel} by {ratio:.1f} times what is unknown about it"
    return Check(REPAIRED_SAILS, p > FALSE_ALARMS, f"{text}: p = {p:.2g}")


def _slow_error(tried: SearchResult, fitted: FittedHypothesis) -> ReceiverWander | None:
    """The slow error of a usual receiver, if the fitted runs are likelier with it."""
    wander = receiver_wander(beside(tried.likelihood, fitted.hypothesis), fitted)
    return wander if wander.evidence > fitted.evidence else None


def still_missing(checks: Sequence[Check]) -> str:
    """A clause on what the repaired model misses in held-out runs; empty where it passed or was not tested."""
    return next((c.text.partition(": p")[0] for c in checks if c.name == REPAIRED_SAILS and not c.passed), "")


def _as_shown(tables: Sequence[pd.DataFrame]) -> Float[np.ndarray, "rows n 7"]:
    """Predictions as x, y, speed north and east, heading, yaw rate and log of perfect sensors."""
    x, y, psi, u, v, r, log = np.stack([table[[*COLUMNS]] for table in tables]).transpose(2, 0, 1)
    return np.stack([x, y, *body_to_earth(u, v, psi * DEGREE), psi * DEGREE, r * DEGREE, log], axis=-1)


def corrected(tried: SearchResult, rng: np.random.Generator) -> _Allowed:
    """Calm water as the fit left it; what the fitted runs do not show of the coefficients keeps its scatter."""
    data_set, most = tried.likelihood.data_set, _most_allowed()
    level = data_set.levels.point(*(min(k, most) for k in data_set.levels.at(tried.none.best[0])))
    scatter = min(tried.none.best[1], int(np.searchsorted(COEFFICIENT_SD_LEVELS, PRIOR_SDS * USUAL_SCATTER)) - 1)
    found, k = tried.likelihood.posterior(None, level), data_set.combinations
    mean, root = found.mean(scatter), np.linalg.cholesky(found.covariance(scatter)[:k, :k] + 1e-18 * np.eye(k))
    shares = (mean[:k] + np.vstack([np.zeros(k), rng.standard_normal((DRAWS, k)) @ root.T])) @ data_set.rotation.T
    shares += unseen_scatter(data_set, scatter, len(shares), rng)
    # That quiet runs were fitted is no reason to forbid what calm water is allowed before.
    process = np.maximum(_process(tried, level), _process(tried, data_set.levels.point(most, most)))
    return _Allowed(shares, LATENCY + float(np.mean(mean[k:])), process)


def _most_allowed() -> int:
    """Largest level of process noise that calm water is allowed in surge, and beside it."""
    return PROCESS_LEVELS.largest(PRIOR_SDS * PROCESS_PRIOR)


def published(tried: SearchResult, rng: np.random.Generator) -> _Allowed:
    """Calm water before any recording was seen."""
    count, most = len(tried.likelihood.data_set.rotation), _most_allowed()
    shares = np.vstack([np.zeros(count), USUAL_SCATTER * rng.standard_normal((DRAWS, count)) @ _root(tried).T])
    return _Allowed(shares, LATENCY, _process(tried, PROCESS_LEVELS.point(most, most)))


def _root(tried: SearchResult) -> Float[np.ndarray, "k k"]:
    """Root of the prior covariance of the coefficients' errors."""
    data_set = tried.likelihood.data_set
    return data_set.coefficient_prior.root(Corrections(data_set.dynamics).names)


def _process(tried: SearchResult, level: int) -> Float[np.ndarray, " p"]:
    data_set = tried.likelihood.data_set
    return data_set.levels.sd(level, data_set.unit)


def drawn_runs(
    dynamics: Model, runs: Sequence[Recording], warmup: float, allowed: _Allowed, rng: np.random.Generator
) -> list[Float[np.ndarray, "draws n c"]]:
    """Free runs of every run, the middle one first.

    Args:
        dynamics: Calm-water model.
        runs: The recordings, with one step.
        warmup: End of the warm-up [s].
        allowed: What calm water may be.
        rng: Source of chance.

    Returns:
        What perfect sensors show at the times of each run's samples from there on.
    """
    rows, begin = len(allowed.shares), warm_up_end(runs[0], warmup)
    starts = np.concatenate([_starts(dynamics, run.between(0.0, begin), allowed, rng) for run in runs])
    calm = Calibrated(dynamics, torch.tensor(np.tile(allowed.shares, (len(runs), 1))))
    pushed = with_process_noise(calm, allowed.process_sd, runs, warmup, rng)
    copies = [run for run in runs for _ in range(rows)]
    tables = free_runs(dynamics, Hypothesis((), ()), copies, starts, warmup, allowed.latency, pushed)
    return [_as_shown(tables[k * rows : (k + 1) * rows]) for k in range(len(runs))]


def _starts(
    dynamics: Model, warm: Recording, allowed: _Allowed, rng: np.random.Generator
) -> Float[np.ndarray, "draws k"]:
    """States at the end of a warm-up: the smoother's, and about it as its covariance says."""
    mean, covariance = start_state_and_covariance(
        dynamics, Hypothesis((), ()), warm, allowed.latency, allowed.process_sd
    )
    root = np.linalg.cholesky(covariance + 1e-18 * np.eye(len(mean)))
    chance = rng.standard_normal((len(allowed.shares), len(mean)))
    chance[0] = 0.0
    return mean + chance @ root.T


def surprise(
    question: Question,
    runs: Sequence[Recording],
    prepared: Sequence[PreparedRun],
    drawn: Sequence[Float[np.ndarray, "draws n c"]],
    wander: ReceiverWander | None = None,
) -> tuple[float, str, float]:
    """How improbable the recorded runs are among the draws.

    Every channel is looked at over all fitted and all held-out runs, and by its largest part of a few ship lengths.

    Args:
        question: What is asked.
        runs: The recordings.
        prepared: The same with their noise.
        drawn: Free runs of each.
        wander: Slow error of the satellite receiver; None has none.

    Returns:
        Probability, corrected for the number of looks; the channel and run that miss most; by how many times.
    """
    warmup, unit = question.case.warmup, question.dynamics.particulars.time_unit
    rng = np.random.default_rng(1)
    looks: dict[tuple[str, str], list[Float[np.ndarray, " rows"]]] = {}
    for run, p, free in zip(runs, prepared, drawn, strict=True):
        held = "held-out" if run.name in question.case.proof else "fitted"
        noise = p.noise[:7] * np.exp(NOISE_ERROR * rng.standard_normal((len(free), 1, 7)))
        noisy = free + noise * rng.standard_normal(free.shape)
        if wander:
            time = run.time[-free.shape[1] :]
            noisy[..., :2] += wander.size * drawn_process(rng, time, wander.time, (len(free), 2)).swapaxes(0, 1)
        noisy[0] = free[0]
        record = recorded(run, warmup)
        off = _off(noisy, record)
        # A velocity that was taken from positions says nothing that they do not, and no sensor's noise is known of it.
        derived = {"u", "v"} if "vn" in run.derived else set()
        for channel, e in off.items():
            if channel in derived or not np.isfinite(e[0]).any():
                continue
            e = _blocks(e, max(1, round(BLOCK * unit / run.step)))
            looks.setdefault((held, channel), []).append(_relative(e))
            parts = np.array_split(e, max(1, round(e.shape[1] * BLOCK / WINDOW)), axis=1)
            looks[f"a part of {run.name}", channel] = [np.max([_relative(part) for part in parts], axis=0)]
    sizes = np.stack([np.sqrt(np.mean(np.square(several), axis=0)) for several in looks.values()])
    chance, least = rarest(sizes)
    where, channel = list(looks)[least]
    ratio = sizes[least, 0] / np.sqrt(np.mean(sizes[least, 1:] ** 2))
    return chance, f"{channel} of {where}", float(ratio)


def rarest(sizes: Float[np.ndarray, "looks rows"]) -> tuple[float, int]:
    """How improbable the largest of many looks at the first row is, if that row is like the others.

    How small the least of many probabilities is by chance, the draws say themselves (Westfall & Young): each row is
    ranked among all others, the recording like a draw. Ranked among draws alone, none could be as rare as it.

    Returns:
        The probability; the look.
    """
    count = sizes.shape[1]
    others = np.array([np.delete(np.arange(count), row) for row in range(count)])
    chance = np.stack([tail(of_look, of_look[others]) for of_look in sizes])
    least = 1 / chance.min(axis=0)
    return float(tail(least[:1], least[1:])[0]), int(chance[:, 0].argmin())


def _off(free: Float[np.ndarray, "rows n c"], record: pd.DataFrame) -> dict[str, Float[np.ndarray, "rows n"]]:
    """Channel -> distance from the middle: of the recording in the first row, of the draws in the others."""
    x, y, vn, ve, psi, r, log = np.moveaxis(free, -1, 0)
    u, v = earth_to_body(vn, ve, psi)
    c = {"x": x, "y": y, "psi": psi, "u": u, "v": v, "r": r, "u_log": log}
    unit = {"psi": DEGREE, "r": DEGREE}
    off = {}
    for name, mine in c.items():
        rows = np.vstack([record[name].to_numpy() * unit.get(name, 1.0), mine[1:]])
        off[name] = rows - mine[0]
    off["psi"] = (off["psi"] + np.pi) % (2 * np.pi) - np.pi
    return off


def _blocks(off: Float[np.ndarray, "rows n"], length: int) -> Float[np.ndarray, "rows m"]:
    """Means over blocks of samples that were recorded: what free runs miss is slow, the channels' noise is not."""
    off = off[:, np.isfinite(off[0])]
    return np.stack([part.mean(axis=1) for part in np.array_split(off, max(1, off.shape[1] // length), axis=1)], axis=1)


def _relative(off: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, " rows"]:
    """RMS of every row over that of all draws together."""
    size = np.sqrt(np.mean(off**2, axis=1))
    return size / np.sqrt(np.mean(size[1:] ** 2))


def tail(values: Float[np.ndarray, " m"], draws: Float[np.ndarray, "*#m n"]) -> Float[np.ndarray, " m"]:
    """Probability that a draw exceeds a value: by rank, beyond the largest fifth by Hill's tail of these.

    ``p = k/n (x/x_k)^(-1/g)``, ``g`` the mean of ``log(x_j/x_k)`` over the k largest.

    Args:
        values: Values, positive.
        draws: Draws, positive: the same for all values, or a row for each.

    Returns:
        The probability of each.
    """
    count = draws.shape[-1]
    ordered, k = np.sort(draws, axis=-1), max(3, round(TAIL * count))
    above = (draws >= values[:, None]).sum(axis=-1)
    largest, least = ordered[..., -k:], ordered[..., -k - 1]
    slope = np.log(largest / least[..., None]).mean(axis=-1)
    beyond = k / count * (np.maximum(values, least) / least) ** (-1 / slope)
    return np.where(values > least, beyond, (1 + above) / (1 + count))
