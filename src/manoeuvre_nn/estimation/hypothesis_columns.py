"""A hypothesis as columns of every run: what its effects add, and what becomes of the errors of coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.estimation.changed_coefficients import changed_base
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import (
    Beside,
    added_accelerations,
    beside_it,
    contribution,
    feels_acceleration,
    hulls_beside,
)
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns, joined
from manoeuvre_nn.estimation.linearised_run import LinearisedRun
from manoeuvre_nn.estimation.posterior import Posterior
from manoeuvre_nn.estimation.rudder_blades import behind_record, blades


@dataclass(frozen=True)
class HypothesisColumns:
    """A hypothesis as columns of every run: what it adds at its values, and per unit of every unknown.

    Attributes:
        hypothesis: It.
        columns: Columns of each run.
        index: Where each run's columns stand among ``count``.
        count: Number of columns of all runs.
        turned: Base columns of each run as effects that multiply coefficients have them, as combinations of those of
            calm water (:func:`.changed_base`); empty without such effects.
        known: Grid point -> what the runs say there, once it was asked for.
    """

    hypothesis: Hypothesis
    columns: list[Columns]
    index: list[Int[np.ndarray, " k"]]
    count: int
    turned: tuple[Float[np.ndarray, "b b"], ...] = field(default=(), repr=False)
    known: dict[int, Posterior] = field(default_factory=dict, repr=False)

    def of_base(self, run: int, shares: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
        """Shares of a run's base columns as this hypothesis has them -> of the columns as they are in calm water."""
        return self.turned[run] @ shares if self.turned else shares

    def turn(self, run: int, products: Float[np.ndarray, "p q"], *, gram: bool = False) -> Float[np.ndarray, "p q"]:
        """Inner products of a run's base columns in calm water, and of others after them -> of those of the hypothesis.

        Args:
            run: Number of the run.
            products: One row a column.
            gram: Whether they are with the same columns.

        Returns:
            ``S^T products``, or ``S^T products S``, the other columns as they are.
        """
        if not self.turned:
            return products
        s, made = self.turned[run], products.copy()
        made[: len(s)] = s.T @ made[: len(s)]
        if gram:
            made[:, : len(s)] = made[:, : len(s)] @ s
        return made


def hypothesis_columns(data_set: WhitenedDataSet, hypothesis: Hypothesis) -> HypothesisColumns:
    """Columns of a hypothesis: one of the whole contribution, one an unknown by central differences."""
    runs, unknowns = data_set.runs, hypothesis.unknowns()
    parts: list[list[Columns]] = [[] for _ in runs]
    index: list[list[int]] = [[0] for _ in runs]
    here = [[v[run] for v in hypothesis.values] for run in range(len(runs))]
    lines = [behind_record(p.linearised, hypothesis.effects, v) for p, v in zip(runs, here, strict=True)]
    for k, effect in enumerate(hypothesis.effects):
        mine = [[i for i, f in enumerate(unknowns) if f.effect == k and r in f.runs] for r in range(len(runs))]
        tables = [
            _table(effect.steady(values), {unknowns[i].column: unknowns[i].parameter for i in at})
            for values, at in zip(hypothesis.values[k], mine, strict=True)
        ]
        angles = blades(effect, tables, lines)
        for run, line in enumerate(lines):
            beside = beside_it(hypothesis.effects, here[run], k, line)
            c = contribution(effect, tables[run], line, angles[run], beside)
            for driven in _driven(hypothesis.effects, here[run], k, tables[run], line):
                c = c + driven
            changed = range(len(mine[run])), [unknowns[i].column for i in mine[run]]
            steps = tables[run][1::2][changed] - tables[run][2::2][changed]
            # The effect at its values, then (up - down) / step of every unknown.
            parts[run].append(joined([c[:1], (c[1::2] - c[2::2]) / steps]))
            index[run] += [1 + i for i in mine[run]]
    columns = [_summed_up(of_run) if of_run else p.base[:1] - p.base[:1] for of_run, p in zip(parts, runs, strict=True)]
    turned = changed_base(data_set, hypothesis)
    return HypothesisColumns(hypothesis, columns, [np.array(at) for at in index], 1 + len(unknowns), turned)


def _driven(
    effects: Sequence[Effect],
    values: Sequence[Float[np.ndarray, " p"]],
    number: int,
    table: Float[np.ndarray, "k p"],
    linearised: LinearisedRun,
) -> list[Columns]:
    """What several values of an effect, each beside the first, change in what the others add whose states it drives."""
    made: list[Columns] = []
    if effects[number].memory or len(table) == 1:
        return made
    for other, (effect, value) in enumerate(zip(effects, values, strict=True)):
        if other != number and feels_acceleration(effect, linearised):
            beside = beside_it(effects, values, other, linearised)
            own = Beside(hulls_beside(effects, values, number))
            rows = added_accelerations(effects[number], table, linearised, own)
            driven = beside.with_more(rows - rows[:1])
            c = contribution(effect, np.tile(value, (len(table), 1)), linearised, beside=driven)
            made.append(c - c[:1])
    return made


def _table(values: Float[np.ndarray, " p"], unknowns: Mapping[int, Parameter]) -> Float[np.ndarray, "k p"]:
    """An effect's values, and a row above and one below for every unknown (column -> parameter) of a run."""
    table = np.tile(values, (1 + 2 * len(unknowns), 1))
    for j, (column, parameter) in enumerate(unknowns.items()):
        table[1 + 2 * j, column], table[2 + 2 * j, column] = _apart(parameter, values[column])
    return table


def _apart(p: Parameter, value: float) -> tuple[float, float]:
    """Values above and below for the difference quotient, within bounds."""
    step = 0.5 if p.period else (2.0 if p.is_time else 0.02 * p.spread)
    if p.period:
        return value + step, value - step
    return min(value + step, p.high), max(value - step, p.low)


def _summed_up(effects: Sequence[Columns]) -> Columns:
    """Contributions of all effects as one column, then the columns of their unknowns."""
    if len(effects) == 1:
        return effects[0]
    whole = effects[0][:1]
    for c in effects[1:]:
        whole = whole + c[:1]
    return joined([whole, *(c[1:] for c in effects)])
