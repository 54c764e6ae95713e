"""The whole diagnosis of one ship: judge, decide, check, repair, prove."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from manoeuvre_nn.diagnosis import checks as checking
from manoeuvre_nn.diagnosis.alarm import MIN_GAIN_OF_UNKNOWN
from manoeuvre_nn.diagnosis.causes import causes_of
from manoeuvre_nn.diagnosis.decision import Decision, decide, settled
from manoeuvre_nn.diagnosis.locate import MAX_PROCESS_NOISE, location, residuals
from manoeuvre_nn.diagnosis.proof import Question, cost, counted_as_one, foreseen, prove
from manoeuvre_nn.diagnosis.remainder import is_left, with_remainder
from manoeuvre_nn.diagnosis.result import Cause, Check, Diagnosis, Proof, Residual
from manoeuvre_nn.diagnosis.search import Progress, SearchResult, at_rest, search
from manoeuvre_nn.diagnosis.words import labels, left_open, next_steps, runner_up, summary_sentence
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.relinearise import refined

PROVED = 3.0
"""Log evidence that an effect must add on held-out runs where the model was fitted: its errors may look like one."""
MAX_ERROR_GROWTH = 1.05
"""Growth of the error of free runs from which an effect is not named."""


def diagnose(question: Question, progress: Progress = lambda _: None) -> Diagnosis:
    """Compare a calm-water model with recordings and say what was left out.

    Args:
        question: What is asked.
        progress: Is told which candidate is under test.

    Returns:
        The answer.
    """
    began = time.perf_counter()
    progress("tracks and noise")
    data_set = whitened_data_set(question.dynamics, question.fitted)
    tried = search(data_set, question.effects, progress, question.workers)
    tried = settled(tried)
    verdict = decide(tried)
    progress("proof")
    data_set = tried.likelihood.data_set
    chosen, proofs, checks = _repair(question, data_set, tried, verdict)
    if question.remainder and is_left(tried.likelihood, chosen):
        chosen, proofs, checks = _with_network(question, tried, chosen, proofs, checks, progress)
    causes = causes_of(question, tried, verdict, chosen)
    size = float(np.clip(2 * data_set.levels[tried.none.best[0]].max(), 0.05, MAX_PROCESS_NOISE))
    found = _shaded(residuals(data_set, chosen.hypothesis, size), [c for c in causes if c.name in chosen.names])
    model = ["unknown" if name == Formula.name else name for name in chosen.names if name != Remainder.name]
    mismatch = bool(chosen.names) or verdict.strange
    where = location(data_set, tried, found)
    noise = _noise(data_set)
    return Diagnosis(
        case=question.name,
        ship=question.dynamics.particulars.name,
        verdict="mismatch" if mismatch else "none",
        sentence=summary_sentence(causes, model, proofs, mismatch, left_open(tried, verdict)),
        causes=causes,
        model=model,
        alias=checking.aliases(tried, chosen),
        location=where,
        residuals=found,
        checks=checks,
        runner_up=runner_up(tried, verdict),
        proofs=proofs,
        noise=noise,
        next_steps=next_steps(tried, verdict, chosen, mismatch),
        undecided=list(question.undecided),
        tracks={r.name: r.stacked("x", "y") for r in question.fitted},
        network=_network(chosen),
        settings=question.settings,
        seconds=time.perf_counter() - began,
    )


def _repair(
    question: Question, data_set: WhitenedDataSet, tried: SearchResult, verdict: Decision
) -> tuple[FittedHypothesis, list[Proof], list[Check]]:
    """The hypothesis that may be named: probable, and better on runs that it has not seen; with its proofs."""
    none = tried.none
    candidates: list[FittedHypothesis] = []
    if verdict.best is not None and verdict.named and verdict.unknown < 0.5:
        candidates.append(verdict.best)
        if len(verdict.best.names) > 1:
            candidates += [j for j in tried.fitted if len(j.names) == 1 and set(j.names) <= set(verdict.best.names)][:1]
    formula = verdict.formula
    if formula is not None and (verdict.strange or formula.evidence > tried.none.evidence + MIN_GAIN_OF_UNKNOWN):
        candidates.append(formula.fitted)
    checks: list[Check] = []
    proofs = prove(question, data_set, none, none)
    before = cost(proofs, question.dynamics, "before")
    for first in candidates:
        there, j = tried.likelihood.data_set, first
        if not _turns(first):  # strong gusts explain what a fit without them would lay on the mean wind
            there, j = at_rest(there, first)
        made = prove(question, there, none, j, proofs)
        after, gain = cost(made, question.dynamics, "after"), foreseen(question, j)
        least = PROVED if is_fitted(data_set.dynamics) else 0.0
        helped = not made or (gain > least and after < MAX_ERROR_GROWTH * before)
        text = (
            f"with {labels(j)} the error of free runs goes from {before:.2f} to {after:.2f} ({_unit(question)}), "
            f"and the log evidence of the held-out runs by {gain:+.0f}"
        )
        checks.append(Check("held-out gain", helped, text if made else "no held-out run: not proved"))
        if helped:
            return j, made, [*checks, *checking.checks(tried, first)]
    return none, proofs, checks


def _turns(fitted: FittedHypothesis) -> bool:
    """Whether a wind with gusts across it is part of a hypothesis."""
    for effect, values in zip(fitted.hypothesis.effects, fitted.hypothesis.values, strict=True):
        across = [k for k, p in enumerate(effect.declared) if p.name in effect.random[2:]]
        if values[0, across].any():
            return True
    return False


def _with_network(
    question: Question,
    tried: SearchResult,
    chosen: FittedHypothesis,
    proofs: list[Proof],
    checks: list[Check],
    progress: Progress,
) -> tuple[FittedHypothesis, list[Proof], list[Check]]:
    """The same with a network on top, if runs that were not used are predicted better with it."""
    there = refined(tried.likelihood.data_set, chosen) if chosen.names else tried.likelihood.data_set
    more = with_remainder(MarginalLikelihood(there), chosen, progress)
    made = prove(question, there, tried.none, more, proofs)
    now, then = (cost(p, question.dynamics, "after") for p in (proofs, made))
    helped = bool(made) and then < now and foreseen(question, more) > foreseen(question, chosen)
    text = f"with a network on top the error of free runs goes from {now:.2f} to {then:.2f} ({_unit(question)})"
    checks = [*checks, Check("remainder", helped, text if made else "no held-out run: a network is not trusted")]
    return (more, made, checks) if helped else (chosen, proofs, checks)


def _unit(question: Question) -> str:
    """Unit of the cost in words."""
    one = counted_as_one(question.dynamics.particulars)
    return f"1 is {100 * one['pos']:.2g} % of L, {one['psi']:.2g} deg, {one['u']:.2g} m/s, {one['r']:.2g} deg/s"


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


def _noise(data_set: WhitenedDataSet) -> dict[str, float]:
    """RMS of every channel's noise: no prediction can do better."""
    s = np.sqrt(np.mean([p.noise**2 for p in data_set.runs], axis=0))
    deg = 180 / np.pi
    return {
        "pos": float(np.hypot(s[0], s[1])), "psi": float(s[4] * deg), "u": float(s[2]), "v": float(s[3]),
        "r": float(s[5] * deg), "u_log": float(s[6]),
    }  # fmt: skip
