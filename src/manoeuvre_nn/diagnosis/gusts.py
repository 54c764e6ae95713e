"""Gusts: their course is random, so it is integrated out, and only their size is fitted."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.columns import contribution
from manoeuvre_nn.diagnosis.court import Court, linear
from manoeuvre_nn.diagnosis.hypothesis import Hypothesis, Judged
from manoeuvre_nn.diagnosis.linear import Columns, Embedded
from manoeuvre_nn.diagnosis.regression import FORCE_PRIOR, log_prior_levels, log_sum

SHARES = (0.1, 0.13, 0.16, 0.2, 0.25, 0.32)
"""Standard deviations of gusts over the mean wind that are tried; smaller ones look like wrong load functions."""
MEMORY = 30.0
"""Correlation time of gusts [s]; 20 to 60 s are usual."""
KNOTS = 10.0
"""Time between the knots of their course [s]."""


def judge_gusts(court: Court, steady: Judged, gusty: Effect) -> Judged:
    """Judge a hypothesis with its steady wind replaced by a gusty one.

    Args:
        court: The runs.
        steady: A hypothesis with a steady wind.
        gusty: Prototype of the gusty wind.

    Returns:
        It at the most likely size of gusts.
    """
    bench = court.bench
    lin = linear(bench, steady.hypothesis)
    wind = steady.names.index("wind_steady")
    # Not the largest levels: a coloured force as large as gusts would only compete with them.
    levels = [int(g) for g in np.flatnonzero(bench.levels.max(axis=1) < 0.06)]
    size = bench.size + lin.count
    speed = [p.name for p in steady.hypothesis.effects[wind].declared].index("speed")
    sizes = tuple(share * max(float(steady.hypothesis.values[wind][0, speed]), 1.0) for share in SHARES)
    grams, norms = np.zeros((len(sizes), len(levels), size, size)), np.zeros((len(sizes), len(levels)))
    hidden = [_course(court, steady.hypothesis, wind, run) for run in range(len(bench.places))]
    for g, level in enumerate(levels):
        norms[:, g] = bench.at(level).norm
        for run, (c, at) in enumerate(zip(lin.columns, lin.index, strict=True)):
            where = np.concatenate([bench.base_index(run), bench.size + at])
            white = bench.at(level).white[run]
            more, loose, base = white.embed(c), white.embed(hidden[run]), bench.at(level).base[run]
            both = Embedded(np.hstack([base.outer, more.outer]), np.hstack([base.inner, more.inner]))
            own, cross, whole = loose.dot(loose), loose.dot(both), both.dot(both)
            for k, sd in enumerate(sizes):
                factor = np.linalg.cholesky(sd**2 * own + np.eye(len(own)))
                half = solve_triangular(factor, sd * cross, lower=True)
                grams[k, g][np.ix_(where, where)] += whole - half.T @ half
                norms[k, g] -= np.log(np.diag(factor)).sum()
    prior = log_prior_levels(bench, FORCE_PRIOR)
    tried = []
    for k in range(len(sizes)):
        known = {
            int(level): court.regress(steady.hypothesis, grams[k, [g]], norms[k, [g]]) for g, level in enumerate(levels)
        }
        tried.append(court.verdict(steady.hypothesis, known, prior))
    return _chosen(tried, sizes, steady.hypothesis, wind, gusty)


def _chosen(tried: list[Judged], sizes: tuple[float, ...], hypothesis: Hypothesis, wind: int, gusty: Effect) -> Judged:
    """The best size, by a parabola through the three best on a logarithmic scale, as a hypothesis of its own."""
    scores = np.array([j.evidence for j in tried])
    k = int(scores.argmax())
    size, error = sizes[k], 0.5 * sizes[k]
    if 0 < k < len(sizes) - 1:
        at = np.log(sizes[k - 1 : k + 2])
        curve = np.polyfit(at, scores[k - 1 : k + 2], 2)
        size, error = float(np.exp(-0.5 * curve[1] / curve[0])), float(size / np.sqrt(-2 * curve[0]))
    judged = tried[k]
    values = list(judged.hypothesis.values)
    names = [p.name for p in hypothesis.effects[wind].declared]
    old = values[wind]
    new = np.zeros((len(old), len(gusty.declared)))
    for j, p in enumerate(gusty.declared):
        new[:, j] = old[:, names.index(p.name)] if p.name in names else (size if p.name == "gust_sd" else MEMORY)
    values[wind] = new
    effects = tuple(gusty if n == wind else e for n, e in enumerate(hypothesis.effects))
    # Averaged over the sizes, not the best of them: trying many sizes must not pay.
    evidence = log_sum(scores) - float(np.log(len(scores)))
    return replace(
        judged, hypothesis=Hypothesis(effects, tuple(values)), evidence=evidence, random={"gust_sd": (size, error)}
    )


def _course(court: Court, hypothesis: Hypothesis, wind: int, run: int) -> Columns:
    """Columns of gusts of 1 m/s along the wind: hat functions turned so that their amplitudes are independent."""
    place, effect = court.bench.places[run], hypothesis.effects[wind]
    sets = np.tile(hypothesis.values[wind][run], (2, 1))
    sets[1, [p.name for p in effect.declared].index("speed")] += 0.5
    c = contribution(effect, sets, place.line, court.bench.rate, place.situation)
    push: Float[np.ndarray, "steps 6"] = (c.moved[..., 1] - c.moved[..., 0]) / 0.5
    time = place.line.run.time[1:] - 0.5 * place.line.run.step
    knots = np.arange(time[0], time[-1] + KNOTS, KNOTS)
    hats = np.clip(1 - np.abs(time[:, None] - knots) / KNOTS, 0, None)
    root = np.linalg.cholesky(np.exp(-np.abs(knots[:, None] - knots) / MEMORY) + 1e-9 * np.eye(len(knots)))
    return Columns(np.zeros((len(time) + 1, 8, len(knots))), push[:, :, None] * (hats @ root)[:, None, :])
