"""Where hypotheses are fitted and judged: marginal likelihoods by Laplace's method at the fit.

Every hypothesis shares the same uncertainty: initial states, noise, coefficients of the calm-water model, latency of
the receiver and a coloured force are integrated out *inside* it, the empty hypothesis included. Levels of the force and
of the coefficients' error are summed over a grid with a prior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_ndtr

from manoeuvre_nn.core.effect import Parameter
from manoeuvre_nn.diagnosis.bench import FORCE_LEVELS, LATENCY_SPREAD, Bench
from manoeuvre_nn.diagnosis.columns import contribution
from manoeuvre_nn.diagnosis.hypothesis import RANDOM, Hypothesis, Judged
from manoeuvre_nn.diagnosis.linear import Columns
from manoeuvre_nn.diagnosis.regression import FORCE_PRIOR, Posterior, log_prior_levels, log_sum, regress


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
        if free:
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
        best, score, step = hypothesis, -np.inf, hypothesis.vector() * 0.0
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
