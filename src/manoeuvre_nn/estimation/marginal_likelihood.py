"""Marginal likelihoods of hypotheses by Laplace's method at their most likely values.

Every hypothesis shares the same uncertainty: initial states, noise, coefficients of the calm-water model, latency of
the receiver and process noise are integrated out *inside* it, the empty hypothesis included. Levels of the process
noise and of the coefficients' standard deviation are summed over a grid with a prior.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import log, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp, softmax

from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis, log_inside
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns, hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Embedded
from manoeuvre_nn.estimation.model_corrections import USUAL_SCATTER
from manoeuvre_nn.estimation.posterior import Posterior, mixture

PROCESS_PRIOR = 0.03
"""Scale s of the prior of the process noise's levels x, ``p(ln x) ~ exp(-x^2 / 2 s^2)``, when physics is named: little
may stay unexplained."""
COEFFICIENT_SD_PRIOR = 0.045
"""Likeliest relative error s0 of coefficients, of which ``p(ln s) ~ s^2 exp(-s^2 / 2 s0^2)`` (Rayleigh's distribution):
published sets scatter by 3 to 6 %, and none is exact."""
USUAL_LEVELS = int(np.searchsorted(COEFFICIENT_SD_LEVELS, 2 * USUAL_SCATTER))
"""Number of the levels of the coefficients' standard deviation that are usual."""
MIN_GAIN = 0.02
"""Log density that a Gauss-Newton step must gain for another one to be made."""
MIN_LEVEL_WEIGHT = 0.01
"""Weight of a level of noise, over that of the best, from which on it counts for values and standard errors."""
MAX_KEPT = 16
"""Hypotheses whose columns are kept."""
MAX_STEP_DEG, MAX_STEP_S, MAX_STEP_SDS = 45.0, 60.0, 1.5
"""Largest step of a direction, of a time, and of other numbers over their prior standard deviation."""


class _Piece(NamedTuple):
    """A hypothesis at one level of the process noise: whitened columns of each run and inner products of all."""

    lin: HypothesisColumns
    columns: list[Embedded]
    cross: Float[np.ndarray, "base k"]
    own: Float[np.ndarray, "k k"]


class MarginalLikelihood:
    """Fits hypotheses to whitened runs and says how probable they make the data.

    Attributes:
        data_set: The runs.
        start_level: Grid point at which fits are made before the noise is known.
    """

    def __init__(self, data_set: WhitenedDataSet) -> None:
        """Take the runs."""
        self.data_set = data_set
        middle = len(data_set.levels.sizes) // 2
        self.start_level = data_set.levels.point(middle, middle)
        self._pieces: dict[tuple[object, ...], _Piece] = {}
        self._latest: dict[tuple[object, ...], HypothesisColumns] = {}

    def posterior(self, lin: HypothesisColumns | None, level: int) -> Posterior:
        """What the runs say about a hypothesis' values: means are those of the unknowns' change.

        Args:
            lin: The hypothesis' columns; None is calm water.
            level: Grid point.

        Returns:
            The posterior.
        """
        here = self.data_set.at(level)
        if lin is None:
            return self.regress(here.base_gram, here.norm)
        if level not in lin.known:
            columns = self.data_set.embedded(level, lin.columns)
            gram = self.data_set.gram(level, columns, lin.index, lin.count, lin.turned)
            lin.known[level] = self.regress(gram, here.norm, lin.hypothesis)
        return lin.known[level]

    def columns(self, hypothesis: Hypothesis) -> HypothesisColumns:
        """Columns of a hypothesis; the last few are kept: screening, fits and levels of noise ask for them again."""
        key = _key(hypothesis)
        found = self._latest.pop(key, None) or hypothesis_columns(self.data_set, hypothesis)
        self._latest[key] = found  # it holds the effects, so that no other one can have their ids
        if len(self._latest) > MAX_KEPT:
            del self._latest[next(iter(self._latest))]
        return found

    def regress(self, gram: Float[np.ndarray, "p p"], norm: float, *hypotheses: Hypothesis) -> Posterior:
        """The same from inner products.

        Args:
            gram: Inner products of the base and of each hypothesis' columns.
            norm: Log normaliser.
            *hypotheses: At their values.

        Returns:
            Of coefficients, latencies and unknowns; these as deviations from their prior means.
        """
        size = at = self.data_set.size
        data = np.append(1.0, np.zeros(len(gram) - 1))
        wholes, numbers, spreads = list[int](), list[int](), list[float]()
        durations = [float(np.ptp(p.linearised.run.time)) for p in self.data_set.runs]
        for hypothesis in hypotheses:
            unknowns = hypothesis.unknowns()
            wholes.append(at)
            numbers += range(at + 1, at + 1 + len(unknowns))
            spreads += hypothesis.prior_sds(durations).tolist()
            # Unknowns are deviations from their prior means: the data stand at the present values.
            data[at : at + 1 + len(unknowns)] = np.append(-1.0, -to_prior_means(hypothesis))
            at += 1 + len(unknowns)
        keep = [0, *wholes, *range(1, size), *numbers]
        found = self.data_set.posterior(gram[np.ix_(keep, keep)], norm, data[keep], spreads)
        prior = sum(h.prior_excess() + h.log_prior_of_times() for h in hypotheses)
        return replace(found, evidence=found.evidence + prior)

    def pair_evidence(self, first: Hypothesis, second: Hypothesis, level: int, scatter: int) -> float:
        """Log evidence of two hypotheses together after a linear step of all their numbers."""
        a, b, base = self._piece(first, level), self._piece(second, level), self.data_set.at(level)
        if a.lin.turned or b.lin.turned:
            return self._turned_pair(a, b, level, scatter)
        between = np.zeros((len(a.own), len(b.own)))
        for mine, at, other, to in zip(a.columns, a.lin.index, b.columns, b.lin.index, strict=True):
            between[np.ix_(at, to)] += mine.dot(other)
        gram = np.block([
            [base.base_gram, a.cross, b.cross],
            [a.cross.T, a.own, between],
            [b.cross.T, between.T, b.own],
        ])
        return float(self.regress(gram, base.norm, first, second).evidence[scatter])

    def _turned_pair(self, a: _Piece, b: _Piece, level: int, scatter: int) -> float:
        """The same where effects multiply coefficients: what both do to these adds up."""
        one, number = np.eye(self.data_set.combinations + 2), range(len(self.data_set.runs))
        turned = [sum((p.lin.turned[run] - one for p in (a, b) if p.lin.turned), one) for run in number]
        columns = [mine.joined(other) for mine, other in zip(a.columns, b.columns, strict=True)]
        index = [np.r_[at, a.lin.count + to] for at, to in zip(a.lin.index, b.lin.index, strict=True)]
        gram = self.data_set.gram(level, columns, index, a.lin.count + b.lin.count, turned)
        found = self.regress(gram, self.data_set.at(level).norm, a.lin.hypothesis, b.lin.hypothesis)
        return float(found.evidence[scatter])

    def _piece(self, hypothesis: Hypothesis, level: int) -> _Piece:
        """A hypothesis at a level of the process noise: whitened once, not once a pair."""
        key = (level, *_key(hypothesis))
        if key not in self._pieces:
            lin, size = self.columns(hypothesis), self.data_set.size
            columns = self.data_set.embedded(level, lin.columns)
            gram = self.data_set.gram(level, columns, lin.index, lin.count)
            self._pieces[key] = _Piece(lin, columns, gram[:size, size:], gram[size:, size:])
        return self._pieces[key]

    def improve(self, hypothesis: Hypothesis, level: int, scatter: int, rounds: int = 5) -> tuple[Hypothesis, float]:
        """Gauss-Newton steps at one noise level.

        Args:
            hypothesis: Where to start.
            level: Level of the process noise.
            scatter: Level of the coefficients' standard deviation.
            rounds: Steps at most.

        Returns:
            The best values met and their log evidence at that level.
        """
        best, score, step = hypothesis, -np.inf, hypothesis.vector() * 0.0
        trial = hypothesis
        m = len(step)
        for _ in range(rounds):
            found = self.posterior(self.columns(trial), level)
            change = found.mean(scatter)[-m:] + to_prior_means(trial) if m else step
            value = float(found.evidence[scatter])
            if m:  # density of data and values at the values themselves: what a step must raise
                precision = np.linalg.inv(found.covariance(scatter)[-m:, -m:])
                value += 0.5 * float(np.linalg.slogdet(precision)[1] - change @ precision @ change)
            if value > score:
                gained = value - score
                best, score, step = trial, value, change
                if gained < MIN_GAIN:
                    break
            else:
                step = 0.4 * step
            moved = _limited(best, step)
            if np.allclose(moved.vector(), best.vector(), rtol=1e-6, atol=1e-9):
                break
            trial = moved
        return best, score

    def evaluate(
        self,
        hypothesis: Hypothesis,
        process_prior: float | None = PROCESS_PRIOR,
        around: int | None = None,
        fine: bool = True,
    ) -> FittedHypothesis:
        """Evidence of a hypothesis at its values, over all levels that matter.

        Levels are taken on outward from a first one until the best is surrounded by worse ones.

        Args:
            hypothesis: It, at its most likely values.
            process_prior: See :func:`log_prior_levels`.
            around: Level of the process noise to begin with; None takes the middle of the grid.
            fine: Whether all levels are looked at, or every third: enough as long as states are on their way.

        Returns:
            What came out.
        """
        prior = log_prior_levels(self.data_set, process_prior)
        lin = self.columns(hypothesis) if hypothesis.effects else None
        known: dict[int, Posterior] = {}

        def score(level: int) -> float:
            known[level] = self.posterior(lin, level)
            return float((known[level].evidence + prior[level]).max())

        self.data_set.levels.uphill(self.start_level if around is None else around, score, fine)
        return self.over_levels(hypothesis, known, prior)

    def evidence_at(self, hypothesis: Hypothesis, level: int) -> float:
        """Log evidence at one level of the process noise, the best level of the coefficients' standard deviation.

        Args:
            hypothesis: It, at its most likely values.
            level: Level of the process noise.

        Returns:
            Log evidence.
        """
        lin = self.columns(hypothesis) if hypothesis.effects else None
        return float(self.posterior(lin, level).evidence.max())

    def over_levels(
        self, hypothesis: Hypothesis, known: Mapping[int, Posterior], prior: Float[np.ndarray, "g s"]
    ) -> FittedHypothesis:
        """Sum over the levels.

        Args:
            hypothesis: At its values.
            known: Posterior at every level of the process noise that was looked at.
            prior: Log prior of the levels.

        Returns:
            What came out.
        """
        by_level = np.full(prior.shape, -np.inf)
        for level, found in known.items():
            by_level[level] = found.evidence
        process = prior[:, :1]  # but for a constant, which goes out again
        seen, by_level = by_level + prior, self.data_set.levels.filled(by_level + process) - process
        weighted = by_level + prior
        g, s = (int(k) for k in np.unravel_index(int(seen.argmax()), seen.shape))
        m, k = len(hypothesis.unknowns()), self.data_set.size - 1
        usual = weighty(seen)
        means = np.array([known[g].mean(s) for g, s in usual])
        covariances = [known[g].covariance(s) for g, s in usual]
        mean, covariance = mixture(softmax([weighted[at] for at in usual]), means, covariances)
        change = mean[k:] + to_prior_means(hypothesis)
        final = hypothesis if not m else _limited(hypothesis, change)
        evidence = float(logsumexp(weighted)) + _bounded(hypothesis, change, np.diag(covariance)[k:])
        misfit = float(known[g].misfit[s])
        combined, latencies = np.split(mean[:k], [self.data_set.combinations])
        corrections = self.data_set.rotation @ combined
        return FittedHypothesis(final, evidence, by_level, covariance[k:, k:], misfit, (g, s), corrections, latencies)


def weighty(weighted: Float[np.ndarray, "g s"]) -> list[tuple[int, int]]:
    """Levels whose weight is not negligible beside the best.

    Args:
        weighted: Log weight at every level of the process noise and of the coefficients' standard deviation.

    Returns:
        Numbers of both.
    """
    least = weighted.max() + log(MIN_LEVEL_WEIGHT)
    return [(int(g), int(s)) for g, s in zip(*np.nonzero(weighted > least), strict=True)]


def log_prior_levels(data_set: WhitenedDataSet, process_prior: float | None) -> Float[np.ndarray, "g s"]:
    """Log prior of the grid of levels of process noise and of the coefficients' standard deviation.

    It is flat where the model was fitted: by how much such a model is wrong in other runs than its own is not known
    beforehand, least of all in other weather.

    Args:
        data_set: The runs.
        process_prior: Scale of the prior of the process noise, :data:`PROCESS_PRIOR`; None is flat over the levels.

    Returns:
        Normalised over the grid.
    """
    process, scatter = np.zeros(len(data_set.levels)), np.zeros(len(COEFFICIENT_SD_LEVELS))
    if process_prior is not None and not is_fitted(data_set.dynamics):
        process = -0.5 * np.square(data_set.levels.pairs / process_prior).sum(axis=1)
    if not is_fitted(data_set.dynamics):
        square = np.square(np.array(COEFFICIENT_SD_LEVELS) / COEFFICIENT_SD_PRIOR)
        scatter = np.log(square) - 0.5 * square
    if data_set.coefficient_prior.usual:
        scatter[USUAL_LEVELS:] = -np.inf
    total = process[:, None] + scatter[None, :]
    return total - logsumexp(total)


def _key(hypothesis: Hypothesis) -> tuple[object, ...]:
    """What tells hypotheses apart as long as their effects are kept, so that no other one can have their ids."""
    effects = tuple(map(id, hypothesis.effects))
    return (effects, hypothesis.fixed, hypothesis.campaigns, *(v.tobytes() for v in hypothesis.values))


def to_prior_means(hypothesis: Hypothesis) -> Float[np.ndarray, " m"]:
    """Prior means of the unknowns less their values."""
    values = hypothesis.vector()
    return np.array([f.mean(v) - v for f, v in zip(hypothesis.unknowns(), values, strict=True)])


def _bounded(hypothesis: Hypothesis, step: Float[np.ndarray, " m"], variance: Float[np.ndarray, " m"]) -> float:
    """Bounds taken into the evidence: the share of each posterior inside them over the share of each prior."""
    total = 0.0
    for f, value, change, v in zip(hypothesis.unknowns(), hypothesis.vector(), step, variance, strict=True):
        p = f.parameter
        if not p.period and p.null is not None:
            total += log_inside(p, value + change, sqrt(v)) - f.prior_inside()
    return total


def _limited(hypothesis: Hypothesis, step: Float[np.ndarray, " m"]) -> Hypothesis:
    """A step held within bounds and within what the linear equations can be trusted for."""
    unknowns, now = hypothesis.unknowns(), hypothesis.vector()
    reach = 1.0
    for f, change, value in zip(unknowns, step, now, strict=True):
        p = f.parameter
        usual = max(p.spread, f.prior_sd(value))
        largest = MAX_STEP_DEG if p.period else (MAX_STEP_S if p.is_time else MAX_STEP_SDS * usual)
        reach = min(reach, largest / max(abs(change), 1e-12))
    moved = now + reach * step
    for k, f in enumerate(unknowns):
        # A speed below zero toward a direction is one above zero toward the opposite.
        if f.parameter.period:
            sizes = [
                j for j, g in enumerate(unknowns) if g.effect == f.effect and g.parameter.null == g.parameter.low == 0
            ]
            turned = [j for j in sizes if moved[j] < unknowns[j].parameter.low and not unknowns[j].parameter.form]
            moved[turned] *= -1
            moved[k] += 180.0 * bool(turned)
    return hypothesis.within_bounds(moved)
