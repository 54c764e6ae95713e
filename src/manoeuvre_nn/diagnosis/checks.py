"""Tests that a named effect must pass, and effects that these recordings cannot tell from it."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.bench import LATENCY_SPREAD, SCATTER_LEVELS
from manoeuvre_nn.diagnosis.court import linear
from manoeuvre_nn.diagnosis.hypothesis import Hypothesis, Judged
from manoeuvre_nn.diagnosis.result import Check
from manoeuvre_nn.diagnosis.search import Contest

INDISTINGUISHABLE = 9.0
"""Expected gap, twice the log evidence, below which two effects are reported together."""


def checks(tried: Contest, chosen: Judged) -> list[Check]:
    """Everything that a claim must pass besides its probability.

    Args:
        tried: The contest.
        chosen: The claim.

    Returns:
        The checks.
    """
    return [_off_bounds(chosen), _little_left(tried, chosen), _same_in_all_runs(tried, chosen)]


def _off_bounds(chosen: Judged) -> Check:
    """Parameters that end on a bound are a sign of the wrong effect."""
    on = []
    for f, value in zip(chosen.hypothesis.free(), chosen.hypothesis.vector(), strict=True):
        p = f.parameter
        reach = 0.01 * (p.high - p.low)
        if (
            not p.form
            and not p.per_run
            and not p.period
            and not p.low + reach < value < p.high - reach
            and p.null != value
        ):
            on.append(f"{p.name} = {value:.3g} {p.unit}")
    text = "all parameters are inside their bounds" if not on else f"on a bound: {', '.join(on)}"
    return Check("parameters off their bounds", not on, text)


def _little_left(tried: Contest, chosen: Judged) -> Check:
    """What stays unexplained should be small against what was explained."""
    levels = tried.court.bench.levels
    before, after = levels[tried.none.best[0]].max(), levels[chosen.best[0]].max()
    text = f"force that stays unexplained: {after:.2g} of U0^2/L, in calm water {before:.2g}"
    return Check("little is left", after < 1.5e-2 or after < before, text)


def _same_in_all_runs(tried: Contest, chosen: Judged) -> Check:
    """Estimates from one run at a time must agree: a stranger posing as this effect changes from run to run."""
    bench, h = tried.court.bench, chosen.hypothesis
    if len(bench.places) < 2:
        return Check("same in all runs", True, "one run only: not tested")
    shared = [k for k, f in enumerate(h.free()) if f.run is None and not f.parameter.form]
    estimates = [_alone(tried, chosen, run, shared) for run in range(len(bench.places))]
    weights = [np.linalg.inv(c) for _, c in estimates]
    total = np.linalg.inv(sum(weights))  # type: ignore[arg-type]
    mean = total @ sum(w @ m for (m, _), w in zip(estimates, weights, strict=True))
    chi = float(sum((m - mean) @ w @ (m - mean) for (m, _), w in zip(estimates, weights, strict=True)))
    degrees = len(shared) * (len(estimates) - 1)
    return Check(
        "same in all runs",
        chi < degrees + 6 * np.sqrt(2 * degrees),
        f"chi-square {chi:.1f} for {degrees} degrees of freedom",
    )


def _alone(
    tried: Contest, chosen: Judged, run: int, shared: list[int]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Step and covariance of the shared parameters from one run alone."""
    gram, names = gram_of(tried, chosen.hypothesis, chosen.best[0], runs=[run])
    sd = nuisance_spread(tried, chosen.best[1])
    m = len(names)
    prior = np.concatenate([sd, [3 * f.spread for f in chosen.hypothesis.free()]])
    size = tried.court.bench.size
    keep = np.r_[1:size, size + 1 : size + 1 + m]
    data = gram[0] - gram[size]
    precision = gram[np.ix_(keep, keep)] + np.diag(prior**-2.0)
    covariance = np.linalg.inv(precision)
    at = [len(sd) + k for k in shared]
    return (covariance @ data[keep])[at], covariance[np.ix_(at, at)]


def gram_of(
    tried: Contest, hypothesis: Hypothesis, level: int, runs: list[int] | None = None
) -> tuple[Float[np.ndarray, "p p"], list[str]]:
    """Inner products of base and hypothesis, over some runs only.

    Args:
        tried: The contest.
        hypothesis: Its columns are taken at its values.
        level: Force level.
        runs: Numbers of the runs; None takes all.

    Returns:
        Matrix, and names of the free numbers.
    """
    bench = tried.court.bench
    lin = linear(bench, hypothesis)
    n = bench.size
    g = np.zeros((n + lin.count,) * 2)
    for run in runs if runs is not None else range(len(bench.places)):
        more, base = bench.at(level).white[run].embed(lin.columns[run]), bench.at(level).base[run]
        at, to = bench.base_index(run), n + lin.index[run]
        g[np.ix_(at, at)] += base.dot(base)
        g[np.ix_(at, to)] += base.dot(more)
        g[np.ix_(to, to)] += more.dot(more)
    g[n:, :n] = g[:n, n:].T
    return g, [f.parameter.name for f in hypothesis.free()]


def nuisance_spread(tried: Contest, scatter: int) -> Float[np.ndarray, " k"]:
    """Prior standard deviations of coefficients and latencies.

    Args:
        tried: The contest.
        scatter: Scatter level.

    Returns:
        One a base column but for the data.
    """
    bench = tried.court.bench
    return np.r_[np.full(len(bench.coefficients), SCATTER_LEVELS[scatter]), np.full(len(bench.places), LATENCY_SPREAD)]


def aliases(tried: Contest, chosen: Judged) -> list[str]:
    """Effects that could have produced what was found: the gap between them would hardly show.

    For each rival, what the found effect adds is projected on what the rival can add, coefficients and latency free:
    what is left over is twice the log evidence by which the two are expected to differ.

    Args:
        tried: The contest.
        chosen: What was found.

    Returns:
        Names of rivals of the first effect.
    """
    if len(chosen.names) != 1:
        return []
    found = []
    for rival in tried.judged:
        if len(rival.names) == 1 and rival.names != chosen.names and gap(tried, chosen, rival) < INDISTINGUISHABLE:
            found.append(rival.names[0])
    return found


def gap(tried: Contest, chosen: Judged, rival: Judged) -> float:
    """Twice the log evidence by which a hypothesis is expected to beat a rival on these recordings.

    Args:
        tried: The contest.
        chosen: It.
        rival: The other.

    Returns:
        The gap, by the local information matrix.
    """
    both = chosen.hypothesis.joined(rival.hypothesis)
    g, _ = gram_of(tried, both, chosen.best[0])
    n, mine = tried.court.bench.size, len(chosen.hypothesis.free())
    # The whole contribution of both effects stands in one column: take the rival's out of it.
    alone, _ = gram_of(tried, rival.hypothesis, chosen.best[0])
    del alone
    whole = n
    others = np.r_[1:n, n + 1 + mine : len(g)]
    prior = np.r_[nuisance_spread(tried, chosen.best[1]), [3 * f.spread for f in rival.hypothesis.free()]]
    a = g[np.ix_(others, others)] + np.diag(prior**-2.0)
    b = g[others, whole]
    return float(g[whole, whole] - b @ np.linalg.solve(a, b))
