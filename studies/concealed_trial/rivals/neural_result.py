"""What the networks say of a case, in the form of the other methods."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from studies.concealed_trial.rivals.events import NEVER, placed, timed
from studies.concealed_trial.rivals.examples import STRANGE, names
from studies.concealed_trial.rivals.features import features
from studies.concealed_trial.rivals.neural import NeuralDiagnosis
from studies.concealed_trial.rivals.package import CalmWater, Case, Hypothesis
from studies.concealed_trial.rivals.result import TEMPERATURE, Limits, RivalResult
from studies.concealed_trial.rivals.search import LeastSquaresFit
from studies.concealed_trial.rivals.whitened import WhitenedRuns

NAMES, FIRST_NAMES = 12, 5
"""Names that parameters are drawn for, and that are looked at two by two."""
LEAST = 1e-6
"""Smallest distance of a probability from 0 and 1."""
TIMED_FROM = 0.05
"""Probability from which the times of an event are looked for."""


def judge_by_network(case: Case, learnt: NeuralDiagnosis, effects: Sequence[Effect]) -> RivalResult:
    """Names by the classifier, parameters by the posteriors, times of events on a grid.

    Args:
        case: The case.
        learnt: What was learnt.
        effects: Prototypes of the candidates.

    Returns:
        What is found.
    """
    calm = CalmWater(case.hull)
    data = WhitenedRuns(calm, case.fitted, at_samples=True)  # as in the examples
    seen = features(data)
    found = np.clip(learnt.probabilities(seen[None])[0], LEAST, 1 - LEAST)
    p = {name: float(q) for name, q in zip(names(), found, strict=True)}
    left = data.evaluate(Hypothesis((), ()))[0]
    none = LeastSquaresFit(Hypothesis((), ()), left, _cost(p, ()), np.zeros((0, 0)))
    by_name = {e.name: e for e in effects}
    ranked = sorted(by_name, key=lambda name: -p[name])[:NAMES]
    fits = {name: _fit(data, learnt, by_name[name], p[name], left) for name in ranked}
    sets: list[tuple[str, ...]] = [(name,) for name in ranked]
    for pair in combinations(ranked[:FIRST_NAMES], 2):
        one, two = (fits[name].hypothesis.effects[0] for name in pair)
        if one.family != two.family:
            sets.append(pair)
    all_fits = sorted((_joined([fits[n] for n in one], _cost(p, one)) for one in sets), key=lambda f: f.criterion)
    strange = float(np.log(p[STRANGE] / (1 - p[STRANGE])))
    rest = strange if p[STRANGE] > p[ranked[0]] else -np.inf
    evidence = Limits(none.criterion - all_fits[0].criterion, strange)
    return RivalResult(data, none, all_fits, all_fits[0], evidence, float(rest), p)


def _cost(p: dict[str, float], acting: tuple[str, ...]) -> float:
    """Minus twice the log probability that these and no others act, in the units of the criteria."""
    listed = (name for name in p if name != STRANGE)
    return float(-2 * TEMPERATURE * sum(np.log(p[name] if name in acting else 1 - p[name]) for name in listed))


def _fit(
    data: WhitenedRuns, learnt: NeuralDiagnosis, effect: Effect, p: float, left: Float[np.ndarray, "n rows"]
) -> LeastSquaresFit:
    """An effect at the middle of its posterior."""
    assert learnt.posteriors is not None
    drawn = learnt.posteriors(data, effect)
    row = effect.null().double().numpy().copy()
    error = np.zeros(len(row))
    for k, q in enumerate(effect.declared):
        if q.name in drawn:
            row[k], error[k] = _middle(drawn[q.name], q.period)
        elif q.per_run:
            row[k] = NEVER
        elif not q.form and q.null is None:
            row[k] = q.starts[0]
    table = np.repeat(row[None], len(data.tracks), axis=0)
    if timed(effect) and p > TIMED_FROM:
        table, _ = placed(data, Hypothesis((), ()), effect, row, scaled=False)
    h = Hypothesis((effect,), (table,))
    spread = np.diag([error[f.column] ** 2 for f in h.unknowns()])
    return LeastSquaresFit(h, left, 0.0, spread)


def _middle(drawn: Float[np.ndarray, " n"], period: float | None) -> tuple[float, float]:
    """Median and standard deviation of draws; those of directions on the circle."""
    if period is None:
        low, middle, high = np.percentile(drawn, [16, 50, 84])
        return float(middle), float(0.5 * (high - low))
    turn = np.exp(2j * np.pi * drawn / period).mean()
    length = max(min(abs(turn), 1 - 1e-9), 1e-3)
    return float(np.angle(turn) * period / (2 * np.pi) % period), float(
        np.sqrt(-2 * np.log(length)) * period / (2 * np.pi)
    )


def _joined(fits: Sequence[LeastSquaresFit], cost: float) -> LeastSquaresFit:
    """Several effects together, each as it is alone."""
    h = fits[0].hypothesis
    for fit in fits[1:]:
        h = h.joined(fit.hypothesis)
    size = sum(len(fit.spread) for fit in fits)
    spread, at = np.zeros((size, size)), 0
    for fit in fits:
        part = slice(at, at + len(fit.spread))
        spread[part, part], at = fit.spread, part.stop
    return LeastSquaresFit(h, fits[0].left, cost, spread)
