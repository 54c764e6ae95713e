"""Hypotheses about what was left out: effects with values, and what the recordings say of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import atan, lgamma, log, pi, sqrt

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr

from manoeuvre_nn.core.effect import Effect, Parameter

NUMBER_OF_INTERVALS = (0.3, 0.5, 0.15, 0.05)
"""Prior probability that an event happens never, once, twice, three times in a run."""
STOPS = 0.25
"""Prior probability that what may last to the end of a run ends before."""
MEDIAN_OF_GAUSSIAN = 0.6745
"""Median size of a Gaussian number over its standard deviation."""
LEAST_LENGTH = 1e-3
"""Length of a vector over the scale of its prior that is told from none."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with values.

    Attributes:
        effects: The effects, prototypes without values of their own.
        values: Parameter values of each effect, one row a run; parameters that are not per run are equal in all rows of
            a campaign.
            A time that is inf is none: it never comes, and is no unknown.
        fixed: Names of parameters that are held at their values.
        campaigns: Number of each run's campaign: what is not per run has a value for each of them. Empty is one.
    """

    effects: tuple[Effect, ...]
    values: tuple[Float[np.ndarray, "runs _"], ...]
    fixed: frozenset[str] = frozenset()
    campaigns: tuple[int, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    def unknowns(self) -> list["_Unknown"]:
        """All free numbers: effect, parameter, and the runs that they belong to."""
        return list(self._free)

    @cached_property
    def _free(self) -> tuple["_Unknown", ...]:
        """The same, found once: values are not changed after they were given."""
        found = list[_Unknown]()
        for k, effect in enumerate(self.effects):
            for j, p in enumerate(effect.declared):
                # The course of a random process is integrated out: its parameters have no column of their own.
                if p.random or p.name in self.fixed:
                    continue
                happens = np.flatnonzero(np.isfinite(self.values[k][:, j])).tolist()
                groups = [(run,) for run in happens] if p.per_run else self._groups(len(self.values[k]))
                found += [_Unknown(k, j, runs, p) for runs in groups]
        return tuple(found)

    def on_bounds(self) -> list[tuple["_Unknown", float]]:
        """Free numbers that stand on a bound, with their values; neither times nor the uncertain parts of formulas."""
        found = []
        for f, value in zip(self.unknowns(), self.vector().tolist(), strict=True):
            p = f.parameter
            low, high, null = np.isclose(
                value, [p.low, p.high, np.nan if p.null is None else p.null], rtol=1e-6, atol=1e-6 * p.spread
            )
            if (low or high) and not (null or p.form or p.per_run or p.period):
                found.append((f, value))
        return found

    def _groups(self, count: int) -> list[tuple[int, ...]]:
        """Runs of each campaign."""
        if not self.campaigns:
            return [tuple(range(count))]
        return [tuple(np.flatnonzero(np.array(self.campaigns) == c).tolist()) for c in sorted(set(self.campaigns))]

    def vector(self) -> Float[np.ndarray, " m"]:
        """Values of the free numbers."""
        return np.array([self.values[f.effect][f.runs[0], f.column] for f in self.unknowns()])

    def log_prior_of_times(self) -> float:
        """Log prior of how often events happen in each run, and of the order of their times.

        ``p(k intervals) (2 k)!``, beside ``1 / T^(2 k)`` of times anywhere in a run of duration T: :meth:`prior_sds`.

        Returns:
            0 without an event whose times are free.
        """
        total = 0.0
        for effect, values in zip(self.effects, self.values, strict=True):
            timed = [j for j in effect.timed if effect.declared[j].name not in self.fixed]
            may_last = len(timed) > 1 and np.isinf(effect.declared[timed[1]].starts[0])
            for row in values[:, timed] if timed else ():
                known = np.isfinite(row)
                number = int(known[::2].sum())
                total += log(NUMBER_OF_INTERVALS[number]) + lgamma(1 + known.sum())
                if may_last and number:
                    total += log(STOPS if known[1] else 1 - STOPS)
        return total

    def prior_sds(self, durations: Sequence[float] = ()) -> Float[np.ndarray, " m"]:
        """Prior standard deviations of the free numbers at their values, see :meth:`_Unknown.prior_sd`.

        Args:
            durations: Of the runs [s]: a time is one within its run. Else it is anywhere within its bounds.

        Returns:
            One a number.
        """
        sds = [f.prior_sd(v) for f, v in zip(self.unknowns(), self.vector(), strict=True)]
        for k, f in enumerate(self.unknowns()):
            if durations and f.parameter.is_time:
                sds[k] = durations[f.runs[0]] / sqrt(2 * pi)
        return np.array(sds)

    def prior_excess(self) -> float:
        """Log density of their priors over that of the Gaussians that stand for them, all together."""
        return sum(f.prior_excess(v) for f, v in zip(self.unknowns(), self.vector(), strict=True))

    def with_vector(self, vector: Float[np.ndarray, " m"]) -> "Hypothesis":
        """The hypothesis at other values.

        Args:
            vector: Values of the free numbers.

        Returns:
            A new hypothesis.
        """
        values = [v.copy() for v in self.values]
        for f, value in zip(self.unknowns(), vector, strict=True):
            values[f.effect][list(f.runs), f.column] = value
        return replace(self, values=tuple(values))

    def within_bounds(self, vector: Float[np.ndarray, " m"]) -> "Hypothesis":
        """The hypothesis at the values within their bounds that are nearest to others; directions turn round."""
        parameters = [f.parameter for f in self.unknowns()]
        held = [
            value % p.period if p.period else float(np.clip(value, p.low, p.high))
            for value, p in zip(vector, parameters, strict=True)
        ]
        return self.with_vector(np.array(held))

    def of_runs(self, rows: Sequence[int]) -> "Hypothesis":
        """The hypothesis about other runs, each with the values of one of these."""
        campaigns = tuple(self.campaigns[row] for row in rows) if self.campaigns else ()
        return replace(self, values=tuple(v[list(rows)] for v in self.values), campaigns=campaigns)

    def in_other_runs(self, rows: Sequence[int]) -> "Hypothesis":
        """The hypothesis about unknown runs, each with the numbers of one of these.

        Args:
            rows: Of each unknown run, which of these has its numbers.

        Returns:
            It; no event has a time there, and a size that is each run's own is its null.
        """
        other = self.of_runs(rows)
        for effect, values in zip(self.effects, other.values, strict=True):
            for column, p in enumerate(effect.declared):
                if p.per_run:
                    values[:, column] = np.inf if p.null is None else p.null
        return other

    def joined(self, other: "Hypothesis") -> "Hypothesis":
        """Both sets of effects together."""
        campaigns = self.campaigns or other.campaigns
        return replace(
            self, effects=self.effects + other.effects, values=self.values + other.values, campaigns=campaigns
        )

    def without(self, number: int) -> "Hypothesis":
        """The same without one of the effects, the others at their values."""
        k = number
        return replace(
            self, effects=self.effects[:k] + self.effects[k + 1 :], values=self.values[:k] + self.values[k + 1 :]
        )


@dataclass(frozen=True)
class _Unknown:
    """One free number of a hypothesis.

    Attributes:
        effect: Number of the effect.
        column: Number of its parameter.
        runs: The runs that it belongs to.
        parameter: What it is.
    """

    effect: int
    column: int
    runs: tuple[int, ...]
    parameter: Parameter

    @property
    def spread(self) -> float:
        """Usual size: what a number is rarely beyond unless something is far out of order."""
        return self.parameter.spread

    @property
    def heavy(self) -> bool:
        """Whether its prior is Cauchy's, see :attr:`.Parameter.heavy_tailed`."""
        p = self.parameter
        return p.heavy_tailed and not (p.null is None or p.form or p.period)

    @property
    def scale(self) -> float:
        """Half width gamma of a Cauchy prior whose median size is that of a Gaussian of the usual size.

        Half of all numbers are smaller than ``gamma``, half of all vectors in a plane than ``sqrt(3) gamma``.
        """
        median = MEDIAN_OF_GAUSSIAN * self.spread
        return median / sqrt(3) if self.parameter.vector else median

    def prior_sd(self, value: float) -> float:
        """Standard deviation of the Gaussian that stands for the prior at a value.

        Cauchy's ``p ~ 1 / (1 + x^2 / gamma^2)`` has the slope of a Gaussian of variance ``(gamma^2 + x^2) / 2``, a
        vector's ``p ~ (1 + x^2 / gamma^2)^(-3/2)`` that of one of ``(gamma^2 + x^2) / 3``. A flat prior over a range,
        or over the logarithm of a depth, is written as the Gaussian of equal height.

        Returns:
            The standard deviation, in the parameter's unit.
        """
        p = self.parameter
        if self.heavy:
            return sqrt((self.scale**2 + (value - self.mean(value)) ** 2) / (3 if p.vector else 2))
        if p.form or not p.heavy_tailed:
            return p.spread
        return (value * log(p.high / p.low) if p.low > 0 else p.high - p.low) / sqrt(2 * pi)

    def prior_excess(self, value: float) -> float:
        """Log density of the prior at a value over that of the Gaussian that stands for it.

        The length x of a vector has ``p(x) = 2 pi x / (2 pi gamma^2) (1 + x^2 / gamma^2)^(-3/2)``: there are as many
        vectors of a length as the circle is long.

        Returns:
            0 where the Gaussian is the prior.
        """
        if not self.heavy:
            return 0.0
        x, sd = value - self.mean(value), self.prior_sd(value)
        size = x / self.scale
        if self.parameter.vector:
            cauchy = log(max(size, LEAST_LENGTH) / self.scale) - 1.5 * log(1 + size**2)
        else:
            cauchy = -log(pi * self.scale) - log(1 + size**2)
        return cauchy + log(sqrt(2 * pi) * sd) + 0.5 * (x / sd) ** 2

    def prior_inside(self) -> float:
        """Log of the share of the prior that lies within the bounds."""
        p, mean = self.parameter, self.mean(0.0)
        if self.heavy and p.vector:
            return log(1 - 1 / sqrt(1 + (p.high / self.scale) ** 2))
        if self.heavy:
            low, high = (atan((bound - mean) / self.scale) / pi for bound in (p.low, p.high))
            return log(high - low)
        return log_inside(p, mean, p.spread)

    def mean(self, value: float) -> float:
        """Prior mean; a flat prior has it wherever the value is."""
        p = self.parameter
        return value if p.null is None or p.period else p.null


def log_inside(p: Parameter, mean: float, sd: float) -> float:
    """Log of the probability that a Gaussian lies within a parameter's bounds."""
    return float(log_ndtr((p.high - mean) / sd) if mean - p.low > p.high - mean else log_ndtr((mean - p.low) / sd))


@dataclass(frozen=True)
class FittedHypothesis:
    """A hypothesis after it has seen the recordings.

    Attributes:
        hypothesis: It, at its most likely values.
        evidence: Log marginal likelihood, noise levels summed out.
        by_level: The same at every level of the process noise, by level of the coefficients' standard deviation.
        covariance: Of the free numbers.
        misfit: Chi-square of the data at the best level.
        best: Both levels with the highest weight.
        corrections: Most likely sizes of :class:`.Corrections`, whatever combinations of them the runs were fitted by.
        latencies: Most likely latency of each run, less its prior mean [s].
        random: Sizes of random courses (gusts) with standard errors.
    """

    hypothesis: Hypothesis
    evidence: float
    by_level: Float[np.ndarray, "g s"] = field(repr=False)
    covariance: Float[np.ndarray, "m m"] = field(repr=False)
    misfit: float = 0.0
    best: tuple[int, int] = (0, 0)
    corrections: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0), repr=False)
    latencies: Float[np.ndarray, " runs"] = field(default_factory=lambda: np.zeros(0), repr=False)
    random: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.hypothesis.names

    @property
    def errors(self) -> Float[np.ndarray, " m"]:
        """Standard errors of the free numbers."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
