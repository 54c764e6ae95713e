"""Hypotheses about what was left out, and how well each explains the recordings: marginal likelihoods by Laplace.

Every hypothesis shares the same uncertainty: initial states, noise, coefficients of the calm-water model, latency of the
receiver and a coloured force are integrated out *inside* it, the empty hypothesis included. Levels of the force and of the
coefficients' error are summed over a grid with a prior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log, pi, sqrt

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_ndtr

from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.diagnosis.bench import FORCE_LEVELS, LATENCY_SPREAD, SCATTER_LEVELS, Bench
from manoeuvre_nn.diagnosis.columns import contribution
from manoeuvre_nn.diagnosis.linear import Columns

RANDOM = ("gust_sd", "gust_time_s")
"""Parameters of a random process: its course is integrated out, so that they have no column of their own."""
FORCE_PRIOR = 0.03
"""Scale of the half-normal prior of the coloured force's levels when physics is named: little may stay unexplained."""
SCATTER_PRIOR = 0.03
"""Scale of the exponential prior of the coefficients' relative error: published scatter is 3 to 6 %."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with values.

    Attributes:
        effects: The effects, prototypes without values of their own.
        values: Parameter values of each effect, one row a run; parameters that are not per run are equal in all rows.
        fixed: Names of parameters that are held at their values.
    """

    effects: tuple[Effect, ...]
    values: tuple[Float[np.ndarray, "runs p"], ...]
    fixed: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    def free(self) -> list["Free"]:
        """All free numbers: effect, parameter, and the run for those that differ between runs."""
        found = []
        for k, effect in enumerate(self.effects):
            for j, p in enumerate(effect.declared):
                if p.name in RANDOM or p.name in self.fixed:
                    continue
                runs = range(len(self.values[k])) if p.per_run else [None]
                found += [Free(k, j, run, p) for run in runs]
        return found

    def vector(self) -> Float[np.ndarray, " m"]:
        """Values of the free numbers."""
        return np.array([self.values[f.effect][f.run or 0, f.column] for f in self.free()])

    def with_vector(self, vector: Float[np.ndarray, " m"]) -> "Hypothesis":
        """The hypothesis at other values.

        Args:
            vector: Values of the free numbers.

        Returns:
            A new hypothesis.
        """
        values = [v.copy() for v in self.values]
        for f, value in zip(self.free(), vector, strict=True):
            values[f.effect][slice(None) if f.run is None else f.run, f.column] = value
        return replace(self, values=tuple(values))

    def joined(self, other: "Hypothesis") -> "Hypothesis":
        """Both sets of effects together.

        Args:
            other: Another hypothesis.

        Returns:
            Their union.
        """
        return replace(self, effects=self.effects + other.effects, values=self.values + other.values)


@dataclass(frozen=True)
class Free:
    """One free number of a hypothesis.

    Attributes:
        effect: Number of the effect.
        column: Number of its parameter.
        run: The run that it belongs to; None for all.
        parameter: What it is.
    """

    effect: int
    column: int
    run: int | None
    parameter: Parameter

    @property
    def spread(self) -> float:
        """Prior standard deviation; a flat prior over a range is written as the Gaussian of equal height."""
        p = self.parameter
        if p.period:
            return p.period / sqrt(2 * pi)
        return (p.high - p.low) / sqrt(2 * pi) if p.per_run else p.spread

    def mean(self, value: float) -> float:
        """Prior mean; a flat prior has it wherever the value is.

        Args:
            value: Value now.

        Returns:
            The mean.
        """
        p = self.parameter
        return value if p.null is None or p.period or p.per_run else p.null


@dataclass(frozen=True)
class Judged:
    """A hypothesis after it has seen the recordings.

    Attributes:
        hypothesis: It, at its most likely values.
        evidence: Log marginal likelihood, noise levels summed out.
        by_level: The same at every grid point: force level, scatter level.
        covariance: Of the free numbers.
        misfit: Chi-square of the data at the best level.
        best: Force level and scatter level with the highest weight.
        nuisance: Most likely coefficients (relative error) and latencies.
        random: Sizes of random courses (gusts) with standard errors.
    """

    hypothesis: Hypothesis
    evidence: float
    by_level: Float[np.ndarray, "g s"] = field(repr=False)
    covariance: Float[np.ndarray, "m m"] = field(repr=False)
    misfit: float = 0.0
    best: tuple[int, int] = (0, 0)
    nuisance: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0), repr=False)
    random: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.hypothesis.names

    @property
    def errors(self) -> Float[np.ndarray, " m"]:
        """Standard errors of the free numbers."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


@dataclass(frozen=True)
class Linear:
    """A hypothesis as columns of every run: what it adds at its values, and per unit of every free number."""

    hypothesis: Hypothesis
    columns: list[Columns]
    index: list[Int[np.ndarray, " k"]]
    count: int


def _differences(p: Parameter) -> float:
    """Step of the difference quotient."""
    return 0.5 if p.period else (2.0 if p.per_run else 0.02 * p.spread)


def linear(bench: Bench, hypothesis: Hypothesis) -> Linear:
    """Columns of a hypothesis: one of the whole contribution, one a free number.

    Args:
        bench: The runs.
        hypothesis: It.

    Returns:
        Columns of each run.
    """
    free = hypothesis.free()
    columns, index = [], []
    for run, place in enumerate(bench.places):
        whole, parts, at = None, [], []
        for k, effect in enumerate(hypothesis.effects):
            mine = [(i, f) for i, f in enumerate(free) if f.effect == k and f.run in (None, run)]
            here = hypothesis.values[k][run].copy()
            here[[p.name == RANDOM[0] for p in effect.declared]] = 0.0
            steps = np.array([_differences(f.parameter) for _, f in mine])
            sets = np.tile(here, (1 + 2 * len(mine), 1))
            for j, (_, f) in enumerate(mine):
                up = (
                    min(here[f.column] + steps[j], f.parameter.high)
                    if not f.parameter.period
                    else here[f.column] + steps[j]
                )
                down = (
                    max(here[f.column] - steps[j], f.parameter.low)
                    if not f.parameter.period
                    else here[f.column] - steps[j]
                )
                sets[1 + 2 * j, f.column], sets[2 + 2 * j, f.column] = up, down
                steps[j] = up - down
            c = contribution(effect, sets, place.line, bench.rate, place.situation)
            slope = Columns(
                (c.measured[..., 1::2] - c.measured[..., 2::2]) / steps,
                (c.moved[..., 1::2] - c.moved[..., 2::2]) / steps,
            )
            parts.append(slope)
            at += [1 + i for i, _ in mine]
            whole = (
                Columns(c.measured[..., :1], c.moved[..., :1])
                if whole is None
                else Columns(whole.measured + c.measured[..., :1], whole.moved + c.moved[..., :1])
            )
        assert whole is not None
        columns.append(
            Columns(
                np.concatenate([whole.measured, *(p.measured for p in parts)], axis=-1),
                np.concatenate([whole.moved, *(p.moved for p in parts)], axis=-1),
            )
        )
        index.append(np.array([0, *at]))
    return Linear(hypothesis, columns, index, 1 + len(free))


def log_prior_levels(bench: Bench, force_prior: float | None) -> Float[np.ndarray, "g s"]:
    """Log prior of the grid of force and scatter levels.

    Args:
        bench: The runs.
        force_prior: Scale of the half-normal prior of the force levels; None is flat over the levels.

    Returns:
        Normalised over the grid.
    """
    force = np.zeros(len(bench.levels))
    if force_prior is not None:
        force = -0.5 * np.square(bench.levels / force_prior).sum(axis=1)
    scatter = -np.array(SCATTER_LEVELS) / SCATTER_PRIOR
    total = force[:, None] + scatter[None, :]
    return total - log_sum(total)


def log_sum(x: np.ndarray) -> float:
    """Log of the sum of exponentials.

    Args:
        x: Logs.

    Returns:
        The log of their sum.
    """
    top = float(x.max())
    return top + log(float(np.exp(x - top).sum()))


@dataclass(frozen=True)
class Posterior:
    """Result of the linear algebra at one grid of levels."""

    by_level: Float[np.ndarray, "g s"]
    mean: Float[np.ndarray, "g s m"]
    covariance: Float[np.ndarray, "g s m m"]
    misfit: Float[np.ndarray, "g s"]


def regress(
    gram: Float[np.ndarray, "g p p"],
    norm: Float[np.ndarray, " g"],
    coefficients: int,
    data: Float[np.ndarray, " p"],
    prior: Float[np.ndarray, " m"],
) -> Posterior:
    """Bayesian linear regression in the metric of the samples, at every level of force and coefficient scatter.

    Args:
        gram: Inner products of all columns at each force level.
        norm: Log normaliser at each force level.
        coefficients: Number of coefficient columns; they stand first among the unknowns.
        data: The data as a combination of all columns.
        prior: Prior standard deviations of the unknowns, coefficients in units of the scatter.

    Returns:
        Evidence without the levels' prior, and mean and covariance of the unknowns.
    """
    m = len(prior)
    unknown = gram[:, -m:, -m:]
    right = gram[:, -m:, :] @ data
    power = np.einsum("p,gpq,q->g", data, gram, data)
    shape = (len(gram), len(SCATTER_LEVELS))
    evidence, misfit = np.empty(shape), np.empty(shape)
    mean, covariance = np.empty((*shape, m)), np.empty((*shape, m, m))
    for s, scatter in enumerate(SCATTER_LEVELS):
        sd = prior.copy()
        sd[:coefficients] *= scatter
        scaled = unknown * sd[:, None] * sd[None, :] + np.eye(m)
        inverse = np.linalg.inv(scaled)
        z = np.einsum("gij,gj->gi", inverse, right * sd)
        misfit[:, s] = power - np.einsum("gi,gi->g", z, right * sd)
        evidence[:, s] = norm - 0.5 * misfit[:, s] - 0.5 * np.linalg.slogdet(scaled)[1]
        mean[:, s] = z * sd
        covariance[:, s] = inverse * sd[:, None] * sd[None, :]
    return Posterior(evidence, mean, covariance, misfit)


class Court:
    """Where hypotheses are fitted and judged on the bench.

    Attributes:
        bench: The runs.
    """

    def __init__(self, bench: Bench, level: int | None = None) -> None:
        """Prepare the base.

        Args:
            bench: The runs.
            level: Grid point at which fits are made before the noise is known; None takes a middle one.
        """
        self.bench = bench
        self.start_level = level if level is not None else 2 * (len(FORCE_LEVELS) + 1)

    @property
    def coefficients(self) -> int:
        """Number of coefficient columns."""
        return len(self.bench.coefficients)

    def _prior(self, hypothesis: Hypothesis) -> Float[np.ndarray, " m"]:
        base = np.ones(self.coefficients + len(self.bench.places))
        base[self.coefficients :] = LATENCY_SPREAD
        return np.concatenate([base, [f.spread for f in hypothesis.free()]])

    def grams(self, lin: Linear, levels: Sequence[int]) -> Float[np.ndarray, "g p p"]:
        """Inner products at some levels.

        Args:
            lin: The hypothesis' columns.
            levels: Grid points.

        Returns:
            One matrix a level.
        """
        return np.stack([self.bench.gram(g, lin.columns, lin.index, lin.count) for g in levels])

    def posterior(self, lin: Linear, levels: Sequence[int]) -> Posterior:
        """Regression about the hypothesis' values; means are those of the free numbers' change.

        Args:
            lin: The hypothesis' columns.
            levels: Grid points.

        Returns:
            Evidence, mean, covariance.
        """
        return self.regress(lin.hypothesis, self.grams(lin, levels), np.array([self.bench.at(g).norm for g in levels]))

    def regress(
        self, hypothesis: Hypothesis, gram: Float[np.ndarray, "g p p"], norm: Float[np.ndarray, " g"]
    ) -> Posterior:
        """The same from inner products.

        Args:
            hypothesis: At its values.
            gram: Inner products of base and the hypothesis' columns.
            norm: Log normaliser at each level.

        Returns:
            Evidence, mean, covariance.
        """
        free, now = hypothesis.free(), hypothesis.vector()
        size = self.bench.size
        data = np.zeros(gram.shape[1])
        data[0], data[size] = 1.0, -1.0
        # Unknowns are deviations from their prior means.
        shift = np.array([f.mean(v) - v for f, v in zip(free, now, strict=True)])
        data[size + 1 :] = -shift
        keep = np.r_[0, size, 1:size, size + 1 : size + 1 + len(free)]
        g = gram[:, keep][:, :, keep]
        found = regress(g, norm, self.coefficients, data[keep], self._prior(hypothesis))
        mean = found.mean.copy()
        mean[..., -len(free) :] += shift
        return replace(found, mean=mean)

    def improve(self, hypothesis: Hypothesis, level: int, scatter: int, rounds: int = 5) -> tuple[Hypothesis, float]:
        """Gauss-Newton steps at one noise level.

        Args:
            hypothesis: Where to start.
            level: Force level.
            scatter: Scatter level.
            rounds: Most steps.

        Returns:
            The best values met and their log evidence at that level.
        """
        best, score, step = hypothesis, -np.inf, None
        trial = hypothesis
        for _ in range(rounds):
            lin = linear(self.bench, trial)
            found = self.posterior(lin, [level])
            value = self._at_point(lin, found, scatter)
            if value > score:
                gained = value - score
                best, score = trial, value
                step = found.mean[0, scatter][-len(trial.free()) :]
                if gained < 0.02:
                    break
            else:
                step = 0.4 * step
            moved = _limited(best, step)
            if np.allclose(moved.vector(), best.vector(), rtol=1e-6, atol=1e-9):
                break
            trial = moved
        return best, score

    def _at_point(self, lin: Linear, found: Posterior, scatter: int) -> float:
        """Log joint density of data and values at the values themselves: what a step must raise."""
        m = len(lin.hypothesis.free())
        mean = found.mean[0, scatter][-m:]
        precision = np.linalg.inv(found.covariance[0, scatter][-m:, -m:])
        return float(found.by_level[0, scatter] - 0.5 * mean @ precision @ mean + 0.5 * np.linalg.slogdet(precision)[1])

    def judge(
        self, hypothesis: Hypothesis, force_prior: float | None = FORCE_PRIOR, around: int | None = None
    ) -> Judged:
        """Evidence of a hypothesis at its values, over all levels that matter.

        Levels are taken on outward from a first one until the best is surrounded by worse ones.

        Args:
            hypothesis: It, fitted.
            force_prior: See :func:`log_prior_levels`.
            around: Force level to begin with; None takes the middle of the grid.

        Returns:
            What came out.
        """
        prior = log_prior_levels(self.bench, force_prior)
        lin = linear(self.bench, hypothesis) if hypothesis.effects else None
        side = len(FORCE_LEVELS)
        known: dict[int, Posterior] = {}
        best = self.start_level if around is None else around
        while True:
            row, column = divmod(best, side)
            cross = [(row, column), (row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
            new = [r * side + c for r, c in cross if 0 <= r < side and 0 <= c < side and r * side + c not in known]
            for level in new:
                known[level] = self._at_level(hypothesis, lin, level)
            top = max(known, key=lambda g: float((known[g].by_level[0] + prior[g]).max()))
            if top == best:
                break
            best = top
        return self.verdict(hypothesis, known, prior)

    def judge_level(self, hypothesis: Hypothesis, level: int) -> float:
        """Log evidence at one force level, the best scatter.

        Args:
            hypothesis: It, fitted.
            level: Force level.

        Returns:
            Log evidence.
        """
        lin = linear(self.bench, hypothesis) if hypothesis.effects else None
        return float(self._at_level(hypothesis, lin, level).by_level.max())

    def _at_level(self, hypothesis: Hypothesis, lin: Linear | None, level: int) -> Posterior:
        """Regression at one force level."""
        if lin is not None:
            return self.posterior(lin, [level])
        data = np.eye(self.bench.size)[0]
        here = self.bench.at(level)
        return regress(here.base_gram[None], np.array([here.norm]), self.coefficients, data, self._prior(hypothesis))

    def verdict(
        self, hypothesis: Hypothesis, known: Mapping[int, Posterior], prior: Float[np.ndarray, "g s"]
    ) -> Judged:
        """Sum over the levels.

        Args:
            hypothesis: At its values.
            known: Regression at every force level that was looked at.
            prior: Log prior of the levels.

        Returns:
            What came out.
        """
        by_level = np.full(prior.shape, -np.inf)
        for level, found in known.items():
            by_level[level] = found.by_level[0]
        weighted = by_level + prior
        g, s = (int(k) for k in np.unravel_index(int(weighted.argmax()), weighted.shape))
        m = len(hypothesis.free())
        mean, covariance = known[g].mean[0, s], known[g].covariance[0, s]
        final = hypothesis if not m else _limited(hypothesis, mean[-m:])
        k = len(mean) - m
        evidence = log_sum(weighted)
        if m:
            evidence += _bounded(hypothesis, mean[-m:], np.diag(covariance)[-m:])
        misfit = float(known[g].misfit[0, s])
        return Judged(final, evidence, by_level, covariance[k:, k:], misfit, (g, s), mean[:k])


def _bounded(hypothesis: Hypothesis, step: Float[np.ndarray, " m"], variance: Float[np.ndarray, " m"]) -> float:
    """Bounds taken into the evidence: the share of each posterior inside them over the share of each prior."""
    total = 0.0
    for f, value, change, v in zip(hypothesis.free(), hypothesis.vector(), step, variance, strict=True):
        p = f.parameter
        if not p.period and not p.per_run and p.null is not None:
            total += _log_inside(p, value + change, sqrt(v)) - _log_inside(p, f.mean(value), f.spread)
    return total


def _log_inside(p: Parameter, mean: float, sd: float) -> float:
    """Log of the probability that a Gaussian lies within a parameter's bounds."""
    return float(log_ndtr((p.high - mean) / sd) if mean - p.low > p.high - mean else log_ndtr((mean - p.low) / sd))


def _limited(hypothesis: Hypothesis, step: Float[np.ndarray, " m"]) -> Hypothesis:
    """A step held within bounds and within what the linear equations can be trusted for."""
    free, now = hypothesis.free(), hypothesis.vector()
    new = now.copy()
    reach = 1.0
    for f, change in zip(free, step, strict=True):
        most = 45.0 if f.parameter.period else (60.0 if f.parameter.per_run else 1.5 * f.parameter.spread)
        reach = min(reach, most / max(abs(change), 1e-12))
    for k, f in enumerate(free):
        value = now[k] + reach * step[k]
        new[k] = (
            value % f.parameter.period
            if f.parameter.period
            else float(np.clip(value, f.parameter.low, f.parameter.high))
        )
    return hypothesis.with_vector(new)
