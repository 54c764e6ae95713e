"""What was found, as a list of causes with probabilities, parameters and times."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.proof import Question, timed_values
from manoeuvre_nn.diagnosis.result import Cause, Interval, Value
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.formula import Formula, place_of
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

LEADING = 0.25
"""Chi-square of a formula's term, over that of its clearest, from which it counts for the place of the mismatch."""


def causes_of(question: Question, tried: SearchResult, verdict: Decision, chosen: FittedHypothesis) -> list[Cause]:
    """All candidates with their probability, best first.

    Args:
        question: What is asked.
        tried: All hypotheses that were fitted.
        verdict: Their probabilities.
        chosen: What is named; calm water if nothing is.

    Returns:
        The causes, ``unknown`` among them.
    """
    causes = []
    prototypes = {e.name: e for e in question.effects}
    named = set(chosen.names)
    for name, probability in verdict.effects.items():
        j = max((j for j in tried.fitted if name in j.names), key=lambda j: j.evidence)
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
                _values_of(j, k),
                intervals(question, j, k),
                e.fingerprint,
                e.source,
            )  # fmt: skip
        )
    causes.append(_unmodelled(verdict, chosen, tried, bool(named)))
    causes = [_everywhere(question, chosen, c) if c.name in named else c for c in causes]
    return sorted(causes, key=lambda c: (-(c.name in named), -c.probability))


def _unmodelled(verdict: Decision, chosen: FittedHypothesis, tried: SearchResult, named: bool) -> Cause:
    """What no effect of the shelf explains, with its formula if that holds on runs that were not used."""
    probability = verdict.unknown if verdict.strange else min(verdict.unknown, 0.49)
    if Formula.name in chosen.names or (verdict.strange and not named):
        probability = max(probability, 0.6)
    formula = chosen.hypothesis.effects[0] if Formula.name in chosen.names else None
    terms = formula.terms if isinstance(formula, Formula) else ()
    values = tuple(replace(v, name=t) for v, t in zip(_values_of(chosen, 0), terms, strict=True)) if terms else ()
    clear = np.array([(v.value / v.error) ** 2 for v in values])
    where = [place_of(t) for t, c in zip(terms, clear, strict=True) if c > LEADING * clear.max()]
    return Cause(
        name="unknown",
        label="something that no candidate explains",
        probability=probability,
        evidence=verdict.unmodelled,
        equations=tuple(dict.fromkeys(where)) or _equations(tried),
        parameters=values,
        intervals=None,
        fingerprint="The misfit is real, and no effect of the shelf removes it.",
        source="",
        terms=terms,
    )


def _equations(tried: SearchResult) -> tuple[str, ...]:
    """Equations whose coloured force calm water needs."""
    free = tried.likelihood.evaluate(Hypothesis((), ()), process_prior=None)
    surge, lateral = tried.likelihood.data_set.levels[free.best[0]]
    return tuple(e for e, level in (("X", surge), ("Y", lateral), ("N", lateral)) if level > 5e-4) or ("kinematics",)


def _values_of(fitted: FittedHypothesis, effect: int) -> tuple[Value, ...]:
    """Parameters of one effect with standard errors, form and per-run parameters left out."""
    h = fitted.hypothesis
    found = []
    for f, value, error in zip(h.unknowns(), h.vector(), fitted.errors, strict=True):
        if f.effect == effect and not f.parameter.form and not f.parameter.per_run:
            found.append(Value(f.parameter.name, float(value), float(error), f.parameter.unit))
    sizes = [p for p in h.effects[effect].declared if p.random and p.name in fitted.random]
    found += [Value(p.name, *fitted.random[p.name], p.unit) for p in sizes]
    return tuple(found)


def intervals(question: Question, fitted: FittedHypothesis, effect: int) -> dict[str, list[Interval]] | None:
    """Times in which an effect acts.

    Args:
        question: What is asked.
        fitted: A fitted hypothesis.
        effect: Number of the effect.

    Returns:
        Run -> intervals; None if it acts throughout.
    """
    timed = [j for j, p in enumerate(fitted.hypothesis.effects[effect].declared) if p.per_run]
    if not timed:
        return None
    return _times(question.fitted, fitted.hypothesis.values[effect][:, timed])


def _times(runs: Sequence[Recording], table: Float[np.ndarray, "runs timed"]) -> dict[str, list[Interval]]:
    """Start and end, or start alone, of an event in every run as intervals."""
    found = {}
    for run, times in zip(runs, table, strict=True):
        end = float(times[1] if len(times) > 1 else run.time[-1])
        found[run.name] = [(float(times[0]), end)] if end > times[0] + 1 else []
    return found


def _everywhere(question: Question, fitted: FittedHypothesis, cause: Cause) -> Cause:
    """A named cause with the times of the held-out runs too."""
    if not cause.intervals or not question.held_out:
        return cause
    k = fitted.names.index(cause.name)
    timed = [j for j, p in enumerate(fitted.hypothesis.effects[k].declared) if p.per_run]
    more = _times(question.held_out, timed_values(question, fitted)[k][:, timed])
    return replace(cause, intervals={**cause.intervals, **more})
