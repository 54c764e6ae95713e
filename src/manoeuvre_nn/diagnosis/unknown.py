"""The hypothesis that something acts which the shelf does not have.

It is calm water with everything loose that a name would tie down: process noise of any size, coefficients that are
off by more than the published scatter, and a short formula in the motion, the rudder, the heading and the instruments.
It wins where the misfit is real, repeats, and no name fits. Channels whose error is neither white nor a constant, a
scale or a lever arm are a fault of a sensor that the shelf does not have.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.special import logsumexp

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Columns, Embedded, IntegratedRun, joined, summed
from manoeuvre_nn.estimation.linearised_run import integrated
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, MarginalLikelihood, log_prior_levels
from manoeuvre_nn.estimation.prepared_run import PreparedRun, process_time, start_spread
from manoeuvre_nn.estimation.prior_average import gain_by_coefficient_priors
from manoeuvre_nn.estimation.process_noise import by_equation, markov_course, without_course

COLOURED = 4.0
"""Variance factor of a channel's slow errors from which its sensor is not trusted."""
KNOT_S, LONGEST_KNOT_S, MAX_KNOTS = 10.0, 30.0, 500
"""Time between the knots of a wander of the receiver [s]; at most, in long recordings; knots of all of them."""
MAX_CELLS = 3 * 10**7
"""Numbers of what the knots of a run add to its channels: 240 MB. Longer recordings are not asked."""
WANDER_TIMES_S, WHITE_SHARES = (30.0, 100.0, 300.0), (1.0, 0.5, 0.25)
"""Correlation times of a wander that are tried [s]; white noise over what the smoother takes for noise."""
USUAL_WANDER = (WHITE_SHARES[1], WANDER_TIMES_S[1:2])
"""The middle of both."""
RECEIVER_SD = 8.0 / 2.45
"""Error of a usual receiver north and east [m], which wanders for minutes: 8 m hold 95 % of its positions (GPS Standard
Positioning Service Performance Standard, 5th edition 2020), as 2.45 standard deviations do of two alike axes."""
WANDER_SDS = (0.3 * RECEIVER_SD, 0.6 * RECEIVER_SD, RECEIVER_SD)
"""Standard deviations of a wander that are tried [m], up to that of a usual receiver."""
SENSOR_PER_RUN = 12.0
"""Log evidence for a strange sensor of every run in which its error is coloured so."""
RANDOM_SIZES = (0.05, 0.15, 0.5)
"""Sizes from which a random force is tried, over the resistance and the force of 20 deg of rudder."""
MAX_RANDOM = 3.0
"""Largest random force, over the resistance and 20 deg of rudder."""
SHORTEST_RANDOM_S = 2.0
"""Shortest correlation time of a random force [s]; the longest is a run's length."""
MIN_GAIN_OF_EQUATION = 3.0
"""Log evidence for a random force in one equation more."""


@dataclass(frozen=True)
class RandomCourse:
    """A force without a rule: a first-order Markov process of its own size and correlation time.

    Attributes:
        axes: Equations that it acts in: 0 surge, 1 sway, 2 yaw; the clearest first.
        size: Standard deviation over the resistance and the force of 20 deg of rudder.
        time: Correlation time [s].
        errors: Relative standard errors of both.
        evidence: Log evidence.
    """

    axes: tuple[int, ...]
    size: float
    time: float
    errors: tuple[float, float]
    evidence: float


def random_force(
    likelihood: MarginalLikelihood, none: FittedHypothesis, levels: int = len(COEFFICIENT_SD_LEVELS)
) -> RandomCourse:
    """Fit size and correlation time of a random force, in the equation that it is clearest in.

    Everything else is as under the other hypotheses: states, coefficients, latency integrated out. Size and time have
    log-uniform priors and are integrated out by Laplace's method.

    Args:
        likelihood: The runs.
        none: Calm water.
        levels: How many of the levels of the coefficients' standard deviation are allowed, from the least.

    Returns:
        What came out.
    """
    grid = likelihood.data_set.levels
    process = _RandomProcess(likelihood, grid.quiet(none.best[0]), levels)
    start = np.log(process_time(likelihood.data_set.dynamics))
    tried = {
        (axis, size): process.evidence((axis,), np.array([np.log(size), start]))
        for axis, size in product(range(3), RANDOM_SIZES)
    }
    axis, size = max(tried, key=lambda k: tried[k])
    first = np.array([np.log(size), start])
    simplex = first + np.array([[0.0, 0.0], [0.6, 0.0], [0.0, 0.6]])
    found = minimize(
        lambda x: -process.evidence((axis,), x), first, method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": 30, "xatol": 0.05, "fatol": 0.1},
    )  # fmt: skip
    x, best = found.x, -found.fun
    h = 0.3 * np.eye(2)
    up, down, corner = (process.evidence((axis,), x + step) for step in (h[0], -h[0], h[0] + h[1]))
    later, sooner = (process.evidence((axis,), x + step) for step in (h[1], -h[1]))
    cross = (up + later - corner - best) / 0.09
    curvature = np.diag([2 * best - up - down, 2 * best - later - sooner]) / 0.09 + cross * (1 - np.eye(2))
    values, vectors = np.linalg.eigh(curvature)
    covariance = (vectors / np.maximum(values, 0.1)) @ vectors.T
    others = [b for b in range(3) if b != axis and process.evidence((axis, b), x) > best + MIN_GAIN_OF_EQUATION]
    prior = np.log(MAX_RANDOM / process.least) * np.log(process.longest / SHORTEST_RANDOM_S)
    # The noise that calm water keeps beside may have any size, too.
    beside = grid.uphill(process.level, lambda level: process.evidence((axis,), x, level))
    best = float(logsumexp(list(beside.values())))
    evidence = best + np.log(2 * np.pi / prior) + 0.5 * np.linalg.slogdet(covariance)[1] - np.log(3)
    errors = np.sqrt(np.diag(covariance))
    size, time = (float(v) for v in np.exp(x))
    return RandomCourse((axis, *others), size, time, (float(errors[0]), float(errors[1])), float(evidence))


class _RandomProcess:
    """Log evidence of random forces of any size and correlation time."""

    def __init__(self, likelihood: MarginalLikelihood, level: int, levels: int) -> None:
        """Take the runs, the level of the process noise that calm water keeps beside, how far coefficients are off."""
        data_set = likelihood.data_set
        self.likelihood, self.level = likelihood, level
        self.prior, self.least = log_prior_levels(data_set, PROCESS_PRIOR)[:, :levels], data_set.levels.sizes[0]
        self.longest = max(p.linearised.run.duration for p in data_set.runs)

    def evidence(self, axes: tuple[int, ...], x: Float[np.ndarray, " 2"], level: int | None = None) -> float:
        """Log evidence of a size and a correlation time, as logarithms; errors of coefficients summed over."""
        level = self.level if level is None else level
        low = np.log([self.least, SHORTEST_RANDOM_S])
        size, time = np.exp(np.clip(x, low, np.log([MAX_RANDOM, self.longest])))
        data_set, prior = self.likelihood.data_set, self.prior[level]
        sd = by_equation(data_set.levels[level], len(data_set.unit))
        sd[list(axes)] = np.hypot(sd[list(axes)], size)
        start = start_spread(data_set.dynamics)
        white = [integrated(p.linearised, p.noise, sd * data_set.unit, time, start) for p in data_set.runs]
        base = [w.embed(p.base) for w, p in zip(white, data_set.runs, strict=True)]
        gram = summed([e.dot(e) for e in base], [data_set.base_index(k) for k in range(len(base))], data_set.size)
        found = self.likelihood.regress(gram, sum(w.log_norm for w in white))
        outside = 10.0 * float(np.abs(x - np.log([size, time])).sum())
        return float(logsumexp(found.evidence[: len(prior)] + prior)) - outside


@dataclass(frozen=True)
class ReceiverWander:
    """A slow error of a satellite receiver, north and east alike: a first-order Markov process.

    Attributes:
        size: Its likeliest standard deviation [m].
        time: Its likeliest correlation time [s].
        evidence: Log evidence of the hypothesis with it, summed over all that was tried; minus infinity if none was.
    """

    size: float
    time: float
    evidence: float


def receiver_wander(
    likelihood: MarginalLikelihood,
    fitted: FittedHypothesis,
    levels: int = len(COEFFICIENT_SD_LEVELS),
    loose: bool = False,
) -> ReceiverWander:
    """Log evidence of a hypothesis at its values if positions have the slow error of a usual satellite receiver.

    North and east each have white noise, of which the smoother takes a wander for a part, and a first-order Markov
    process w of standard deviation s and correlation time T, ``cov w = s^2 exp(-|t| / T)``, by its values at knots and
    straight lines between. It is summed over s, T and the share of the noise that is white, each value alike likely,
    and over process noise.

    Args:
        likelihood: The runs.
        fitted: Calm water, or effects.
        levels: How many of the levels of the coefficients' standard deviation are allowed, from the least.
        loose: Whether any size of the process noise is as likely as others, as beside something unknown; else little
            is, as where physics is named.

    Returns:
        What came out. None was tried where no position was recorded, the recordings are hours long, or the model was
        fitted with its own noise.
    """
    data_set = likelihood.data_set
    spacing = max(KNOT_S, sum(p.linearised.run.duration for p in data_set.runs) / MAX_KNOTS)
    cells = max(p.base.measured[..., 0].size * 2 * p.linearised.run.duration / spacing for p in data_set.runs)
    recorded = any(p.linearised.present[:, :2].any() for p in data_set.runs)
    if is_fitted(data_set.dynamics) or not recorded or spacing > LONGEST_KNOT_S or cells > MAX_CELLS:
        return ReceiverWander(0.0, WANDER_TIMES_S[0], -np.inf)
    prior = log_prior_levels(data_set, None if loose else PROCESS_PRIOR)[:, :levels]
    base = [p.base for p in data_set.runs]
    if fitted.names:
        added = hypothesis_columns(data_set, fitted.hypothesis).columns
        base = [joined([b[:1] - c[:1], b[1:]]) for b, c in zip(base, added, strict=True)]

    def tried(level: int, share: float, times: Sequence[float]) -> Iterator[tuple[float, float, float]]:
        embedded, norm = _with_other_noise(data_set, base, level, share)
        for time in times:
            each = [_wander(e, white, p, spacing, time) for (e, white), p in zip(embedded, data_set.runs, strict=True)]
            for size in WANDER_SDS:
                left, added = zip(*(without_course(*one, size) for one in each), strict=True)
                gram = summed(left, [data_set.base_index(k) for k in range(len(left))], data_set.size)
                told = likelihood.regress(gram, norm + sum(added))
                yield float(logsumexp(told.evidence[:levels] + prior[level])), size, time

    def usual(level: int) -> float:
        return float(logsumexp([e for e, *_ in tried(level, *USUAL_WANDER)]))

    # Which process noise goes with it, one wander tells as well as all.
    start = fitted.best[0] if loose else data_set.levels.quiet(fitted.best[0])
    by_level = data_set.levels.uphill(start, usual)
    level = max(by_level, key=lambda g: by_level[g])
    found = [one for share in WHITE_SHARES for one in tried(level, share, WANDER_TIMES_S)]
    _, size, time = max(found)
    others = float(logsumexp(list(by_level.values()))) - by_level[level]
    return ReceiverWander(size, time, float(logsumexp([e for e, *_ in found]) - np.log(len(found))) + others)


def _with_other_noise(
    data_set: WhitenedDataSet, base: Sequence[Columns], level: int, share: float
) -> tuple[list[tuple[Embedded, IntegratedRun]], float]:
    """Base columns of each run and what whitens them, at a share of the noise of positions; their log normaliser."""
    sd, start, found = data_set.levels.sd(level, data_set.unit), start_spread(data_set.dynamics), []
    for p, columns in zip(data_set.runs, base, strict=True):
        noise = p.noise * np.r_[share, share, np.ones(len(p.noise) - 2)]
        white = integrated(p.linearised, noise, sd, data_set.process_time, start)
        found.append((white.embed(columns), white))
    return found, sum(white.log_norm for _, white in found)


def _wander(
    base: Embedded, white: IntegratedRun, prepared: PreparedRun, spacing: float, time: float
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "k k"], Float[np.ndarray, "k p"]]:
    """Inner products of a run's base, of a wander of its positions of size one, and of this with the base."""
    course = markov_course(prepared.linearised.run.time, spacing, time)
    measured, moved, count = prepared.base.measured, prepared.base.moved, course.shape[1]
    added = np.zeros((*measured.shape[:2], 2 * count))
    added[:, 0, :count] = added[:, 1, count:] = course
    own = white.embed(Columns(added, np.zeros((*moved.shape[:2], 2 * count))))
    return base.dot(base), own.dot(own), own.dot(base)


def unknown_evidence(
    likelihood: MarginalLikelihood,
    none: FittedHypothesis,
    formula: FittedHypothesis | None,
    calm: float | None = None,
    random: RandomCourse | None = None,
) -> float:
    """Log evidence of something unknown: any size of the process noise is as likely, and what is loose summed over.

    Args:
        likelihood: Of the runs about the states of calm water.
        none: Calm water.
        formula: A short formula for the unknown, if there is one, its evidence as it is to be weighed.
        calm: What calm water gains where no prior of coefficients is preferred
            (:func:`.gain_by_coefficient_priors`), if all else is weighed by what it gains beyond that.
        random: A random force in one equation, if it was looked for: it gains by that as calm water does.

    Returns:
        The log evidence; half of it stands on the formula if there is one, of what is left half on the random force.
    """
    data_set = likelihood.data_set
    loose = likelihood.evaluate(Hypothesis((), ()), process_prior=None, around=none.best[0])
    near = data_set.levels.beside(loose.best[0])
    more = 0.0 if calm is None else gain_by_coefficient_priors(data_set, none, near, None) - calm
    without = loose.evidence + more
    if random is not None:
        without = np.logaddexp(without, random.evidence) - np.log(2)
    found = np.array([without, -np.inf if formula is None else formula.evidence])
    return float(logsumexp(found - np.log(2))) + _strange_sensors(data_set)


def unknown_by_receiver(likelihood: MarginalLikelihood, none: FittedHypothesis) -> float:
    """Log evidence of something unknown without a short formula, seen by a receiver that wanders as usual ones do.

    Args:
        likelihood: Of the runs about the states of calm water.
        none: Calm water.

    Returns:
        As of :func:`unknown_evidence`, the receiver as in :func:`receiver_wander`. What is strange about a position or
        a speed, which the receiver may contradict, does not count.
    """
    wandering = receiver_wander(likelihood, none, loose=True).evidence
    return wandering - np.log(2) + _strange_sensors(likelihood.data_set, ("psi", "r"))


def _strange_sensors(data_set: WhitenedDataSet, among: Sequence[str] = MEASURED) -> float:
    """Evidence for channels whose error no candidate has: more than a stream or a sensor error of the smoother."""
    # A velocity that was taken from positions is no sensor's: the error of neighbouring samples is alike by making.
    sensed = [~np.isin(MEASURED[:-1], p.linearised.run.meta.get("derived", ())) for p in data_set.runs]
    factors = np.stack([p.inflation for p in data_set.runs])[:, : len(MEASURED) - 1] * np.array(sensed)
    # The noise was widened by what errors of a position wander: no more is strange about a receiver that is as good as
    # most.
    errors = np.stack([p.noise[:2] / np.sqrt(p.inflation[:2]) for p in data_set.runs])
    factors[:, :2] *= errors > RECEIVER_SD
    coloured = (factors > COLOURED)[:, np.isin(MEASURED[:-1], among)].sum(axis=0)
    return SENSOR_PER_RUN * float(coloured.max()) if 2 * coloured.max() >= len(factors) else 0.0
