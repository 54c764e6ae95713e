"""Gusts: their course is random, so it is integrated out, and only their size is fitted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.fits import from_four_sides
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import beside_it, contribution
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns, hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, MarginalLikelihood, log_prior_levels
from manoeuvre_nn.estimation.noise_average import weighted_mean
from manoeuvre_nn.estimation.posterior import Posterior
from manoeuvre_nn.estimation.process_noise import markov_course, without_course
from manoeuvre_nn.estimation.relinearise import beside


@dataclass(frozen=True)
class _Gusts:
    """How a wind varies.

    Attributes:
        size: Standard deviation along the mean wind, over it or in m/s.
        memory: Correlation time [s].
        across: Standard deviation across the mean wind over that along it [-].
    """

    size: float
    memory: float
    across: float


AT_SEA = tuple(_Gusts(share, 30.0, 0.0) for share in (0.1, 0.13, 0.16, 0.2, 0.25, 0.32))
"""Sizes over the mean wind that are tried; smaller ones look like wrong load functions. They last 20 to 60 s."""
ON_PONDS = tuple(_Gusts(share, memory, 1.0) for memory in (10.0, 5.0) for share in (0.4, 0.7, 1.2))
"""The same near the ground among trees and banks, where winds turn as much as they swell: tried besides for models."""
KNOTS = 3.0
"""Knots of their course in a correlation time."""
MAX_PROCESS_BESIDE_GUSTS = 0.06
"""Largest process noise beside gusts: more would only compete with them."""
ROUNDS = 3
"""Fits of the mean wind with gusts, at most: they leave it less to explain than it had alone."""
MIN_GAIN_OF_ROUND = 0.5
"""Log evidence that one of them must add for the next."""
OTHER_MEMORIES = (0.5, 1.0, 2.0)
"""Correlation times over the usual one that sizes are averaged over: gusts at sea last 20 to 60 s."""
OTHER_SIZES = tuple(np.exp(np.linspace(-0.75, 0.75, 11)).tolist())
"""Sizes over the one that was found."""
T = TypeVar("T")


def fitted_gusts(likelihood: MarginalLikelihood, steady: FittedHypothesis, gusty: Effect) -> FittedHypothesis:
    """Fit a hypothesis with its steady wind replaced by a gusty one, at the most likely size of gusts.

    Args:
        likelihood: Where.
        steady: What was found with a steady wind. Gusts of a gale hide its mean from a fit that knows none: where the
            wind is all there is, it is tried from four sides besides.
        gusty: Prototype of the gusty wind.

    Returns:
        The fit, its evidence averaged over the sizes of gusts.
    """
    ship = likelihood.data_set.dynamics.particulars
    wind, kinds = steady.names.index(gusty.variant_of), AT_SEA + ON_PONDS if ship.is_model else AT_SEA
    level = _level_beside(likelihood.data_set, steady)
    # On ponds gusts are larger than the mean, which four sides do not find either.
    alone = len(steady.names) == 1 and not ship.is_model
    sides = from_four_sides(steady.hypothesis) if alone else []
    starts = [steady.hypothesis, *(likelihood.improve(side, *steady.best, rounds=3)[0] for side in sides)]

    def best(found: list[tuple[FittedHypothesis, _Gusts]]) -> FittedHypothesis:
        return max((j for j, _ in found), key=lambda j: j.evidence)

    found = max((_tried(likelihood, h, wind, kinds, level) for h in starts), key=lambda some: best(some).evidence)
    found = _repeated(lambda h: _tried(likelihood, h, wind, kinds, level), found, best)
    return _chosen(found, wind, gusty)


def _repeated(fit: Callable[[Hypothesis], T], found: T, best: Callable[[T], FittedHypothesis]) -> T:
    """What fits from where the last one ended come to, at most :data:`ROUNDS` of them and as long as they gain."""
    for _ in range(ROUNDS - 1):
        again = fit(best(found).hypothesis)
        if best(again).evidence < best(found).evidence + MIN_GAIN_OF_ROUND:
            break
        found = again
    return found


def refined_with_gusts(
    likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int, _: int = 0
) -> FittedHypothesis:
    """Fit a hypothesis with a gusty wind from values nearby, the course of its gusts integrated out at their size.

    Args:
        likelihood: Where.
        hypothesis: At values nearby.
        level: Level of the process noise beside the gusts.

    Returns:
        What came out.
    """

    def fit(h: Hypothesis) -> FittedHypothesis:
        return _with_gusts(beside(likelihood, h), h, level)

    return _repeated(fit, fit(hypothesis), lambda found: found)


def averaged_over_gusts(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> FittedHypothesis:
    """A fitted hypothesis with a gusty wind, averaged over sizes and correlation times of the gusts.

    Gusts that are thought to last half as long as they do seem smaller by a third: what a ship shows of them at once is
    their variance over their correlation time.

    Args:
        data_set: The runs about the states of the hypothesis.
        fitted: What was found there.

    Returns:
        The same evidence; other values, covariance, corrections, latencies and gusts. On ponds all is as it was: gusts
        take up other errors there, the more the shorter they are thought to last.
    """
    if data_set.dynamics.particulars.is_model:
        return fitted
    likelihood, h = beside(MarginalLikelihood(data_set), fitted.hypothesis), fitted.hypothesis
    wind, usual = _gusts_of(h)
    kinds = [
        replace(usual, size=usual.size * factor, memory=usual.memory * longer)
        for longer in OTHER_MEMORIES
        for factor in OTHER_SIZES
    ]
    found = _at_kinds(likelihood, h, wind, kinds, _level_beside(data_set, fitted), _most_beside(data_set))
    mixed, weights = weighted_mean(fitted, found)
    sizes = np.array([kind.size for kind in kinds])
    size, memory = float(weights @ sizes), float(np.exp(weights @ np.log([kind.memory for kind in kinds])))
    effect, values = h.effects[wind], list(mixed.hypothesis.values)
    names = [p.name for p in effect.declared]
    values[wind] = values[wind].copy()
    for name, value in zip(effect.random, (size, memory, usual.across), strict=True):
        values[wind][:, names.index(name)] = value
    return replace(
        mixed,
        hypothesis=replace(mixed.hypothesis, values=tuple(values)),
        random={effect.random[0]: (size, float(np.sqrt(weights @ (sizes - size) ** 2)))},
    )


def fainter_than_at_sea(fitted: FittedHypothesis) -> bool:
    """Whether gusts are smaller than the smallest at sea by more than two standard errors.

    Where the wind's load function is a little wrong at some angles the force differs as with faint gusts, in held-out
    runs too.

    Args:
        fitted: A hypothesis with a gusty wind, averaged over sizes and correlation times of its gusts.

    Returns:
        Compared with the least share of the mean wind in :data:`AT_SEA`. Over open sea turbulence has an intensity of
        .06 (1 + .043 U) at 10 m (ISO 19901-1, NORSOK N-003), .10 at U = 16 m/s.
    """
    h = fitted.hypothesis
    wind, _ = _gusts_of(h)
    size, error = fitted.random[h.effects[wind].random[0]]
    return size + 2 * error < AT_SEA[0].size * _mean_speed(h, wind)


def gusty_evidence(likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int) -> float:
    """Log evidence of a hypothesis with a gusty wind at its values, process noise about a level summed out."""
    return _with_gusts(likelihood, hypothesis, level).evidence


def _with_gusts(likelihood: MarginalLikelihood, hypothesis: Hypothesis, level: int) -> FittedHypothesis:
    """A hypothesis with a gusty wind after a linear step from its values, process noise about a level summed out."""
    wind, kind = _gusts_of(hypothesis)
    return _at_kinds(likelihood, hypothesis, wind, [kind], level)[0]


def _tried(
    likelihood: MarginalLikelihood, hypothesis: Hypothesis, wind: int, kinds: Sequence[_Gusts], level: int
) -> list[tuple[FittedHypothesis, _Gusts]]:
    """The hypothesis with gusts of every kind, their sizes in m/s."""
    least = float(likelihood.data_set.dynamics.particulars.sized([1.0], [0.5])[0])
    mean = max(_mean_speed(hypothesis, wind), least)
    sizes = [replace(kind, size=kind.size * mean) for kind in kinds]
    most = _most_beside(likelihood.data_set)
    return list(zip(_at_kinds(likelihood, hypothesis, wind, sizes, level, most), sizes, strict=True))


def _at_kinds(
    likelihood: MarginalLikelihood,
    hypothesis: Hypothesis,
    wind: int,
    kinds: Sequence[_Gusts],
    level: int,
    most: float = np.inf,
) -> list[FittedHypothesis]:
    """The hypothesis after a linear step, with gusts of every kind; process noise, from a level on, is summed out."""
    data_set, lin = likelihood.data_set, hypothesis_columns(likelihood.data_set, hypothesis)
    prior, courses = log_prior_levels(data_set, PROCESS_PRIOR), _courses(likelihood, hypothesis, wind, kinds)
    known: dict[int, list[Posterior]] = {}

    def score(at: int) -> float:
        if data_set.levels[at].max() > most:
            return -np.inf
        grams, norms = _without_courses(data_set, lin, courses, kinds, at)
        known[at] = [likelihood.regress(*both, hypothesis) for both in zip(grams, norms, strict=True)]
        return max(float((found.evidence + prior[at]).max()) for found in known[at])

    data_set.levels.uphill(level, score)
    each = [{at: found[k] for at, found in known.items()} for k in range(len(kinds))]
    return [likelihood.over_levels(hypothesis, of_kind, prior) for of_kind in each]


def _most_beside(data_set: WhitenedDataSet) -> float:
    """Largest process noise that gusts are tried beside; a fitted model may lack any force."""
    return np.inf if is_fitted(data_set.dynamics) else MAX_PROCESS_BESIDE_GUSTS


def _level_beside(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> int:
    """Level of the process noise from which on gusts are tried: a small one, or a fitted model's."""
    return fitted.best[0] if is_fitted(data_set.dynamics) else data_set.levels.quiet(fitted.best[0])


def _gusts_of(hypothesis: Hypothesis) -> tuple[int, _Gusts]:
    """Number of the gusty wind among a hypothesis' effects, and its gusts."""
    wind = next(k for k, e in enumerate(hypothesis.effects) if e.random)
    effect, names = hypothesis.effects[wind], [p.name for p in hypothesis.effects[wind].declared]
    return wind, _Gusts(*(float(hypothesis.values[wind][0, names.index(name)]) for name in effect.random))


def _mean_speed(hypothesis: Hypothesis, wind: int) -> float:
    """Speed of a wind among a hypothesis' effects without its gusts [m/s]."""
    names = [p.name for p in hypothesis.effects[wind].declared]
    return float(hypothesis.values[wind][0, names.index("speed")])


_Courses = list[dict[tuple[float, float], Columns]]
"""Of each run, what gusts of every correlation time and share across add."""


def _courses(likelihood: MarginalLikelihood, hypothesis: Hypothesis, wind: int, kinds: Sequence[_Gusts]) -> _Courses:
    """What the courses of all gusts add to each run."""
    runs, forms = range(len(likelihood.data_set.runs)), {(kind.memory, kind.across) for kind in kinds}
    return [{form: _course(likelihood, hypothesis, wind, run, *form) for form in forms} for run in runs]


def _without_courses(
    data_set: WhitenedDataSet, lin: HypothesisColumns, courses: _Courses, kinds: Sequence[_Gusts], level: int
) -> tuple[Float[np.ndarray, "k p p"], Float[np.ndarray, " k"]]:
    """Inner products and normalisers at a level of the process noise with the gusts' course integrated out."""
    size, here = data_set.size + lin.count, data_set.at(level)
    grams, norms = np.zeros((len(kinds), size, size)), np.full(len(kinds), here.norm)
    for run, (c, at) in enumerate(zip(lin.columns, lin.index, strict=True)):
        where = np.concatenate([data_set.base_index(run), data_set.size + at])
        white = here.white[run]
        both = here.base[run].joined(white.embed(c))
        loose = {form: white.embed(course) for form, course in courses[run].items()}
        whole = lin.turn(run, both.dot(both), gram=True)
        inner = {form: (e.dot(e), lin.turn(run, both.dot(e)).T) for form, e in loose.items()}
        for k, kind in enumerate(kinds):
            own, cross = inner[kind.memory, kind.across]
            left, norm = without_course(whole, own, cross, kind.size)
            grams[k][np.ix_(where, where)] += left
            norms[k] += norm
    return grams, norms


def _chosen(found: list[tuple[FittedHypothesis, _Gusts]], wind: int, gusty: Effect) -> FittedHypothesis:
    """The best size, by a parabola through the three best on a logarithmic scale, as a hypothesis of its own."""
    scores = np.array([j.evidence for j, _ in found])
    k = int(scores.argmax())
    fitted, best = found[k]
    size, error = best.size, 0.5 * best.size
    beside = [gusts for _, gusts in found[max(k - 1, 0) : k + 2]]
    if len(beside) == 3 and len({(g.memory, g.across) for g in beside}) == 1:
        curve = np.polyfit(np.log([g.size for g in beside]), scores[k - 1 : k + 2], 2)
        size, error = float(np.exp(-0.5 * curve[1] / curve[0])), float(size / np.sqrt(-2 * curve[0]))
    values, steady = list(fitted.hypothesis.values), fitted.hypothesis.effects[wind]
    old, names = values[wind], [p.name for p in steady.declared]
    random = dict(zip(gusty.random, (size, best.memory, best.across), strict=True))
    columns = [old[:, names.index(p.name)] if p.name in names else random[p.name] for p in gusty.declared]
    values[wind] = np.stack(np.broadcast_arrays(*columns, old[:, 0])[:-1], axis=-1)
    effects = tuple(gusty if n == wind else e for n, e in enumerate(fitted.hypothesis.effects))
    # Averaged over the sizes, not the best of them: trying many sizes must not pay.
    evidence = float(logsumexp(scores)) - float(np.log(len(scores)))
    return replace(
        fitted,
        hypothesis=replace(fitted.hypothesis, effects=effects, values=tuple(values)),
        evidence=evidence,
        random={gusty.random[0]: (size, error)},
    )


def _course(
    likelihood: MarginalLikelihood, hypothesis: Hypothesis, wind: int, run: int, memory: float, across: float
) -> Columns:
    """Columns of gusts of 1 m/s along the wind, and across it if wanted: hat functions with independent amplitudes."""
    prepared, effect = likelihood.data_set.runs[run], hypothesis.effects[wind]
    names = [p.name for p in effect.declared]
    speed, direction = names.index("speed"), names.index("from_deg")
    nudge = float(likelihood.data_set.dynamics.particulars.sized([0.5], [0.5])[0])
    sets = np.tile(effect.steady(hypothesis.values[wind][run]), (3, 1))
    mean = max(sets[0, speed], nudge)
    sets[1, speed] += nudge
    sets[2, direction] += np.degrees(nudge / mean)
    beside = beside_it(hypothesis.effects, [v[run] for v in hypothesis.values], wind, prepared.linearised)
    c = contribution(effect, sets, prepared.linearised, beside=beside)
    pushes = (c.moved[..., 1:] - c.moved[..., :1]) / nudge
    time = prepared.linearised.run.time[1:] - 0.5 * prepared.linearised.run.step
    course = markov_course(time, memory / KNOTS, memory)[:, None, :]
    moved = np.concatenate([pushes[:, :, [k]] * a * course for k, a in ((0, 1.0), (1, across)) if a], axis=-1)
    return Columns(np.zeros((len(time) + 1, c.measured.shape[1], moved.shape[-1])), moved)
