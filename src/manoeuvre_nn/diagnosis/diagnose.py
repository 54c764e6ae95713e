"""The whole diagnosis of one ship: judge, decide, check, repair, prove."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis import checks as checking
from manoeuvre_nn.diagnosis.bench import Bench, bench, place_run
from manoeuvre_nn.diagnosis.calibrated import Calibrated
from manoeuvre_nn.diagnosis.court import Court
from manoeuvre_nn.diagnosis.hypothesis import RANDOM, Hypothesis, Judged
from manoeuvre_nn.diagnosis.locate import location, residuals
from manoeuvre_nn.diagnosis.refine import refined
from manoeuvre_nn.diagnosis.repair import Repaired, errors, predict, recorded
from manoeuvre_nn.diagnosis.result import Cause, Check, Diagnosis, Interval, Proof, Value
from manoeuvre_nn.diagnosis.runs import Run
from manoeuvre_nn.diagnosis.search import Contest, Progress, contest, settle
from manoeuvre_nn.diagnosis.verdict import Verdict, decide
from manoeuvre_nn.diagnosis.words import captain, next_steps, runner_up
from manoeuvre_nn.dynamics.model import Dynamics

SCALES = {"pos": 0.02, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}
"""Errors that count as one: position in lengths, deg, m/s, m/s, deg/s, m/s."""
HARM = 1.05
"""Growth of the error of free runs from which an effect is not named."""


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
        threads: Candidates that are fitted at once.
        calibrate: Whether the repaired model has its coefficients corrected too, within their usual scatter.
    """

    name: str
    dynamics: Dynamics
    fitted: Sequence[Run]
    held_out: Sequence[Run]
    effects: Sequence[Effect]
    undecided: Sequence[str] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    threads: int = 1
    calibrate: bool = True


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
    stand = bench(question.dynamics, question.fitted)
    tried = contest(stand, question.effects, progress, question.threads)
    verdict = decide(tried)
    progress("proof")
    stand = tried.court.bench
    chosen, proofs, checks = _repair(question, stand, tried, verdict)
    found = residuals(stand, chosen.hypothesis)
    causes = _causes(question, tried, verdict, chosen)
    model = list(chosen.names)
    mismatch = bool(chosen.names) or verdict.strange
    where = location(stand, tried, found)
    noise = _noise(stand)
    return Diagnosis(
        case=question.name,
        ship=question.dynamics.particulars.name,
        verdict="mismatch" if mismatch else "none",
        sentence=captain(causes, model, proofs, mismatch),
        causes=causes,
        model=model,
        alias=checking.aliases(tried, chosen) if model else [],
        location=where,
        residuals=found,
        checks=checks,
        runner_up=runner_up(tried, verdict),
        proofs=proofs,
        noise=noise,
        next_steps=next_steps(tried, verdict, chosen, mismatch),
        undecided=list(question.undecided),
        tracks={r.name: r.measured[:, :2] for r in question.fitted},
        settings=question.settings,
        seconds=time.perf_counter() - began,
    )


def _repair(
    question: Question, stand: Bench, tried: Contest, verdict: Verdict
) -> tuple[Judged, list[Proof], list[Check]]:
    """The hypothesis that may be named: probable, and better on runs that it has not seen; with its proofs."""
    none = tried.none
    candidates = [] if verdict.best is None else [verdict.best]
    if verdict.best is not None and len(verdict.best.names) > 1:
        parts = [j for j in tried.judged if len(j.names) == 1 and set(j.names) <= set(verdict.best.names)]
        candidates += parts[:1]
    probable = verdict.named and verdict.unknown < 0.5
    checks: list[Check] = []
    proofs = _proofs(question, stand, none, none)
    before = cost(proofs, question.dynamics, "before")
    if not probable:
        return none, proofs, checks
    for first in candidates:
        there = refined(tried.court.bench, first)
        j = replace(settle(Court(there), first.hypothesis, *first.best), random=first.random)
        made = _proofs(question, there, none, j)
        after, gain = cost(made, question.dynamics, "after"), _foreseen(question, j, made)
        helped = not made or (gain > 0 and after < HARM * before)
        text = (
            f"{' + '.join(j.names)}: free runs {before:.2f} -> {after:.2f} (in units of the scales), "
            f"log evidence of the held-out runs {gain:+.0f}"
        )
        checks.append(Check("held-out gain", helped, text if made else "no held-out run: not proved"))
        if helped:
            return j, made, [*checks, *checking.checks(tried, first)]
    return none, proofs, checks


def _foreseen(question: Question, judged: Judged, proofs: Sequence[Proof]) -> float:
    """Log evidence that the found effects, held at their values, add on runs that were not used."""
    # Free runs alone would not do as a judge: the track of a course-unstable ship depends more on the last per cent of
    # its coefficients than on any effect. This judges the steps, not the whole course.
    if not proofs:
        return 0.0
    there = bench(question.dynamics, question.held_out)
    court = Court(there)
    values = tuple(timed_values(question, judged))
    effects = judged.hypothesis.effects
    fixed = frozenset(p.name for e in effects for p in e.declared)
    level = judged.best[0]
    return court.judge_level(Hypothesis(effects, values, fixed), level) - court.judge_level(Hypothesis((), ()), level)


def cost(proofs: Sequence[Proof], dynamics: Dynamics, when: str) -> float:
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
    scale = {k: v * (dynamics.particulars.length if k == "pos" else 1.0) for k, v in SCALES.items()}
    rows = [[getattr(p, f"rmse_{when}")[c] / scale[c] for c in SCALES] for p in proofs]
    return float(np.sqrt(np.nanmean(np.square(rows))))  # channels that were not recorded are not judged


def _proofs(question: Question, stand: Bench, none: Judged, judged: Judged) -> list[Proof]:
    """Held-out runs predicted before and after."""
    if not question.held_out:
        return []
    calm = Repaired(question.dynamics, none.hypothesis)
    places = len(question.fitted)
    latency = 0.25 + float(np.mean(judged.nuisance[-places:])) if len(judged.nuisance) else 0.0
    model = Repaired(question.dynamics, judged.hypothesis, latency if judged.names else 0.0)
    if judged.names and question.calibrate:
        shares = question.dynamics.hull.inertia.new_tensor(stand.rotation @ judged.nuisance[:-places])
        model = replace(model, calm=Calibrated(question.dynamics, shares))
    values = timed_values(question, judged)
    proofs = []
    for run, b, a in zip(
        question.held_out, predict(calm, question.held_out), predict(model, question.held_out, values), strict=True
    ):
        record = recorded(run)
        proofs.append(Proof(run.name, run.kind, record, b, a, errors(b, record), errors(a, record)))
    return proofs


def timed_values(question: Question, judged: Judged) -> list[Float[np.ndarray, "runs p"]]:
    """Parameters of the held-out runs: those found, but times of an event are placed in each run's own recording.

    Args:
        question: What is asked.
        judged: What was found.

    Returns:
        One table an effect.
    """
    hypothesis = judged.hypothesis
    tables = [np.repeat(v[:1], len(question.held_out), axis=0) for v in hypothesis.values]
    timed = [k for k, e in enumerate(hypothesis.effects) if any(p.per_run for p in e.declared)]
    for k in timed:
        effect = hypothesis.effects[k]
        for row, run in enumerate(question.held_out):
            tables[k][row] = _placed(question.dynamics, hypothesis, k, effect, run, judged)
    return tables


def _placed(
    dynamics: Dynamics, hypothesis: Hypothesis, which: int, effect: Effect, run: Run, judged: Judged
) -> Float[np.ndarray, " p"]:
    """Start and end of an event in one run, everything else as found."""
    from manoeuvre_nn.diagnosis.windows import best_windows

    place, names = place_run(dynamics, run)
    court = Court(Bench(dynamics, [place], names))
    rows = tuple(v[:1] for v in hypothesis.values)
    fixed = frozenset(p.name for e in hypothesis.effects for p in e.declared if not p.per_run)
    known = hypothesis.values[which][0]
    best, score = known, -np.inf
    for start in list(best_windows(court, effect, known[None], *judged.best))[:1]:
        timed = [p.per_run for p in effect.declared]
        values = np.where(timed, start[0], known)[None]
        trial = Hypothesis(hypothesis.effects, tuple(values if k == which else v for k, v in enumerate(rows)), fixed)
        found, gained = court.improve(trial, *judged.best, rounds=6)
        if gained > score:
            best, score = found.values[which][0], gained
    return best


def _causes(question: Question, tried: Contest, verdict: Verdict, chosen: Judged) -> list[Cause]:
    """All candidates with their probability, best first."""
    causes = []
    prototypes = {e.name: e for e in question.effects}
    named = set(chosen.names)
    for name, probability in verdict.effects.items():
        j = max((j for j in tried.judged if name in j.names), key=lambda j: j.evidence)
        if name in named:
            j = chosen
        elif verdict.named or verdict.strange:
            probability = min(probability, 0.49)  # it did not pass the checks
        k = j.names.index(name)
        e = prototypes[name]
        causes.append(
            Cause(
                name,
                e.label,
                probability,
                verdict.bayes[name],
                e.equations,
                values_of(j, k),
                intervals(question, j, k),
                e.fingerprint,
                e.source,
            )  # fmt: skip
        )
    unknown = verdict.unknown if verdict.strange else min(verdict.unknown, 0.49)
    if verdict.strange and not named:
        unknown = max(unknown, 0.6)
    causes.append(
        Cause("unknown", "something that no candidate explains", unknown, 0.0, _equations(tried), (), None,
              "The misfit is real, and no effect of the shelf removes it.", "")
    )  # fmt: skip
    return sorted(causes, key=lambda c: (-(c.name in named), -c.probability))


def _equations(tried: Contest) -> tuple[str, ...]:
    """Equations whose coloured force calm water needs."""
    free = tried.court.judge(Hypothesis((), ()), force_prior=None)
    surge, lateral = tried.court.bench.levels[free.best[0]]
    return tuple(e for e, level in (("X", surge), ("Y", lateral), ("N", lateral)) if level > 5e-4) or ("kinematics",)


def values_of(judged: Judged, effect: int) -> tuple[Value, ...]:
    """Parameters of one effect with standard errors, form and per-run parameters left out.

    Args:
        judged: A fitted hypothesis.
        effect: Number of the effect.

    Returns:
        Values.
    """
    h = judged.hypothesis
    found = []
    for f, value, error in zip(h.free(), h.vector(), judged.errors, strict=True):
        if f.effect == effect and not f.parameter.form and not f.parameter.per_run:
            found.append(Value(f.parameter.name, float(value), float(error), f.parameter.unit))
    names = [p.name for p in h.effects[effect].declared]
    if RANDOM[0] in names and RANDOM[0] in judged.random:
        found.append(Value(RANDOM[0], *judged.random[RANDOM[0]], "m/s"))
    return tuple(found)


def intervals(question: Question, judged: Judged, effect: int) -> dict[str, list[Interval]] | None:
    """Times in which an effect acts in the fitted runs.

    Args:
        question: What is asked.
        judged: A fitted hypothesis.
        effect: Number of the effect.

    Returns:
        Run -> intervals; None if it acts throughout.
    """
    e = judged.hypothesis.effects[effect]
    timed = [j for j, p in enumerate(e.declared) if p.per_run]
    if not timed:
        return None
    found = {}
    for row, run in enumerate(question.fitted):
        times = judged.hypothesis.values[effect][row, timed]
        end = times[1] if len(times) > 1 else run.time[-1]
        found[run.name] = [(float(times[0]), float(end))] if end > times[0] + 1 else []
    return found


def _noise(stand: Bench) -> dict[str, float]:
    """RMS of every channel's noise: no prediction can do better."""
    s = np.sqrt(np.mean([p.noise**2 for p in stand.places], axis=0))
    deg = 180 / np.pi
    return {
        "pos": float(np.hypot(s[0], s[1])), "psi": float(s[4] * deg), "u": float(s[2]), "v": float(s[3]),
        "r": float(s[5] * deg), "u_log": float(s[6]),
    }  # fmt: skip


def with_intervals_of(question: Question, judged: Judged, cause: Cause) -> Cause:
    """A cause with the times of the held-out runs added.

    Args:
        question: What is asked.
        judged: What was found.
        cause: One of its effects.

    Returns:
        The cause.
    """
    if cause.intervals is None or cause.name not in judged.names:
        return cause
    k = judged.names.index(cause.name)
    timed = [j for j, p in enumerate(judged.hypothesis.effects[k].declared) if p.per_run]
    table = timed_values(question, judged)[k]
    more = {}
    for run, row in zip(question.held_out, table, strict=True):
        times = row[timed]
        more[run.name] = [(float(times[0]), float(times[1] if len(times) > 1 else run.time[-1]))]
    return replace(cause, intervals={**cause.intervals, **more})
