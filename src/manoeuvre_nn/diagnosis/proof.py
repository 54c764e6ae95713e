"""The proof: what a claim predicts of runs that were not used, beside calm water and the recordings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.fits import at_rest, refine
from manoeuvre_nn.diagnosis.gusts import gusty_evidence
from manoeuvre_nn.diagnosis.repair import predict, predict_corrected, recorded
from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, same_campaigns
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import LATENCY
from manoeuvre_nn.estimation.prior_average import gain_by_coefficient_priors
from manoeuvre_nn.estimation.relinearise import beside
from manoeuvre_nn.scoring.free_runs import errors


def prove(
    question: Question, claim: FittedHypothesis, elsewhere: Hypothesis, known: Sequence[Proof] = ()
) -> list[Proof]:
    """Held-out runs predicted before and after.

    Args:
        question: What is asked.
        claim: What was found, effects and coefficients.
        elsewhere: It, in the held-out runs: see :func:`in_held_out_runs`.
        known: Proofs of something else, whose predictions in calm water are the same; without any, calm water predicts
            the same before and after.

    Returns:
        One proof a held-out run.
    """
    dynamics, runs, warmup = question.dynamics, question.case.held_out, question.case.warmup
    if not runs:
        return []
    befores = [p.before for p in known] or predict(dynamics, Hypothesis((), ()), runs, warmup)
    afters, alone = befores, list[pd.DataFrame]()
    if claim.names or known:
        latency = LATENCY + float(np.mean(claim.latencies))
        # Corrections within a fit's errors take up gusts of these runs, which others do not have.
        if not is_fitted(dynamics):
            shares = dynamics.hull.inertia.new_tensor(claim.corrections)
            alone, afters = predict_corrected(dynamics, shares, elsewhere, runs, warmup, latency)
            alone = alone if claim.names else []
        else:
            afters = predict(dynamics, elsewhere, runs, warmup, latency)
    made = []
    for k, (run, b, a) in enumerate(zip(runs, befores, afters, strict=True)):
        record = recorded(run, warmup)
        record = record.assign(delta=np.interp(record["t"], run.time, run["delta"]) / DEGREE)
        of_effects = errors(alone[k], record) if alone else {}
        made.append(Proof(run.name, run.meta["kind"], record, b, a, errors(b, record), errors(a, record), of_effects))
    return made


def in_held_out_runs(
    question: Question, fitted: FittedHypothesis, known: WhitenedDataSet | None = None
) -> FittedHypothesis:
    """What was found, at its values in runs that were not used, which are linearised about it until their states rest.

    Its log evidence there judges the steps, not the whole course: the track of a course-unstable ship depends more on
    the last per cent of its coefficients than on any effect. It is that of these runs given the fitted ones,
    ``ln p(held-out | fitted) = ln p(fitted, held-out) - ln p(fitted)``: coefficients are off by the same in all runs of
    a ship, so that what an effect says of them in the fitted runs is not credited to it once more.

    Args:
        question: What is asked.
        fitted: What was found in the fitted runs.
        known: These, about its states; None weighs the others by themselves, at the sizes that were found.

    Returns:
        It, with nothing free but the times of events, which are placed by each run's own recording and integrated out:
        what was looked for in a run is no gain. In its evidence errors of coefficients may go together in any way
        (:func:`.gain_by_coefficient_priors`). Without held-out runs its evidence is 0.
    """
    if not question.case.held_out:
        return replace(fitted, hypothesis=_elsewhere(question, fitted), evidence=0.0)
    if id(fitted) not in question.elsewhere:
        question.elsewhere[id(fitted)] = fitted, *_placed(question, fitted)
    _, data_set, there, elsewhere = question.elsewhere[id(fitted)]
    evidence = _log_evidence(data_set, there) if known is None else _given(known, fitted, data_set, elsewhere)
    data_set.release()
    times = [k for k, f in enumerate(there.hypothesis.unknowns()) if f.parameter.per_run]
    return replace(there, hypothesis=elsewhere, covariance=there.covariance[np.ix_(times, times)], evidence=evidence)


def _elsewhere(question: Question, fitted: FittedHypothesis) -> Hypothesis:
    """What was found, in the held-out runs at its values: nothing but times is free."""
    elsewhere = fitted.hypothesis.in_other_runs(same_campaigns(question.case.fitted, question.case.held_out))
    fixed = frozenset(p.name for e in elsewhere.effects for p in e.declared if not p.per_run)
    return replace(elsewhere, fixed=fixed)


def _placed(question: Question, fitted: FittedHypothesis) -> tuple[WhitenedDataSet, FittedHypothesis, Hypothesis]:
    """The held-out runs about the states of what was found, it fitted to them, and its values with events placed."""
    elsewhere = _elsewhere(question, fitted)
    declared = [p for e in elsewhere.effects for p in e.declared if not p.per_run]
    held, starts = frozenset(p.name for p in declared if not p.form), [(elsewhere, fitted.best)]
    if any(e.timed for e in elsewhere.effects):
        # Before events have their place, coefficients and uncertain parts of a formula may give way to what these do.
        starts.append((elsewhere, (fitted.best[0], 0)))
        if any(p.form for p in declared):
            starts += [(refine(question.held_out, h, *noise).hypothesis, noise) for h, noise in starts]
    begun = [refine(question.held_out, replace(start, fixed=held), *noise) for start, noise in starts]
    different = {round(b.evidence, 2): b for b in begun}.values()  # those that ended at one place once
    data_set, there = max(
        (at_rest(question.held_out.data_set, b) for b in different), key=lambda rested: rested[1].evidence
    )
    # Predictions are made with formulas as the fitted runs have them.
    both = zip(elsewhere.effects, there.hypothesis.values, elsewhere.values, strict=True)
    mixed = tuple(np.where([p.per_run for p in e.declared], placed, before) for e, placed, before in both)
    return data_set, there, replace(elsewhere, values=mixed)


def _given(known: WhitenedDataSet, fitted: FittedHypothesis, data_set: WhitenedDataSet, elsewhere: Hypothesis) -> float:
    """``ln p(fitted, held-out) - ln p(fitted)`` of a hypothesis: the runs that it was fitted to, and it in others."""
    everywhere = WhitenedDataSet(known.dynamics, [*known.whole, *data_set.whole], known.coefficient_prior)
    found = fitted.hypothesis
    whole = replace(
        found,
        values=tuple(np.concatenate(both) for both in zip(found.values, elsewhere.values, strict=True)),
        campaigns=found.campaigns + elsewhere.campaigns,
    )
    both = [_log_evidence(d, _improved(d, h, fitted.best)) for d, h in ((everywhere, whole), (known, found))]
    return both[0] - both[1]


def _improved(data_set: WhitenedDataSet, hypothesis: Hypothesis, best: tuple[int, int]) -> FittedHypothesis:
    """A hypothesis about runs, fitted from values nearby; a gusty wind is left at its mean, which gusts would move."""
    likelihood = beside(MarginalLikelihood(data_set), hypothesis)
    if not any(e.random for e in hypothesis.effects):
        hypothesis, _ = likelihood.improve(hypothesis, *best, rounds=2)
    return beside(likelihood, hypothesis).evaluate(hypothesis, around=best[0])


def _log_evidence(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> float:
    """Log evidence of a hypothesis about runs, the course of gusts integrated out, with any prior of coefficients."""
    likelihood, evidence = beside(MarginalLikelihood(data_set), fitted.hypothesis), fitted.evidence
    if any(e.random for e in fitted.hypothesis.effects):
        evidence = gusty_evidence(likelihood, fitted.hypothesis, fitted.best[0])
    return evidence + gain_by_coefficient_priors(likelihood.data_set, fitted)
