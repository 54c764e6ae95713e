"""What was found, as a list of causes with probabilities, parameters and times."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Parameter
from manoeuvre_nn.core.recording import CAMPAIGN, Recording
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.locate import unit_forces, units
from manoeuvre_nn.diagnosis.proof import in_held_out_runs
from manoeuvre_nn.diagnosis.result import Cause, Interval, Nature, Value
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.effect.formula import Formula, growth_of, places_of
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

LEADING = 0.25
"""Chi-square of a formula's term, over that of its clearest, from which it counts for the place of the mismatch."""


def causes_of(
    question: Question,
    tried: SearchResult,
    verdict: Decision,
    chosen: FittedHypothesis,
    nature: Nature | None = None,
) -> list[Cause]:
    """All candidates and ``unknown`` with their probability: what was proved first, then the likeliest."""
    causes = []
    for name in verdict.effects:
        proved = name in chosen.names
        j = chosen if proved else max((j for j in tried.fitted if name in j.names), key=lambda j: j.evidence)
        k = j.names.index(name)
        effect = j.hypothesis.effects[k]
        when = _when(question, j, k, proved)
        causes.append(
            Cause(
                name,
                effect.label,
                verdict.probability(name, chosen),
                verdict.bayes[name],
                effect.equations,
                _values_of(j, k, question.case.fitted),
                None if when is None else {run: [times for times, _ in spans] for run, spans in when.items()},
                effect.fingerprint,
                effect.source,
                interval_errors={run: [errors for _, errors in spans] for run, spans in (when or {}).items()},
            )
        )
    unknown = _unmodelled(tried, verdict, chosen)
    causes.append(unknown if nature is None else with_nature(unknown, nature))
    return sorted(causes, key=lambda c: (-(c.name in chosen.names), -c.probability))


def with_nature(unknown: Cause, nature: Nature) -> Cause:
    """Something unknown with its nature, and where this acts if no formula of its own tells where."""
    told = unknown.equations if unknown.terms else nature.places or unknown.equations
    return replace(unknown, nature=nature, equations=told)


def _unmodelled(tried: SearchResult, verdict: Decision, chosen: FittedHypothesis) -> Cause:
    """What no effect of the shelf explains, with its formula if that holds on runs that were not used."""
    effect = chosen.hypothesis.effects[0] if Formula.name in chosen.names else None
    formula = effect if isinstance(effect, Formula) else None
    terms = formula.terms if formula else ()
    found = _values_of(chosen, 0) if formula else ()
    values = _with_units(tried.likelihood.data_set, formula, found) if formula else ()
    clear = np.array([(v.value / v.error) ** 2 for v in values[: len(terms)]])
    where = [p for t, c in zip(terms, clear, strict=True) if c > LEADING * clear.max() for p in places_of(t)]
    return Cause(
        name="unknown",
        label="something that no candidate explains",
        probability=verdict.probability("unknown", chosen),
        evidence=verdict.unmodelled,
        equations=tuple(dict.fromkeys(where)) or _equations(tried),
        parameters=values,
        intervals=None,
        fingerprint="The misfit is real, and no effect of the shelf removes it.",
        source="",
        terms=terms,
        weights={v.name: v.value for v in found},
    )


def _with_units(data_set: WhitenedDataSet, formula: Formula, found: Sequence[Value]) -> tuple[Value, ...]:
    """Coefficients of a formula's terms by their names, in units of forces, angles and channels; the rest as it is."""
    equations: Sequence[str] = "XYN"
    forces = dict(zip(equations, zip(unit_forces(data_set).tolist(), units(data_set), strict=True), strict=True))
    told = []
    for term, v in zip(formula.terms, found, strict=False):
        size, unit = forces.get(term[0]) or formula.unit_of_weight(term)
        minute, grown = growth_of(term)
        told.append(Value(term, minute * size * v.value, minute * size * v.error, unit + grown))
    return (*told, *found[len(told) :])


def _equations(tried: SearchResult) -> tuple[str, ...]:
    """Equations whose process noise calm water needs."""
    free = tried.likelihood.evaluate(Hypothesis((), ()), process_prior=None)
    surge, lateral = tried.likelihood.data_set.levels[free.best[0]]
    return tuple(e for e, level in (("X", surge), ("Y", lateral), ("N", lateral)) if level > 5e-4) or ("kinematics",)


def _values_of(fitted: FittedHypothesis, effect: int, runs: Sequence[Recording] = ()) -> tuple[Value, ...]:
    """Parameters of one effect with standard errors: each campaign's own, the first run's own; no times, no form."""
    h = fitted.hypothesis
    found = []
    for f, value, error in zip(h.unknowns(), h.vector(), fitted.errors, strict=True):
        p = f.parameter
        told = not (p.form or p.is_time or (p.per_run and f.runs[0]) or _is_step(p, value, error))
        if f.effect == effect and told:
            campaign = str(runs[f.runs[0]].meta.get(CAMPAIGN, "")) if runs and h.campaigns else ""
            more: dict[str, Any] = {"low": p.low, "high": p.high} if p.period is None else {"period": p.period}
            more |= {"campaign": campaign, "sides": p.sides, "by_run": p.per_run}
            found.append(Value(p.name, float(value), float(error), p.unit, **more))
    sizes = [p for p in h.effects[effect].declared if p.random and p.name in fitted.random]
    found += [Value(p.name, *fitted.random[p.name], p.unit) for p in sizes]
    return tuple(found)


def _is_step(parameter: Parameter, value: float, error: float) -> bool:
    """Whether a ramp is so short, or so uncertain, that nothing speaks against a step."""
    return parameter.name == RAMP.name and bool(value - RAMP.low < 2 * error)


def _when(
    question: Question, fitted: FittedHypothesis, effect: int, held_out: bool
) -> dict[str, list[tuple[Interval, Interval]]] | None:
    """Run -> times in which an effect acts and their standard errors, in the held-out runs too if wanted.

    Returns:
        None if it acts throughout; an empty list for a run in which it does not.
    """
    h = fitted.hypothesis
    if not h.effects[effect].timed:
        return None
    ramp = next((v for v in _values_of(fitted, effect) if v.name == RAMP.name), None)
    found = _spans(h, effect, fitted.covariance, question.case.fitted, ramp)
    if held_out and question.case.held_out:
        there = in_held_out_runs(question, fitted)
        found |= _spans(there.hypothesis, effect, there.covariance, question.case.held_out, ramp)
    return found


def _spans(
    h: Hypothesis, effect: int, covariance: Float[np.ndarray, "m m"], runs: Sequence[Recording], ramp: Value | None
) -> dict[str, list[tuple[Interval, Interval]]]:
    """From when half of an effect acts to when half of it is gone; with a clear ramp from its first to its last."""
    errors = dict(
        zip([(f.effect, f.column, f.runs[0]) for f in h.unknowns()], np.sqrt(np.diag(covariance)), strict=True)
    )
    timed = h.effects[effect].timed
    half, unsure = (0.0, 0.0) if ramp is None else (0.5 * ramp.value, 0.5 * ramp.error)
    found: dict[str, list[tuple[Interval, Interval]]] = {}
    for row, run in enumerate(runs):
        spans, (first, last) = [], run.time[[0, -1]].tolist()
        for a, b in zip(timed[::2], timed[1::2], strict=True):
            start, end = (float(h.values[effect][row, j]) for j in (a, b))
            if not np.isfinite(start) or end <= start or start - half >= last:
                continue
            ends = max(start - half, first), min(end + half, last)
            of_ends = [float(np.hypot(errors.get((effect, j, row), np.nan), unsure)) for j in (a, b)]
            # What acts before a run, or on after it, has no time there.
            sure = of_ends[0] if ends[0] > first else np.nan, of_ends[1] if ends[1] < last else np.nan
            spans.append((ends, sure))
        found[run.name] = sorted(spans)
    return found
