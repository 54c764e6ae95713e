"""The whole diagnosis of one ship: search, decide, prove, tell."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from manoeuvre_nn.diagnosis import checks as checking
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.causes import causes_of
from manoeuvre_nn.diagnosis.claims import Proved, decided, error_after, held_out_gain, unit_of_error
from manoeuvre_nn.diagnosis.forecast import forecasts, unplaced_events
from manoeuvre_nn.diagnosis.locate import MAX_PROCESS_NOISE, residuals, sites, statements
from manoeuvre_nn.diagnosis.nature import nature_of
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS, still_missing
from manoeuvre_nn.diagnosis.proof import in_held_out_runs, prove
from manoeuvre_nn.diagnosis.remainder import is_left, with_remainder
from manoeuvre_nn.diagnosis.result import USABLE_MODEL, Cause, Check, Diagnosis, Proof, Residual, rmse
from manoeuvre_nn.diagnosis.search import Progress, SearchResult
from manoeuvre_nn.diagnosis.settled import searched
from manoeuvre_nn.diagnosis.words import (
    left_open,
    nature_sentence,
    next_steps,
    runner_up,
    summary_sentence,
    with_caveats,
)
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.relinearise import refined


def diagnose(question: Question, progress: Progress = lambda _: None) -> Diagnosis:
    """Compare a calm-water model with recordings and say what was left out.

    Args:
        question: What is asked.
        progress: Is told what is under way.

    Returns:
        The answer.
    """
    began = time.perf_counter()
    progress("tracks and noise")
    data_set = whitened_data_set(question.dynamics, question.case.fitted)
    tried = searched(data_set, question.effects, progress, question.workers)
    progress("proof")
    verdict, (chosen, proofs, checks) = decided(question, tried)
    if question.remainder and is_left(tried.likelihood, chosen):
        chosen, proofs, checks = _with_network(question, tried, (chosen, proofs, checks), progress)
    mismatch, data_set = verdict.mismatch(chosen), tried.likelihood.data_set
    allowed = float(np.clip(2 * data_set.levels[tried.none.best[0]].max(), 0.05, MAX_PROCESS_NOISE))
    found = residuals(data_set, chosen.hypothesis, allowed)
    strange = mismatch and set(chosen.names) <= {Formula.name, Remainder.name}
    tested = Formula.name in chosen.names if verdict.formula in verdict.claims and proofs else None
    failed = verdict.formula if strange and tested is False else None
    held_out = 0.0 if failed is None else held_out_gain(question, tried, failed)
    nature = nature_of(tried, verdict, found, tested, held_out) if strange else None
    causes = causes_of(question, tried, verdict, chosen, nature)
    found = _shaded(found, [c for c in causes if c.name in chosen.names])
    particulars = question.dynamics.particulars
    model = ["unknown" if name == Formula.name else name for name in chosen.names if name != Remainder.name]
    checks = [*([Check(USABLE_MODEL, False, question.caveat)] if question.caveat else []), *checks]
    noise, open_still = _noise(data_set), (left_open(tried, verdict), still_missing(checks))
    over = _over_noise(proofs, noise)
    checks = [replace(c, text=c.text + over) if c.name == REPAIRED_SAILS else c for c in checks]
    sentence = summary_sentence(causes, model, proofs, mismatch, *open_still, noise)
    steps, advised = next_steps(tried, verdict, chosen, mismatch)
    return Diagnosis(
        case=question.case.name,
        ship=particulars.name,
        verdict="mismatch" if mismatch else "none",
        sentence=with_caveats(sentence, question.dynamics.particulars.name, checks),
        causes=causes,
        model=model,
        alias=checking.aliases(tried, chosen),
        sites=sites(tried),
        statements=[*([nature_sentence(nature)] if nature else []), *statements(data_set, found)],
        residuals=found,
        checks=checks,
        runner_up=runner_up(tried, verdict),
        proofs=proofs,
        noise=noise,
        next_steps=steps,
        next_run=advised.as_dict if advised else None,
        undecided=[*question.case.undecided, *unplaced_events(question, chosen)],
        tracks={r.name: r.stacked("x", "y") for r in question.case.fitted},
        forecasts=forecasts(question, tried.likelihood.data_set, chosen),
        network=_network(chosen),
        dimensions=(particulars.length, particulars.beam),
        settings=question.settings,
        seconds=time.perf_counter() - began,
    )


def _with_network(question: Question, tried: SearchResult, proved: Proved, progress: Progress) -> Proved:
    """The same with a network on top, if runs that were not used are predicted better with it."""
    chosen, proofs, checks = proved
    there = refined(tried.likelihood.data_set, chosen) if chosen.names else tried.likelihood.data_set
    more = with_remainder(MarginalLikelihood(there), chosen, progress)
    with_it, without = in_held_out_runs(question, more), in_held_out_runs(question, chosen)
    made = prove(question, more, with_it.hypothesis, proofs)
    now, then = error_after(question, proofs), error_after(question, made)
    helped = bool(made) and then < now and with_it.evidence > without.evidence
    text = f"with a network on top the error of free runs goes from {now:.2f} to {then:.2f} ({unit_of_error(question)})"
    checks = [*checks, Check("remainder", helped, text if made else "no held-out run: a network is not trusted")]
    return (more, made, checks) if helped else (chosen, proofs, checks)


def _shaded(found: Sequence[Residual], causes: Sequence[Cause]) -> list[Residual]:
    """Residuals with the times of events that were found, where there are any, as their windows."""
    shaded = []
    for r in found:
        acting = [i for c in causes if c.intervals for i in c.intervals.get(r.run, [])]
        shaded.append(replace(r, windows=acting) if acting else r)
    return shaded


def _network(fitted: FittedHypothesis) -> dict[str, float]:
    """Weights of the network that learned what physics leaves; empty without one."""
    if Remainder.name not in fitted.names:
        return {}
    weights = fitted.hypothesis.values[fitted.names.index(Remainder.name)][0]
    return {p.name: float(f"{w:.6g}") for p, w in zip(Remainder.declared, weights, strict=True)}


def _over_noise(proofs: Sequence[Proof], noise: Mapping[str, float]) -> str:
    """A clause on the largest error of the repaired model over its channel's measurement noise."""
    ratios = {c: e / noise[c] for c, e in rmse(proofs, "after").items() if np.isfinite(e) and noise.get(c, 0.0) > 0}
    if not ratios:
        return ""
    channel = max(ratios, key=lambda c: ratios[c])
    return f"; RMS errors are up to {ratios[channel]:.2g} times the measurement noise ({channel})"


def _noise(data_set: WhitenedDataSet) -> dict[str, float]:
    """RMS of every channel's measurement noise as estimated; NaN of a velocity that none recorded."""
    lines = [p.linearised for p in data_set.runs]
    sensed = np.array([[name not in x.run.derived for name in x.states.channels] for x in lines])
    squares = np.stack([p.sample_noise**2 for p in data_set.runs])
    with np.errstate(invalid="ignore"):
        s = np.sqrt((squares * sensed).sum(axis=0) / sensed.sum(axis=0))
    deg = 180 / np.pi
    return {
        "pos": float(np.hypot(s[0], s[1])), "psi": float(s[4] * deg), "u": float(s[2]), "v": float(s[3]),
        "r": float(s[5] * deg), "u_log": float(s[6]),
    }  # fmt: skip
