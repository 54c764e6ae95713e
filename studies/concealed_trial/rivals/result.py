"""What a rival method says of a case: names by the criterion, alarms by limits from clean cases, predictions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from studies.concealed_trial.rivals.events import placed, timed
from studies.concealed_trial.rivals.package import (
    Calibrated,
    Case,
    Cause,
    Diagnosis,
    Hypothesis,
    Interval,
    Proof,
    Value,
    errors,
    predict,
    recorded,
)
from studies.concealed_trial.rivals.search import LeastSquaresFit
from studies.concealed_trial.rivals.track import LATENCY, ROWS
from studies.concealed_trial.rivals.whitened import WhitenedRuns

TEMPERATURE = 3.0
"""Criteria are divided by it before they become probabilities: they are too sure of themselves."""
EXPLAINED = 0.5
"""Share of the unusual misfit that an effect must explain to be named where it leaves an unusual rest."""
SURE, DOUBT = 0.9, 0.1
"""Probability that something is there after an alarm, and without one."""
PLACES = ("X", "Y", "N", "sensor:u_log", "sensor:r", "actuator:propeller")
"""Row -> where something unknown sits that shows there."""


@dataclass(frozen=True)
class Limits:
    """What clean cases reach.

    Attributes:
        gain: Gain of the criterion by the best effects.
        misfit: Deviance a sample that calm water leaves.
    """

    gain: float
    misfit: float


@dataclass(frozen=True)
class RivalResult:
    """All fits to a case.

    Attributes:
        data: The runs.
        none: Calm water as the method sees it.
        fits: Everything else, best first.
        best: The first of them as it fits the recordings themselves.
        evidence: Gain and misfit, to be held against those of clean cases.
        rest: Misfit that the best leaves.
        probabilities: Of every name, where the method gives its own; None takes them from the criteria.
    """

    data: WhitenedRuns
    none: LeastSquaresFit
    fits: list[LeastSquaresFit]
    best: LeastSquaresFit
    evidence: Limits
    rest: float
    probabilities: Mapping[str, float] | None = None

    def verdict(self, limits: Limits) -> str:
        """What there is.

        Args:
            limits: What clean cases reach.

        Returns:
            ``none``, ``named``, or ``unknown`` where the best effects leave most of what is unusual.
        """
        if self.evidence.gain <= limits.gain and self.evidence.misfit <= limits.misfit:
            return "none"
        unusual, rest = self.evidence.misfit - limits.misfit, self.rest - limits.misfit
        return "unknown" if rest > max(0.0, (1 - EXPLAINED) * unusual) else "named"


def compared(
    data: WhitenedRuns, none: LeastSquaresFit, fits: list[LeastSquaresFit], best: LeastSquaresFit | None = None
) -> RivalResult:
    """A result by the criteria of all fits.

    Args:
        data: The runs.
        none: Calm water as the method sees it.
        fits: Everything else, best first.
        best: The first of them as it fits the recordings themselves; None is the same.

    Returns:
        The result.
    """
    evidence = Limits(none.criterion - fits[0].criterion, none.misfit)
    return RivalResult(data, none, fits, best or fits[0], evidence, fits[0].misfit)


def diagnosis(case: Case, found: RivalResult, limits: Limits) -> Diagnosis:
    """A result as an answer.

    Args:
        case: The case.
        found: What was found.
        limits: What clean cases reach.

    Returns:
        Verdict, causes, and the held-out runs before and after.
    """
    verdict = found.verdict(limits)
    named = found.best.hypothesis if verdict == "named" else Hypothesis((), ())
    tables, elsewhere = _held_out(case, found, named)
    return Diagnosis(
        case=case.name, ship=case.ship, verdict="none" if verdict == "none" else "mismatch", sentence="",
        causes=_causes(case, found, verdict, elsewhere), model=list(named.names), alias={},
        sites={}, statements=[], residuals=[], checks=[], runner_up=[], proofs=_proofs(case, found, named, tables),
        noise={}, next_steps=[], undecided=list(case.undecided),
    )  # fmt: skip


def _held_out(case: Case, found: RivalResult, named: Hypothesis) -> tuple[list[np.ndarray], dict[str, np.ndarray]]:
    """Values of the named effects in every held-out run, times of events found there; those of events by name."""
    tables = [np.repeat(v[:1], len(case.held_out), axis=0) for v in named.values]
    events: dict[str, np.ndarray] = {}
    if case.held_out and any(timed(e) for e in named.effects):
        there = WhitenedRuns(found.data.dynamics, case.held_out)
        for k, effect in enumerate(named.effects):
            if timed(effect):
                others = [j for j in range(len(tables)) if j != k]
                rest = Hypothesis(tuple(named.effects[j] for j in others), tuple(tables[j] for j in others))
                tables[k], _ = placed(there, rest, effect, tables[k][0], scaled=False)
                events[effect.name] = tables[k]
    return tables, events


def _proofs(case: Case, found: RivalResult, named: Hypothesis, tables: list[np.ndarray]) -> list[Proof]:
    """Held-out runs predicted before and after; where something is named, coefficients are corrected too."""
    if not case.held_out:
        return []
    calm = found.data.dynamics
    before = after = predict(calm, Hypothesis((), ()), case.held_out, case.warmup)
    if named.effects:
        shares = case.hull.inertia.new_tensor(found.data.shares(found.best.hypothesis))
        there = Hypothesis(named.effects, tuple(tables))
        after = predict(Calibrated(calm, shares), there, case.held_out, case.warmup, LATENCY)
    records = [recorded(run, case.warmup) for run in case.held_out]
    rows = zip(case.held_out, before, after, records, strict=True)
    return [Proof(run.name, run.meta["kind"], seen, b, a, errors(b, seen), errors(a, seen)) for run, b, a, seen in rows]


def _causes(case: Case, found: RivalResult, verdict: str, elsewhere: dict[str, np.ndarray]) -> list[Cause]:
    """All names with their probabilities, those of the best fit first unless something unknown is more probable."""
    present, strange = DOUBT if verdict == "none" else SURE, verdict == "unknown"
    gains = np.array([f.criterion for f in found.fits])
    weight = np.exp((gains.min() - gains) / (2 * TEMPERATURE))
    weight *= present * (0.2 if strange else 1.0) / weight.sum()
    causes = []
    for name in dict.fromkeys(n for f in found.fits for n in f.names):
        probability = float(sum(w for w, f in zip(weight, found.fits, strict=True) if name in f.names))
        probability = probability if found.probabilities is None else found.probabilities[name]
        fit = found.best if name in found.best.names else next(f for f in found.fits if name in f.names)
        causes.append(_cause(case, fit, name, probability, elsewhere.get(name)))
    causes.sort(key=lambda c: (c.name not in found.best.names, -c.probability))
    row = int((found.none.left**2).mean(axis=0).argmax())
    doubt = present * (0.8 if strange else 0.05)
    doubt = doubt if found.probabilities is None else found.probabilities["unknown"]
    unknown = Cause("unknown", "something else", doubt, 0.0, (PLACES[row % len(ROWS)],), (), None, "", "")
    return [unknown, *causes] if strange else [*causes, unknown]


def _cause(case: Case, fit: LeastSquaresFit, name: str, probability: float, elsewhere: np.ndarray | None) -> Cause:
    """One effect of a fit with its parameters and times."""
    h, which = fit.hypothesis, fit.names.index(name)
    effect, table = h.effects[which], h.values[which]
    spread = np.sqrt(np.maximum(np.diag(fit.spread), 0.0))
    values = [
        Value(f.parameter.name, float(table[0, f.column]), float(error), f.parameter.unit)
        for f, error in zip(h.unknowns(), spread, strict=True)
        if f.effect == which and not f.parameter.form
    ]
    for k, p in enumerate(effect.declared):
        if p.name in effect.random[:1]:
            values.append(Value(p.name, float(table[0, k]), float(table[0, k] / np.sqrt(len(fit.left))), p.unit))
    when: dict[str, list[Interval]] | None = None
    if timed(effect):
        rows = [*table, *(elsewhere if elsewhere is not None else [])]
        when = {}
        for run, row in zip([*case.fitted, *case.held_out], rows, strict=False):
            start, end = [*row[timed(effect)], float(run.time[-1])][:2]
            when[run.name] = [(float(start), float(min(end, run.time[-1])))] if start < run.time[-1] else []
    return Cause(name, effect.label, probability, 0.0, effect.equations, tuple(values), when, "", "")
