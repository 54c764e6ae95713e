"""Tests that a named effect must pass, and effects that these recordings cannot tell from it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from manoeuvre_nn.diagnosis.advise import apart
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns, hypothesis_columns
from manoeuvre_nn.numerics.finite_algebra import lstsq

MAX_FORM_SDS = 4.0
"""Prior standard deviations by which an uncertain part of a formula may be off: chance exceeds it in one of 16,000."""
ON_BOUNDS, FORM, LEFT = "parameters off their bounds", "the formula is as published", "little is left"
"""Names of three tests."""
BEGINS_ANEW = "it does not begin anew with each run"
"""Name of the test of what each run has of its own."""
MIN_CHANCE_OF_ZEROS = 1e-3
"""Chance that a value which each run has of its own is so near to 0 in all of them, from which it is not believed."""
ANY_FORCE = "events at any times come near to any force, and held-out runs are not sailed with these"
"""Why a claim gives way that stands again where nothing else passes."""
NO_LESS = "no less is left than in calm water"
"""Why a claim of events does not even then; of others it is one reason of several."""
SIZE_CONFIDENCE = 1 - 0.01 / 25
"""Confidence, 3.5 standard errors of one number, at which the sizes of an effect must not be those of none: in fewer
than 1 % of cases one of some 25 candidates that do not act is so large. The log evidence that is asked for, 5, takes as
much (``z^2 / 2`` less what the width of the prior costs): values that are less clear, averaged over what else may be,
do not bear it out."""
INDISTINGUISHABLE = 9.0
"""Expected gap, twice the log evidence, below which two effects are reported together."""


def checks(tried: SearchResult, chosen: FittedHypothesis) -> list[Check]:
    """Everything that a claim must pass besides its probability."""
    found = [_off_bounds(chosen), _as_published(chosen), _little_left(tried, chosen), _same_in_all_runs(tried, chosen)]
    return [*found, *_goes_on(chosen)]


def only_nearest(claim: FittedHypothesis, checks: Sequence[Check], more_left: bool = False) -> str:
    """Why a claim is only the nearest to something else.

    Args:
        claim: It.
        checks: Tests that it was put to.
        more_left: Whether more is left of the missing force than in calm water (:func:`more_is_left`).

    Returns:
        Empty, but in five cases. It begins anew with every recording, as an error of a recorder does. Its numbers are
        at an end of what is possible, and beside it coefficients would have to be another ship's. They are, or its
        formula is off what is published, and more is left of the missing force than in calm water, so that free runs
        may miss by anything, or as much, and free runs of held-out manoeuvres miss by more than is unknown. Or they
        miss so, and all of it are events: with times of their own in every run these come near to any force, the more
        so where they leave as much of it as calm water (:data:`NO_LESS`). Or its formula is off what is published, and
        coefficients need not be: they are where an effect is large and of another form, and of a model that was fitted
        nobody asks.
    """
    failed = {check.name for check in checks if not check.passed}
    if BEGINS_ANEW in failed:
        return "it begins at 0 with every recording"
    if {ON_BOUNDS, RIGHT_SHIP} <= failed:
        return "its numbers are at an end of what is possible, and beside it this is not the ship"
    if failed & {ON_BOUNDS, FORM} and (more_left or {LEFT, REPAIRED_SAILS} <= failed):
        return f"its numbers are at an end of what is possible or published, and {NO_LESS}"
    if REPAIRED_SAILS in failed and claim.names and all(effect.timed for effect in claim.hypothesis.effects):
        return f"{ANY_FORCE}, and {NO_LESS}" if LEFT in failed else ANY_FORCE
    if FORM in failed and any(check.name == RIGHT_SHIP and check.passed for check in checks):
        return "its formula is not as published, though this ship's coefficients may be"
    return ""


def _off_bounds(chosen: FittedHypothesis) -> Check:
    """Parameters on a bound are a sign of the wrong effect."""
    on = [f"{f.parameter.name} = {value:.3g} {f.parameter.unit}" for f, value in chosen.hypothesis.on_bounds()]
    return Check(ON_BOUNDS, not on, f"on a bound: {', '.join(on)}" if on else "all parameters are inside their bounds")


def _as_published(chosen: FittedHypothesis) -> Check:
    """A formula further off than published ones are is another one."""
    off = [f"{name} by {sds:.1f} standard deviations" for name, sds in _forms_off(chosen)]
    told = f"off what is published: {', '.join(off)}" if off else f"no part of it is {MAX_FORM_SDS:g} errors off"
    return Check(FORM, not off, told)


def _forms_off(chosen: FittedHypothesis) -> list[tuple[str, float]]:
    """Uncertain parts of formulas that are further off than chance explains, over their prior standard deviation."""
    numbers = zip(chosen.hypothesis.unknowns(), chosen.hypothesis.vector().tolist(), strict=True)
    forms = [(f.parameter.name, abs(value - f.mean(value)) / f.spread) for f, value in numbers if f.parameter.form]
    return [(name, sds) for name, sds in forms if sds > MAX_FORM_SDS]


def chance_of_nothing(fitted: FittedHypothesis, effect: int, held_out: float = 0.0) -> float:
    """How often sizes as far from those at which an effect vanishes are found where it does: by ``x^T C^-1 x``.

    Its chi-square has a degree of freedom for each size and for each direction, of which there is none without a size.

    Args:
        fitted: A hypothesis, averaged over what else may be: at other noise than the likeliest the sizes may be others.
        effect: Number of the effect.
        held_out: Log evidence that it adds at these sizes in runs that it was not fitted to: as much as half a square
            says. Where an effect vanishes, square and twice that together reach a limit no more often than the square
            alone, however well the other runs know the sizes.

    Returns:
        A probability; 0 for gusts, whose mean may be small beside them, and for what has no such size (a depth).
    """
    h = fitted.hypothesis
    own = [(k, f.parameter) for k, f in enumerate(h.unknowns()) if f.effect == effect]
    sizes = {k: p.null for k, p in own if not (p.null is None or p.form or p.period)}
    if not sizes or h.effects[effect].random:
        return 0.0
    at = list(sizes)
    off = h.vector()[at] - list(sizes.values())
    square = float(off @ lstsq(fitted.covariance[np.ix_(at, at)], off))
    # The length of a vector whose direction was looked for, too, is that of two numbers.
    degrees = len(at) + sum(bool(p.period) for _, p in own)
    return float(chi2.sf(square + 2 * held_out, degrees))


def may_be_nothing(fitted: FittedHypothesis, effect: int, held_out: float = 0.0) -> bool:
    """Whether all sizes of an effect are within their errors of those at which it vanishes (SIZE_CONFIDENCE)."""
    return chance_of_nothing(fitted, effect, held_out) > 1 - SIZE_CONFIDENCE


def _little_left(tried: SearchResult, chosen: FittedHypothesis) -> Check:
    """What stays unexplained should be small against what was explained."""
    before, after = _left(tried, tried.none), _left(tried, chosen)
    text = (
        f"a random force of {100 * after:.2g} % of the resistance and of the force of 20 deg of rudder is left, "
        f"{100 * before:.2g} % in calm water"
    )
    return Check(LEFT, after < 1.5e-2 or after < before, text)


def _goes_on(chosen: FittedHypothesis) -> list[Check]:
    """What changes along a run and has another value at the beginning of each, a tide's stream, is seldom 0 in all."""
    h = chosen.hypothesis
    numbers = zip(h.unknowns(), h.vector().tolist(), np.sqrt(np.diag(chosen.covariance)).tolist(), strict=True)
    # Weights of a formula are its sizes: it does not act where they are 0.
    named = [one for one in numbers if h.effects[one[0].effect].name != Formula.name]
    own = [(f, abs(value) + 2 * sd) for f, value, sd in named if f.parameter.per_run and f.parameter.null == 0.0]
    if not own:
        return []
    # p(|x| < most) by the density of the prior at 0
    chance = float(np.prod([min(2 * most / (np.sqrt(2 * np.pi) * f.prior_sd(0.0)), 1.0) for f, most in own]))
    told = (
        f"{own[0][0].parameter.name}: probability {chance:.2g} of being so near to 0 as each of {len(own)} runs begins"
    )
    return [Check(BEGINS_ANEW, chance > MIN_CHANCE_OF_ZEROS, told)]


def _left(tried: SearchResult, j: FittedHypothesis) -> float:
    """Process noise beside a hypothesis, over the resistance and the force of 20 deg of rudder."""
    # The course of gusts is integrated out where they were found, and taken for a random force about own states.
    best = next((found.best for found in tried.fitted if found.random and found.names == j.names), j.best)
    return float(tried.likelihood.data_set.levels[best[0]].max())


def more_is_left(tried: SearchResult, chosen: FittedHypothesis) -> bool:
    """Whether a claim leaves more of the missing force than calm water does."""
    return _left(tried, chosen) > _left(tried, tried.none)


def _same_in_all_runs(tried: SearchResult, chosen: FittedHypothesis) -> Check:
    """Estimates from one run at a time must agree: a stranger posing as this effect changes from run to run."""
    data_set, h = tried.likelihood.data_set, chosen.hypothesis
    if len(data_set.runs) < 2:
        return Check("same in all runs", True, "one run only: not tested")
    lin = hypothesis_columns(data_set, h)
    estimates = [_alone(data_set, lin, run, chosen.best) for run in range(len(data_set.runs))]
    weights = [np.linalg.inv(c) for _, c in estimates]
    total = np.linalg.inv(sum(weights))  # type: ignore[arg-type]
    mean = total @ sum(w @ m for (m, _), w in zip(estimates, weights, strict=True))
    chi = float(sum((m - mean) @ w @ (m - mean) for (m, _), w in zip(estimates, weights, strict=True)))
    degrees = len(mean) * (len(estimates) - 1)
    return Check(
        "same in all runs",
        bool(chi < degrees + 6 * np.sqrt(2 * degrees)),
        f"chi-square {chi:.1f} for {degrees} degrees of freedom",
    )


def _alone(
    data_set: WhitenedDataSet, lin: HypothesisColumns, run: int, best: tuple[int, int]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Step and covariance of the parameters that all runs share, from one run alone."""
    level, scatter = best
    here = data_set.at(level)
    both = here.base[run].joined(here.white[run].embed(lin.columns[run]))
    gram = lin.turn(run, both.dot(both), gram=True)
    whole = 2 + data_set.combinations  # stands behind the data, coefficients and latency
    free = [lin.hypothesis.unknowns()[k - 1] for k in lin.index[run][1:]]
    prior = np.r_[data_set.nuisance_sd(scatter, runs=1), 3 * lin.hypothesis.prior_sds()[lin.index[run][1:] - 1]]
    keep = np.r_[1:whole, whole + 1 : len(gram)]
    covariance = np.linalg.inv(gram[np.ix_(keep, keep)] + np.diag(prior**-2.0))
    at = [whole - 1 + k for k, f in enumerate(free) if not (f.parameter.per_run or f.parameter.form)]
    return (covariance @ (gram[0] - gram[whole])[keep])[at], covariance[np.ix_(at, at)]


def aliases(tried: SearchResult, chosen: FittedHypothesis) -> dict[str, list[str]]:
    """For every effect that was found, those that could have produced it: the gap between them would hardly show.

    The rival takes the effect's place beside the others that were found; its numbers, theirs, the coefficients and the
    latency are fitted again.

    Returns:
        Effect -> names of its rivals; effects without one are left out.
    """
    singles = {j.names[0]: j for j in tried.fitted if len(j.names) == 1}
    evidence = {frozenset(j.names): j.evidence for j in reversed(tried.fitted)}
    named = frozenset(chosen.names) & frozenset(singles)
    least = evidence.get(named, -np.inf) - INDISTINGUISHABLE
    found: dict[str, list[str]] = {}
    for name in chosen.names:
        others = _without(chosen.hypothesis, name, frozenset(singles))
        for rival, fitted in singles.items():
            lost = evidence.get(named - {name} | {rival}, np.inf) < least  # what was tried in its place and fell behind
            if name not in named or rival in named or lost:
                continue
            swapped = others.joined(fitted.hypothesis)
            if 2 * apart(tried.likelihood.data_set, chosen.hypothesis, swapped, chosen.best) < INDISTINGUISHABLE:
                found.setdefault(name, []).append(rival)
    return found


def _without(hypothesis: Hypothesis, name: str, fitted: frozenset[str]) -> Hypothesis:
    """A hypothesis without one of its effects; what was not fitted by itself (a network) is held at its values."""
    left = hypothesis.without(hypothesis.names.index(name))
    held = {p.name for e in left.effects if e.name not in fitted for p in e.declared}
    return replace(left, fixed=hypothesis.fixed | held)
