"""The question, and its proof: runs that were not used, predicted before and after."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.diagnosis.gusts import gusty_evidence
from manoeuvre_nn.diagnosis.repair import Repaired, errors, predict, recorded
from manoeuvre_nn.diagnosis.result import Proof
from manoeuvre_nn.diagnosis.windows import best_windows
from manoeuvre_nn.dynamics.base import Model, is_fitted
from manoeuvre_nn.estimation.corrections import Calibrated
from manoeuvre_nn.estimation.data_set import LATENCY, WhitenedDataSet, prepared_run, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

SCALES = {"pos": 0.02, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}
"""Errors that count as one on a ship: position in lengths, deg, m/s, m/s, deg/s, m/s."""
SCALE_POWERS = (0.0, 0.0, 0.5, 0.5, -0.5, 0.5)
"""Exponents of length with which they go."""


@dataclass(frozen=True)
class Question:
    """What is asked.

    Attributes:
        name: Name of the case.
        dynamics: Calm-water model.
        fitted: Runs that parameters are taken from.
        held_out: Runs for the proof.
        effects: Prototypes of the candidates.
        undecided: What is known from the start to be undecidable, a sentence each.
        settings: For the record.
        workers: Processes among which the candidates are shared out.
        calibrate: Whether the repaired model has its coefficients corrected too, within their usual scatter.
        remainder: Whether a network may learn what physics leaves.
        warmup: Time up to which a held-out run may be looked at [s].
    """

    name: str
    dynamics: Model
    fitted: Sequence[Recording]
    held_out: Sequence[Recording]
    effects: Sequence[Effect]
    undecided: Sequence[str] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    workers: int = 1
    calibrate: bool = True
    remainder: bool = False
    warmup: float = 40.0


def prove(
    question: Question,
    data_set: WhitenedDataSet,
    none: FittedHypothesis,
    fitted: FittedHypothesis,
    known: Sequence[Proof] = (),
) -> list[Proof]:
    """Held-out runs predicted before and after.

    Args:
        question: What is asked.
        data_set: The fitted runs.
        none: Calm water as fitted.
        fitted: What was found.
        known: Proofs of something else, whose predictions in calm water are the same.

    Returns:
        One proof a held-out run.
    """
    if not question.held_out:
        return []
    calm = Repaired(question.dynamics, none.hypothesis)
    runs = len(question.fitted)
    latency = LATENCY + float(np.mean(fitted.nuisance[-runs:])) if len(fitted.nuisance) else 0.0
    model = Repaired(question.dynamics, fitted.hypothesis, latency if fitted.names else 0.0)
    # Corrections within a fit's errors take up gusts of these runs, which others do not have.
    if fitted.names and question.calibrate and not is_fitted(data_set.dynamics):
        shares = question.dynamics.hull.inertia.new_tensor(data_set.rotation @ fitted.nuisance[:-runs])
        model = replace(model, calm=Calibrated(question.dynamics, shares))
    befores = [p.before for p in known] or predict(calm, question.held_out, question.warmup)
    afters = (
        predict(model, question.held_out, question.warmup, timed_values(question, fitted)) if fitted.names else befores
    )
    made = []
    for run, b, a in zip(question.held_out, befores, afters, strict=True):
        record = recorded(run, question.warmup)
        made.append(Proof(run.name, run.meta["kind"], record, b, a, errors(b, record), errors(a, record)))
    return made


def counted_as_one(ship: Particulars) -> dict[str, float]:
    """Errors that count as one.

    Args:
        ship: The ship; a model in a tank has them by Froude's law.

    Returns:
        pos [L], psi [deg], u, v [m/s], r [deg/s], u_log [m/s].
    """
    return dict(zip(SCALES, ship.sized(list(SCALES.values()), SCALE_POWERS).tolist(), strict=True))


def cost(proofs: Sequence[Proof], dynamics: Model, when: str) -> float:
    """One number for the errors on all held-out runs: the root mean square over channels in units of ``SCALES``.

    Args:
        proofs: Predictions.
        dynamics: For the length.
        when: ``before`` or ``after``.

    Returns:
        The cost; 0 without proofs.
    """
    if not proofs:
        return 0.0
    scale = counted_as_one(dynamics.particulars)
    scale["pos"] *= dynamics.particulars.length
    rows = [[getattr(p, f"rmse_{when}")[c] / scale[c] for c in SCALES] for p in proofs]
    return float(np.sqrt(np.nanmean(np.square(rows))))  # channels that were not recorded are not fitted


def foreseen(question: Question, fitted: FittedHypothesis) -> float:
    """Log evidence that found effects, held at their values, add on runs that were not used.

    Args:
        question: What is asked.
        fitted: What was found.

    Returns:
        Log Bayes factor over calm water; 0 without held-out runs.
    """
    # Free runs alone would not decide: the track of a course-unstable ship depends more on the last per cent of
    # its coefficients than on any effect. This judges the steps, not the whole course.
    if not question.held_out:
        return 0.0
    there = whitened_data_set(question.dynamics, question.held_out)
    likelihood = MarginalLikelihood(there)
    values = tuple(timed_values(question, fitted))
    effects = fitted.hypothesis.effects
    fixed = frozenset(p.name for e in effects for p in e.declared)
    level = fitted.best[0]
    held = Hypothesis(effects, values, fixed)
    evidence_of = gusty_evidence if any(e.random for e in effects) else MarginalLikelihood.evidence_at
    return evidence_of(likelihood, held, level) - likelihood.evidence_at(Hypothesis((), ()), level)


def timed_values(question: Question, fitted: FittedHypothesis) -> list[Float[np.ndarray, "runs p"]]:
    """Parameters of the held-out runs: those found, but times of an event are placed in each run's own recording.

    Args:
        question: What is asked.
        fitted: What was found.

    Returns:
        One table an effect.
    """
    hypothesis = fitted.hypothesis
    tables = [np.repeat(v[:1], len(question.held_out), axis=0) for v in hypothesis.values]
    timed = [k for k, e in enumerate(hypothesis.effects) if any(p.per_run for p in e.declared)]
    for k in timed:
        effect = hypothesis.effects[k]
        for row, run in enumerate(question.held_out):
            tables[k][row] = _placed(question.dynamics, hypothesis, k, effect, run, fitted)
    return tables


def _placed(
    dynamics: Model, hypothesis: Hypothesis, which: int, effect: Effect, run: Recording, fitted: FittedHypothesis
) -> Float[np.ndarray, " p"]:
    """Start and end of an event in one run, everything else as found."""
    likelihood = MarginalLikelihood(WhitenedDataSet(dynamics, [prepared_run(dynamics, run)]))
    rows = tuple(v[:1] for v in hypothesis.values)
    fixed = frozenset(p.name for e in hypothesis.effects for p in e.declared if not p.per_run)
    known = hypothesis.values[which][0]
    best, score = known, -np.inf
    for start in list(best_windows(likelihood, effect, known[None], *fitted.best))[:1]:
        timed = [p.per_run for p in effect.declared]
        values = np.where(timed, start[0], known)[None]
        trial = Hypothesis(hypothesis.effects, tuple(values if k == which else v for k, v in enumerate(rows)), fixed)
        found, gained = likelihood.improve(trial, *fitted.best, rounds=6)
        if gained > score:
            best, score = found.values[which][0], gained
    return best
