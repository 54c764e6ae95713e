"""The proof: what a claim predicts of runs that were not used, beside calm water and the recordings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.gusts import gusty_evidence
from manoeuvre_nn.diagnosis.repair import predict, predict_corrected, recorded
from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.diagnosis.windows import replaced
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import LATENCY, same_campaigns
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.scoring.free_runs import errors


def prove(
    question: Question, claim: FittedHypothesis, elsewhere: Hypothesis, known: Sequence[Proof] = ()
) -> list[Proof]:
    """Held-out runs predicted before and after.

    Args:
        question: What is asked.
        claim: What was found, effects and coefficients.
        elsewhere: It, in the held-out runs: see :func:`placed`.
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
        of_effects = errors(alone[k], record) if alone else {}
        made.append(Proof(run.name, run.meta["kind"], record, b, a, errors(b, record), errors(a, record), of_effects))
    return made


def foreseen(question: Question, claim: FittedHypothesis, elsewhere: Hypothesis) -> float:
    """Log evidence of a claim, held at its values and its process noise, on runs that were not used; 0 without any."""
    # Free runs alone would not decide: the track of a course-unstable ship depends more on the last per cent of
    # its coefficients than on any effect. This judges the steps, not the whole course.
    if not question.case.held_out:
        return 0.0
    # Times that were placed there are integrated out again: what was looked for in a run is no gain.
    fixed = frozenset(p.name for e in elsewhere.effects for p in e.declared if not p.per_run)
    held = replace(elsewhere, fixed=fixed)
    evidence_of = gusty_evidence if any(e.random for e in held.effects) else MarginalLikelihood.evidence_at
    return evidence_of(question.held_out, held, claim.best[0])


def placed(question: Question, fitted: FittedHypothesis) -> Hypothesis:
    """What was found in the held-out runs: its values, but times of an event placed in each run's own recording."""
    found = fitted.hypothesis
    elsewhere = found.in_other_runs(same_campaigns(question.case.fitted, question.case.held_out))
    if not question.case.held_out or not any(p.per_run for effect in found.effects for p in effect.declared):
        return elsewhere
    fixed = frozenset(p.name for e in found.effects for p in e.declared if not p.per_run)
    free = replaced(question.held_out, replace(elsewhere, fixed=fixed), *fitted.best)
    return replace(free, fixed=found.fixed)
