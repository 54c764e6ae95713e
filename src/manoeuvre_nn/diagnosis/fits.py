"""Fits of one hypothesis: from several starts, at the noise that it leaves, about the states that it implies."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from math import inf

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.windows import EventGrid, replaced
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import USUAL_LEVELS, MarginalLikelihood
from manoeuvre_nn.estimation.noise_average import weighted_mean
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.estimation.relinearise import (
    FAR_FROM_REST,
    MAX_FAR_PASSES,
    MAX_PASSES,
    STATES_AT_REST,
    beside,
    change_of_states,
    refined,
)

MAX_FIRST_DEFICIT = 30.0
"""Log evidence by which a candidate may lie behind calm water after its first fit, made at calm water's noise."""
MAX_STARTS = 4
"""Starts of an effect that are all fitted from: a linear step tells badly where a depth or a play leads."""
WORSE = 1.0
"""Log density by which the mean over all levels of noise may be less likely than the values that were fitted."""
SAME_FIT = 0.5
"""Difference of all values over their standard errors below which two fits come to rest at one place."""
PUBLISHED_SD_LEVEL = 2
"""Level of the coefficients' standard deviation that published sets have, 3 %."""
TURNS = (-45.0, 45.0, 180.0)
"""How far directions are turned to look for another place where a fit rests [deg]."""
MAX_OF_OTHER = 5.0
"""Log evidence by which such a place may lie behind to count for values and standard errors."""
Fit = Callable[[MarginalLikelihood, Hypothesis, int, int], FittedHypothesis]
"""Likelihood, hypothesis at values nearby, levels of the process noise and of the coefficients -> the fit."""


def single(likelihood: MarginalLikelihood, effect: Effect, none: FittedHypothesis) -> FittedHypothesis:
    """Fit one effect alone, from the noise levels of calm water and from those at which it must explain the misfit.

    Where calm water calls a large effect wrong coefficients, a fit that begins there stays where the effect is small.

    Returns:
        The better of the two.
    """
    found = list[FittedHypothesis]()
    noises = [(PROCESS_LEVELS.quiet(none.best[0]), min(none.best[1], PUBLISHED_SD_LEVEL))]
    if not effect.timed and none.best not in noises:  # events are placed where they must explain the misfit anyway
        noises.append(none.best)
    for level, scatter in noises:
        starts = _starts(likelihood, effect, level, scatter)
        tried = [likelihood.improve(_in_form(likelihood, h, level, scatter), level, scatter, rounds=3) for h in starts]
        best = max(tried, key=lambda t: t[1])[0]
        if found and _within_errors(best, found[0]):
            break  # it would come to rest where the first fit did
        found.append(refine(likelihood, best, level, scatter, none.evidence - MAX_FIRST_DEFICIT))
    return max(found, key=lambda j: j.evidence)


def _within_errors(values: Hypothesis, fitted: FittedHypothesis) -> bool:
    """Whether values are those of a fit of the same effects, each to a part of its standard error."""
    one, other = values.vector(), fitted.hypothesis.vector()
    return len(one) == len(other) and bool((np.abs(one - other) < SAME_FIT * fitted.errors).all())


def _in_form(likelihood: MarginalLikelihood, start: Hypothesis, level: int, scatter: int) -> Hypothesis:
    """A start whose form suits its size: else a fit would leave a right size for the sake of a wrong form."""
    (effect,) = start.effects
    sizes = frozenset(p.name for p in effect.declared if not p.form)
    if len(sizes) == len(effect.declared) or effect.timed or effect.random:
        return start
    return replace(likelihood.improve(replace(start, fixed=sizes), level, scatter, rounds=2)[0], fixed=start.fixed)


def _starts(likelihood: MarginalLikelihood, effect: Effect, level: int, scatter: int) -> list[Hypothesis]:
    """All starts, of many the two most promising by what a linear step from each would gain; windows of an event."""
    data_set = likelihood.data_set
    if effect.timed:
        events = EventGrid(likelihood, effect).best_windows(level, scatter)
        return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in events]
    grid = np.array(list(product(*[(p.null,) if p.form else p.starts for p in effect.declared])), dtype=float)
    made = np.tile(grid[:, None], (1, len(data_set.runs), 1))
    if len(grid) <= MAX_STARTS:
        return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in made]

    def scores(values: Float[np.ndarray, "k runs p"]) -> Float[np.ndarray, " k"]:
        each = [Hypothesis((effect,), (v,), campaigns=data_set.campaigns) for v in values]
        found = [likelihood.posterior(likelihood.columns(h), level).evidence[scatter] for h in each]
        return np.array(found)

    # What acts in one campaign is another thing than what acts in the next: each on its own, nothing in the others.
    best = np.empty((2, len(data_set.runs), grid.shape[1]))
    for number in set(data_set.campaigns) or {0}:
        mine = np.array(data_set.campaigns or [0] * len(data_set.runs)) == number
        alone = np.where(mine[None, :, None], made, effect.null().numpy())
        best[:, mine] = made[np.argsort(scores(alone))[::-1][:2]][:, mine]
    return [Hypothesis((effect,), (values,), campaigns=data_set.campaigns) for values in best]


def sizes_of(effect: Effect) -> list[int]:
    """Numbers of an effect's parameters that are neither of its form, nor a direction, a time or random."""
    return [j for j, p in enumerate(effect.declared) if not (p.form or p.period or p.per_run or p.random)]


def from_four_sides(alone: Hypothesis) -> list[Hypothesis]:
    """An effect with a direction, alone, from four sides, its sizes at their first starts."""
    (effect,), values = alone.effects, alone.values[0].copy()
    direction, sizes = next(j for j, p in enumerate(effect.declared) if p.period), sizes_of(effect)
    values[:, sizes] = [effect.declared[j].starts[0] for j in sizes]
    sides = []
    for angle in range(0, 360, 90):
        values[:, direction] = angle
        sides.append(replace(alone, values=(values.copy(),)))
    return sides


def refine(
    likelihood: MarginalLikelihood,
    hypothesis: Hypothesis,
    level: int,
    scatter: int,
    min_evidence: float = -inf,
    placing: bool = True,
    fine: bool = True,
) -> FittedHypothesis:
    """Fit to the end, at the noise levels that the hypothesis itself leaves.

    Args:
        likelihood: Where.
        hypothesis: Roughly fitted.
        level: Level of the process noise to begin with.
        scatter: Level of the coefficients' standard deviation to begin with.
        min_evidence: Evidence below which it is not worked on.
        placing: Whether events are tried at times far from theirs.
        fine: Whether all levels of the process noise are looked at.

    Returns:
        What came out.
    """
    hypothesis, _ = beside(likelihood, hypothesis).improve(hypothesis, level, scatter)
    there = beside(likelihood, hypothesis)
    fitted = there.evaluate(hypothesis, around=level, fine=fine)
    if placing and fitted.evidence > min_evidence:
        # As long as an event has no time anywhere, coefficients that are off by far are called for in its place.
        noise = (level, scatter) if _unplaced(fitted.hypothesis) else fitted.best
        elsewhen = replaced(there, fitted.hypothesis, *noise)
        if elsewhen is not fitted.hypothesis:
            hypothesis, fitted = elsewhen, there.evaluate(elsewhen, around=fitted.best[0], fine=fine)
    for _ in range(2):
        if fitted.evidence < min_evidence:
            return fitted
        # Where the recordings do not change with a value, its mean is that of the prior, far from where it was fitted.
        here = beside(likelihood, hypothesis)
        stayed, moved = (here.improve(h, *fitted.best, rounds=1)[1] for h in (hypothesis, fitted.hypothesis))
        before = fitted if moved > stayed - WORSE else replace(fitted, hypothesis=hypothesis)
        hypothesis, _ = beside(likelihood, before.hypothesis).improve(before.hypothesis, *before.best, rounds=4)
        fitted = beside(likelihood, hypothesis).evaluate(hypothesis, around=before.best[0], fine=fine)
        if fitted.evidence < before.evidence + 0.1:
            return max(before, fitted, key=lambda j: j.evidence)
    return fitted


def over_directions(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> FittedHypothesis:
    """A fitted hypothesis averaged over the directions at which it rests.

    Where the ship turned little while a wind blew, another wind from elsewhere may do as well, if the uncertain parts
    of its formula give way.

    Args:
        data_set: The runs about its states.
        fitted: What was found there.

    Returns:
        The same evidence; other values and covariance where it rests elsewhere, too.
    """
    parts, h, likelihood = [fitted], fitted.hypothesis, MarginalLikelihood(data_set)
    for k, effect in enumerate(h.effects):
        free = {f.column for f in h.unknowns() if f.effect == k and f.parameter.period}
        for j, angle in product(sorted(free) if any(p.form for p in effect.declared) else (), TURNS):
            values = [v.copy() for v in h.values]
            values[k][:, j] += angle
            start, least = replace(h, values=tuple(values)), fitted.evidence - MAX_FIRST_DEFICIT
            found = refine(likelihood, start, *fitted.best, least, placing=False)
            near = found.evidence > fitted.evidence - MAX_OF_OTHER and len(found.errors) == len(fitted.errors)
            if near and all(_apart(found, other, k, j) for other in parts):
                parts.append(found)
    return weighted_mean(fitted, parts)[0] if len(parts) > 1 else fitted


def _apart(found: FittedHypothesis, other: FittedHypothesis, effect: int, column: int) -> bool:
    """Whether a direction of two fits differs by more than two standard errors: these are two places."""
    at = next(i for i, f in enumerate(found.hypothesis.unknowns()) if (f.effect, f.column) == (effect, column))
    difference = found.hypothesis.vector()[at] - other.hypothesis.vector()[at]
    return bool(abs((difference + 180.0) % 360.0 - 180.0) > 2 * max(found.errors[at], other.errors[at]))


def exchanged(likelihood: MarginalLikelihood, best: FittedHypothesis, number: int, other: Effect) -> FittedHypothesis:
    """A hypothesis with one effect in another form, from the values that both have and each start of the rest."""
    h = best.hypothesis
    known = {p.name: h.values[number][:, j] for j, p in enumerate(h.effects[number].declared)}
    tried = []
    for start in product(*[(0.0,) if p.name in known else p.starts for p in other.declared]):
        columns = [
            known.get(p.name, np.full(len(h.values[number]), s)) for p, s in zip(other.declared, start, strict=True)
        ]
        effects, values = list(h.effects), list(h.values)
        effects[number], values[number] = other, np.stack(columns, axis=1)
        started = replace(h, effects=tuple(effects), values=tuple(values))
        tried.append(likelihood.improve(started, *best.best, rounds=3))
    return refine(likelihood, max(tried, key=lambda found: found[1])[0], *best.best)


def _unplaced(hypothesis: Hypothesis) -> bool:
    """Whether an event acts in no run."""
    each = zip(hypothesis.values, hypothesis.effects, strict=True)
    return any(effect.timed and not np.isfinite(values[:, effect.timed]).any() for values, effect in each)


def at_rest(
    data_set: WhitenedDataSet, fitted: FittedHypothesis, fit: Fit | None = None
) -> tuple[WhitenedDataSet, FittedHypothesis]:
    """A hypothesis about its own states, linearised until they rest.

    Where a ship is unstable on course, corrected coefficients and the states by them may drive each other away from
    what was recorded, or the first states have them mend what is no fault of theirs, so that they are another ship's;
    then the states are sought by the published ones.

    Args:
        data_set: The runs about other states.
        fitted: What was found there.
        fit: How it is fitted about new states; None is :func:`refine`, and places events about the first ones alone.

    Returns:
        The runs about its states, and the hypothesis fitted to them.
    """
    start = beside(MarginalLikelihood(data_set), fitted.hypothesis).data_set
    there, found, moved = _passes(start, fitted, fit)
    driven_away = moved[-1] > min(moved) and found.evidence < fitted.evidence
    if moved[-1] > STATES_AT_REST and (driven_away or found.best[1] >= USUAL_LEVELS):
        published, other, less = _passes(start, fitted, fit, corrected=False)
        if less[-1] < moved[-1] and other.evidence > found.evidence:
            there, found = published, other
    return there, replace(found, random=fitted.random)


def _passes(
    data_set: WhitenedDataSet, fitted: FittedHypothesis, fit: Fit | None, corrected: bool = True
) -> tuple[WhitenedDataSet, FittedHypothesis, list[float]]:
    """Linearise about the states by corrected or published coefficients until they rest.

    Returns:
        The runs about the last states, the hypothesis there, and what states changed by in each pass.
    """
    moved, fine = list[float](), fit is not None
    while len(moved) < MAX_PASSES or (FAR_FROM_REST < moved[-1] < moved[-2] and len(moved) < MAX_FAR_PASSES):
        there = refined(data_set, fitted, corrected)
        moved.append(change_of_states(data_set, there, fitted.best[0]))
        if moved[-1] < STATES_AT_REST and (fine or len(moved) == 1):
            break
        # As long as states are on their way every third level of the noise will do.
        fine = fine or moved[-1] < STATES_AT_REST
        refit = fit or partial(refine, placing=len(moved) == 1, fine=fine)
        data_set, fitted = there, refit(MarginalLikelihood(there), fitted.hypothesis, *fitted.best)
    if not fine and len(moved) > 1:
        last = beside(MarginalLikelihood(data_set), fitted.hypothesis)
        fitted = last.evaluate(fitted.hypothesis, around=fitted.best[0])
    return data_set, fitted, moved


def fitted_at_rest(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> FittedHypothesis:
    """The hypothesis of :func:`at_rest` alone: the runs about its states are too large to be sent between processes."""
    return at_rest(data_set, fitted)[1]
