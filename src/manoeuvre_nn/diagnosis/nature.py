"""What something unknown is like: random, periodic, lagging, growing, tied to place, heading or motion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.diagnosis.claims import SURE_BY_ITSELF
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.locate import in_units, shape_of, unit_forces, units
from manoeuvre_nn.diagnosis.result import PHASE, Nature, Residual, Value
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.diagnosis.unknown import RandomCourse, random_force
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.effect.formula import (
    BY_RUN,
    DRIFT_TIME_S,
    GROWING,
    LAG,
    PERIODIC,
    STRIPES,
    Formula,
    mark_of,
    places_of,
)
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import own_states
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis

AGAIN = "periodic"
KINDS = {LAG: "lagging", PERIODIC: AGAIN, BY_RUN: AGAIN, STRIPES: "tied to the place", GROWING: "growing"}
"""Mark of a term -> kind of force."""
RANDOM, HEADING, MOTION, INSTRUMENT = "random", "tied to the heading", "tied to the motion", "in an instrument"
CONSTANT = "constant"
MUCH_LIKELIER = 12.0
"""Log evidence by which a formula that failed in runs that were not used is told all the same."""


def nature_of(
    tried: SearchResult, verdict: Decision, found: Sequence[Residual], proved: bool | None, held_out: float = 0.0
) -> Nature | None:
    """Say what something unknown is like.

    Args:
        tried: The search.
        verdict: With a formula.
        found: Missing force of the fitted runs.
        proved: Whether the formula predicts runs that were not used; None if that was not tried.
        held_out: What the log evidence of these runs gains by it: one with enough by itself tells where and how
            something acts though free runs go further off with it, as far as its phase may be another there.

    Returns:
        Its nature: by a formula that is proved, not by one that failed unless it is much likelier, else by the likelier
        of formula and random force. None where there is neither.
    """
    data_set, formula = tried.likelihood.data_set, verdict.formula
    random = None if is_fitted(data_set.dynamics) else random_force(tried.likelihood, tried.none)
    calm = tried.none.evidence
    by_rule = -np.inf if formula is None else formula.evidence
    by_chance = -np.inf if random is None else random.evidence
    # What fails in other runs may still be no random force: its phase may be another there.
    much = by_rule > by_chance + MUCH_LIKELIER
    likelier = by_rule > max(by_chance, calm) and (proved is None or random is None or much)
    if formula is not None and (proved or likelier):
        nature = _by_rule(data_set, formula, by_rule - max(by_chance, calm))
    elif random is not None:
        nature = _by_chance(data_set, random, by_chance - max(by_rule, calm))
    else:
        return None
    shape = shape_of(data_set, found)
    hard = shape.hard[0] if shape.hard else float("nan")
    failed = nature.predictable and proved is False
    borne_out = failed and held_out > SURE_BY_ITSELF
    clearest = () if random is None else tuple("XYN"[k] for k in random.axes)
    told = replace(nature, frame=shape.frame, parity=shape.parity, regime=hard, clearest=clearest)
    return replace(told, refuted=failed and not borne_out, predictable=nature.predictable and not borne_out)


def _by_chance(data_set: WhitenedDataSet, random: RandomCourse, against: float) -> Nature:
    """A random force with its size and correlation time."""
    axis = random.axes[0]
    size = random.size * float(unit_forces(data_set)[axis])
    return Nature(
        RANDOM,
        tuple("XYN"[k] for k in random.axes),
        Value("standard deviation", size, size * random.errors[0], units(data_set)[axis], low=0.0),
        (Value("correlation time", random.time, random.time * random.errors[1], "s", low=0.0),),
        float(against),
        predictable=False,
    )


def _by_rule(data_set: WhitenedDataSet, formula: FittedHypothesis, against: float) -> Nature:
    """The kind of the clearest terms of a formula, with their size and time scale."""
    effect = formula.hypothesis.effects[0]
    assert isinstance(effect, Formula)
    unknowns, found = formula.hypothesis.unknowns(), formula.hypothesis.vector().tolist()
    # Of what is each run's own the first run's are told, and all count for how clear a term is.
    first = [k for k, f in enumerate(unknowns) if 0 in f.runs]
    values, errors = ({unknowns[k].parameter.name: float(of[k]) for k in first} for of in (found, formula.errors))
    clear = np.zeros(len(effect.terms))
    for f, value, error in zip(unknowns, found, formula.errors, strict=True):
        if f.column < len(clear):
            clear[f.column] += (value / max(error, 1e-12)) ** 2
    kinds = [_kind(term) for term in effect.terms]
    kind = max(set(kinds), key=lambda name: clear[[k == name for k in kinds]].sum())
    leading = np.array([k == kind for k in kinds])
    where = tuple(dict.fromkeys(p for t, mine in zip(effect.terms, leading, strict=True) if mine for p in places_of(t)))
    relative = 1 / np.sqrt(clear[leading].sum())
    size, unit = _size(data_set, formula, leading)
    if kind == AGAIN:
        size *= 2**0.5
    name = "amplitude" if kind == AGAIN else "root mean square"
    return Nature(
        kind, where, Value(name, size, size * float(relative), unit, low=0.0),
        _scales(data_set, effect, kind, values, errors), float(against),
    )  # fmt: skip


def _kind(term: str) -> str:
    """What a term is like."""
    if term.startswith("sensor"):
        return INSTRUMENT
    shape = term.partition(" ")[2]
    return KINDS.get(mark_of(term), HEADING if "psi" in term else CONSTANT if shape == "1" else MOTION)


def _size(
    data_set: WhitenedDataSet, formula: FittedHypothesis, leading: Float[np.ndarray, " terms"]
) -> tuple[float, str]:
    """Root mean square over the fitted runs of what some terms of a formula add, and its unit."""
    effect, scale = formula.hypothesis.effects[0], in_units(data_set)
    values, forces = formula.hypothesis.values[0].copy(), []
    values[:, : len(leading)] *= leading
    for row, prepared in zip(values, data_set.runs, strict=True):
        acting, s = effect.at(torch.tensor(row)[None]), prepared.linearised.situation
        with torch.no_grad():
            memory = own_states(acting, s, 1, prepared.linearised.run.step)
            forces.append(scale(acting.acceleration(s, memory).reshape(len(s.psi), 3).numpy()))
    rms = np.sqrt(np.mean(np.concatenate(forces) ** 2, axis=0))
    axis = int((rms / np.maximum(unit_forces(data_set), 1e-30)).argmax())
    return float(rms[axis]), units(data_set)[axis]


def _scales(
    data_set: WhitenedDataSet,
    effect: Formula,
    kind: str,
    values: Mapping[str, float],
    errors: Mapping[str, float],
) -> tuple[Value, ...]:
    """What is told of a kind beside its size."""
    if kind == KINDS[LAG]:
        return (Value("memory", values["memory_s"], errors["memory_s"], "s", low=0.0),)
    if kind == KINDS[GROWING]:
        at, term = next((f"w{k + 1}", t) for k, t in enumerate(effect.terms) if mark_of(t) == GROWING)
        axis = "XYN".index(term[0])
        minute = 60 / DRIFT_TIME_S * float(unit_forces(data_set)[axis])
        return (Value("growth a minute", minute * values[at], minute * errors[at], units(data_set)[axis]),)
    if kind not in (AGAIN, KINDS[STRIPES]):
        return ()
    period = (Value("period", values["period_s"], errors["period_s"], "s", low=0.0),) if kind == AGAIN else ()
    mark = next(mark_of(term) for term in effect.terms if KINDS.get(mark_of(term)) == kind)
    if mark == BY_RUN:
        return period
    waves = {t.split(" ")[1]: f"w{k + 1}" for k, t in enumerate(effect.terms) if mark_of(t) == mark}
    a, b = (values.get(waves.get(w, ""), 0.0) for w in ("cos", "sin"))
    error_a, error_b = (errors.get(waves.get(w, ""), 0.0) for w in ("cos", "sin"))
    turn = np.degrees(np.hypot(a * error_b, b * error_a) / np.hypot(a, b) ** 2)
    phase = Value(PHASE, float(np.degrees(np.arctan2(a, b))) % 360, float(turn), "deg", period=360.0)
    if period:
        return (*period, phase)
    k = np.array([values["north_per_km"], values["east_per_km"]])
    e = np.array([errors["north_per_km"], errors["east_per_km"]])
    number = float(np.hypot(*k))
    along, across = float(np.hypot(*(k * e)) / number), float(np.hypot(*(k[::-1] * e)) / number)
    return (
        Value("spacing", 1000 / number, 1000 * along / number**2, "m", low=0.0),
        Value(
            "across",
            float(np.degrees(np.arctan2(k[1], k[0]))) % 180,
            float(np.degrees(across / number)),
            "deg",
            period=180.0,
        ),
    )
