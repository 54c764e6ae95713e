"""Hypotheses about what was left out: effects with values, and what the recordings say of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import lgamma, log, pi, sqrt

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect, Parameter

NUMBER_OF_INTERVALS = (0.3, 0.5, 0.15, 0.05)
"""Prior probability that an event happens never, once, twice, three times in a run."""
STOPS = 0.25
"""Prior probability that what may last to the end of a run ends before."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects with values.

    Attributes:
        effects: The effects, prototypes without values of their own.
        values: Parameter values of each effect, one row a run; parameters that are not per run are equal in all rows.
            A time that is inf is none: it never comes, and is no unknown.
        fixed: Names of parameters that are held at their values.
    """

    effects: tuple[Effect, ...]
    values: tuple[Float[np.ndarray, "runs _"], ...]
    fixed: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    def unknowns(self) -> list["_Unknown"]:
        """All free numbers: effect, parameter, and the run for those that differ between runs."""
        found = []
        for k, effect in enumerate(self.effects):
            for j, p in enumerate(effect.declared):
                # The course of a random process is integrated out: its parameters have no column of their own.
                if p.random or p.name in self.fixed:
                    continue
                happens = np.flatnonzero(np.isfinite(self.values[k][:, j])).tolist()
                found += [_Unknown(k, j, run, p) for run in (happens if p.per_run else [None])]
        return found

    def vector(self) -> Float[np.ndarray, " m"]:
        """Values of the free numbers."""
        return np.array([self.values[f.effect][f.run or 0, f.column] for f in self.unknowns()])

    def log_prior_of_times(self, durations: Sequence[float]) -> float:
        """Log prior of how often events happen in each run, and of their times beside flat priors within their bounds.

        ``p(k intervals) (2 k)! / T^(2 k)``: times are in order, and anywhere in a run of duration T.

        Args:
            durations: Of the runs [s].

        Returns:
            0 without an event whose times are free.
        """
        total = 0.0
        for effect, values in zip(self.effects, self.values, strict=True):
            timed = [j for j, p in enumerate(effect.declared) if p.per_run and p.name not in self.fixed]
            ranges = np.array([effect.declared[j].high - effect.declared[j].low for j in timed])
            may_last = len(timed) > 1 and np.isinf(effect.declared[timed[1]].starts[0])
            for row, duration in zip(values[:, timed], durations if timed else (), strict=bool(timed)):
                known = np.isfinite(row)
                number = int(known[::2].sum())
                total += log(NUMBER_OF_INTERVALS[number]) + lgamma(1 + known.sum())
                total += float(np.log(ranges[known] / duration).sum())
                if may_last and number:
                    total += log(STOPS if known[1] else 1 - STOPS)
        return total

    def with_vector(self, vector: Float[np.ndarray, " m"]) -> "Hypothesis":
        """The hypothesis at other values.

        Args:
            vector: Values of the free numbers.

        Returns:
            A new hypothesis.
        """
        values = [v.copy() for v in self.values]
        for f, value in zip(self.unknowns(), vector, strict=True):
            values[f.effect][slice(None) if f.run is None else f.run, f.column] = value
        return replace(self, values=tuple(values))

    def of_runs(self, rows: Sequence[int]) -> "Hypothesis":
        """The hypothesis about other runs, each with the values of one of these."""
        return replace(self, values=tuple(v[list(rows)] for v in self.values))

    def joined(self, other: "Hypothesis") -> "Hypothesis":
        """Both sets of effects together."""
        return replace(self, effects=self.effects + other.effects, values=self.values + other.values)


@dataclass(frozen=True)
class _Unknown:
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
        """Prior mean; a flat prior has it wherever the value is."""
        p = self.parameter
        return value if p.null is None or p.period or p.per_run else p.null


@dataclass(frozen=True)
class FittedHypothesis:
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
