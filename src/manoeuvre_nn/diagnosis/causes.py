"""What was found, as a list of causes with probabilities, parameters and times."""

from dataclasses import replace

import numpy as np

from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.proof import placed
from manoeuvre_nn.diagnosis.result import Cause, Interval, Nature, Value
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.formula import Formula, place_of
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
        causes.append(
            Cause(
                name,
                effect.label,
                verdict.probability(name, chosen),
                verdict.bayes[name],
                effect.equations,
                _values_of(j, k),
                _intervals(question, j, k, proved),
                effect.fingerprint,
                effect.source,
            )
        )
    unknown = _unmodelled(tried, verdict, chosen)
    if nature is not None:
        unknown = replace(unknown, nature=nature, equations=unknown.equations if unknown.terms else nature.equations)
    causes.append(unknown)
    return sorted(causes, key=lambda c: (-(c.name in chosen.names), -c.probability))


def _unmodelled(tried: SearchResult, verdict: Decision, chosen: FittedHypothesis) -> Cause:
    """What no effect of the shelf explains, with its formula if that holds on runs that were not used."""
    formula = chosen.hypothesis.effects[0] if Formula.name in chosen.names else None
    terms = formula.terms if isinstance(formula, Formula) else ()
    found = _values_of(chosen, 0) if terms else ()
    values = (*(replace(v, name=t) for v, t in zip(found, terms, strict=False)), *found[len(terms) :])
    clear = np.array([(v.value / v.error) ** 2 for v in values[: len(terms)]])
    where = [place_of(t) for t, c in zip(terms, clear, strict=True) if c > LEADING * clear.max()]
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


def _intervals(
    question: Question, fitted: FittedHypothesis, effect: int, held_out: bool
) -> dict[str, list[Interval]] | None:
    """Run -> times in which an effect acts, in the held-out runs too if wanted; None if it acts throughout."""
    timed = [j for j, p in enumerate(fitted.hypothesis.effects[effect].declared) if p.per_run]
    if not timed:
        return None
    runs, values = [*question.case.fitted], fitted.hypothesis.values[effect]
    if held_out and question.case.held_out:
        runs, values = [*runs, *question.case.held_out], np.vstack([values, placed(question, fitted).values[effect]])
    found: dict[str, list[Interval]] = {}
    for run, times in zip(runs, values[:, timed], strict=True):
        end = float(times[1] if len(times) > 1 else run.time[-1])
        found[run.name] = [(float(times[0]), end)] if end > times[0] + 1 else []
    return found
