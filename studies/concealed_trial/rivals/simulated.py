"""Cases of our own shelf to learn from: effects, coefficients, rough water and noise drawn, all sailed in one batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import torch
from jaxtyping import Float
from scipy.signal import lfilter
from torch import Tensor

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from studies.concealed_trial.rivals.mixed import Block, MixedEffect, ScatteredShip
from studies.concealed_trial.rivals.others import others
from studies.concealed_trial.rivals.package import (
    FIRST_NOISE,
    CalmWater,
    Corrections,
    Solution,
    Vessel,
    process_time,
    rollout,
    shelf,
    typical_rates,
    with_measured,
)

SHARES = {"none": 0.15, "single": 0.60, "pair": 0.13, "unknown": 0.12}
"""How many cases of each sort are drawn."""
SIZES = (0.1, 4.0)
"""Range of an effect's size over a usual one; drawn evenly on a logarithmic scale."""
COEFFICIENTS, ROUGH_WATER = (0.03, 0.06), (0.0, 0.03)
"""Ranges of the relative error of the coefficients, and of the coloured force over usual forces."""
APPROACH_S, LENGTH = 60.0, 24.0
"""Steady approach [s], and length of a run over L/U0."""
ANGLES_DEG = {"turning_circle": (10.0, 35.0), "zigzag": (10.0, 30.0)}
"""Rudder angles of the runs."""
STEP_S = 2.0
"""Step of the rollouts [s]; between them states are taken as straight, at one sample a second."""
GUSTS = 2
"""Courses of gusts that the cases of a batch share."""


@dataclass(frozen=True)
class SimulatedCase:
    """A case to learn from.

    Attributes:
        ship: Name of the ship.
        runs: Its runs.
        values: Name of each effect, with its parameters' values; ``unknown`` has none.
    """

    ship: str
    runs: tuple[Recording, ...]
    values: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class _Plan:
    """The cases of a batch before they are sailed: effects of each, first row and number of runs."""

    effects: list[tuple[Effect, ...]]
    runs: list[int]

    @property
    def rows(self) -> list[slice]:
        """Rows of every case."""
        ends = list(accumulate(self.runs, initial=0))
        return [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]


def simulate_cases(ship: Ship, name: str, count: int, seed: int) -> list[SimulatedCase]:
    """Draw and sail cases of one ship.

    Args:
        ship: The ship.
        name: Its name in manifests.
        count: How many.
        seed: Seed.

    Returns:
        The cases; those that left the physical range are left out.
    """
    rng = np.random.default_rng([seed, len(name), count])
    plan = _plan(rng, ship, count)
    manoeuvres = [m for runs in plan.runs for m in _manoeuvres(rng, ship, runs)]
    seconds = round(LENGTH * ship.particulars.time_unit)
    chosen, values = _drawn(rng, ship, plan, seconds)
    with torch.inference_mode():
        errors = _errors(rng, ship, plan, seconds)
        sailed = _sailed(errors, _blocks(chosen, values, plan), manoeuvres, rng, seconds)
        measured = _measured(ship, sailed, _blocks(chosen, values, plan, sampled=True), rng, plan)
    found = []
    for k, rows in enumerate(plan.rows):
        if torch.isfinite(sailed.ended[rows]).any():
            continue
        runs = tuple(_recording(sailed, measured, row) for row in range(rows.start, rows.stop))
        found.append(
            SimulatedCase(name, runs, {e.name: v for e, v in zip(chosen[k], _told(chosen, values, k), strict=True)})
        )
    return found


def _plan(rng: np.random.Generator, ship: Ship, count: int) -> _Plan:
    """Which effects the cases have: names in turn, so that none is rare; cases sorted by their first effect."""
    listed, strange = shelf(ship), others(ship)
    gusty = [type(e)(ship, seed=k) for e in listed if e.random for k in range(GUSTS)]  # type: ignore[call-arg]
    sorts = rng.choice(list(SHARES), count, p=list(SHARES.values()))
    cases: list[tuple[Effect, ...]] = []
    for k, sort in enumerate(sorts):
        first = listed[k % len(listed)]
        if first.random:
            first = gusty[int(rng.integers(len(gusty)))]
        if sort == "pair":
            fits = [e for e in listed if e.family != first.family and not e.random]
            cases.append((first, fits[int(rng.integers(len(fits)))]))
        else:
            by_sort = {"none": (), "single": (first,), "unknown": (strange[k % len(strange)],)}
            cases.append(by_sort[str(sort)])
    cases.sort(key=lambda effects: [(e.name, id(e)) for e in effects])
    return _Plan(cases, [int(rng.choice([2, 3, 3])) for _ in cases])


def _manoeuvres(rng: np.random.Generator, ship: Ship, runs: int) -> list[Manoeuvre]:
    """A turn, a zigzag and perhaps one more of either, each after a steady approach."""
    kinds = ["turning_circle", "zigzag", str(rng.choice(["turning_circle", "zigzag"]))][:runs]
    duration, made = float(round(LENGTH * ship.particulars.time_unit)), []
    for kind in kinds:
        angle, side = DEGREE * 5.0 * round(float(rng.uniform(*ANGLES_DEG[kind])) / 5.0), int(rng.choice([-1, 1]))
        angle = min(angle, ship.particulars.rudder_limit)
        stages = [Stage(side * angle)]
        if kind == "zigzag":
            turns = [side * (-1) ** k for k in range(20)]
            stages = [Stage(s * angle, heading=s * angle, direction=s) for s in turns] + [Stage(0.0)]
        made.append(Manoeuvre(kind, kind, (Stage(0.0, hold=APPROACH_S), *stages), duration=duration))
    return made


def _drawn(
    rng: np.random.Generator, ship: Ship, plan: _Plan, seconds: int
) -> tuple[list[tuple[Effect, ...]], list[list[np.ndarray]]]:
    """Effects of the cases and their values, one row a run."""
    values = [
        [_values(rng, ship, e, runs, seconds) for e in effects]
        for effects, runs in zip(plan.effects, plan.runs, strict=True)
    ]
    return plan.effects, values


def _values(rng: np.random.Generator, ship: Ship, effect: Effect, runs: int, seconds: int) -> np.ndarray:
    """Values of an effect in every run: sizes over the range of the shelf, formulas as uncertain as it says."""
    table = np.zeros((runs, len(effect.declared)))
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    begin = rng.uniform(min(80.0, 0.3 * seconds), 0.45 * seconds, runs)
    for k, p in enumerate(effect.declared):
        if p.per_run and not np.isfinite(p.starts[0]):
            table[:, k] = p.starts[0]  # events have one interval
            continue
        if p.per_run:
            table[:, k] = begin if p.name == "start_s" else begin + rng.uniform(0.22, 0.4, runs) * seconds
        elif p.name == effect.random[0] if effect.random else False:
            table[:, k] = rng.uniform(0.1, 0.25) * table[0, 0]
        else:
            table[:, k] = _value(rng, p, size)
        table[:, k] = np.clip(table[:, k], p.low, p.high)
    return table


def _value(rng: np.random.Generator, p: Parameter, size: float) -> float:
    """One value: a direction, a form, or so many times the usual size."""
    if p.period:
        return float(rng.uniform(0.0, p.period))
    if p.form and p.null is not None:
        return p.null + p.spread * float(rng.standard_normal())
    start = float(rng.choice(p.starts))
    if p.random:
        return start * float(np.exp(0.4 * rng.standard_normal()))
    if start == p.null:
        return start + p.spread * float(rng.standard_normal())
    if p.null is None:
        # Without a null: a depth, effective where it is little more than the draught; else a lever or a time.
        return p.low / 1.15 * (1 + 1 / size) if p.low > 0 and p.unit == "m" else p.spread * float(rng.standard_normal())
    if p.low > 0:
        return p.null / max(1 + size * (p.null / start - 1), 1e-3)
    return p.null + size * (start - p.null)


def _told(chosen: list[tuple[Effect, ...]], values: list[list[np.ndarray]], k: int) -> list[dict[str, float]]:
    """Parameters of a case's effects that an answer reports."""
    return [
        {p.name: float(table[0, j]) for j, p in enumerate(e.declared) if not p.form and not p.per_run}
        for e, table in zip(chosen[k], values[k], strict=True)
    ]


def _blocks(
    chosen: list[tuple[Effect, ...]], values: list[list[np.ndarray]], plan: _Plan, sampled: bool = False
) -> list[list[Block]]:
    """Blocks of first and of second effects: neighbours with the same effect together."""
    layers: list[list[Block]] = []
    for layer in range(2):
        found: list[tuple[Effect, int, int, list[np.ndarray]]] = []
        for effects, tables, rows in zip(chosen, values, plan.rows, strict=True):
            if len(effects) <= layer:
                continue
            if found and found[-1][0] is effects[layer] and found[-1][2] == rows.start:
                effect, start, _, before = found.pop()
                found.append((effect, start, rows.stop, [*before, tables[layer]]))
            else:
                found.append((effects[layer], rows.start, rows.stop, [tables[layer]]))
        stacked = [(e, a, b, torch.as_tensor(np.concatenate(t)).to(e.values)) for e, a, b, t in found]
        layers.append([(slice(a, b), e.at(t[:, None] if sampled else t)) for e, a, b, t in stacked])
    return layers


def _errors(rng: np.random.Generator, ship: Ship, plan: _Plan, seconds: int) -> ScatteredShip:
    """The ship with errors of the coefficients by cases and a coloured force by runs."""
    calm, like = CalmWater(ship), ship.inertia
    count = len(Corrections(calm).names)
    shares = [rng.uniform(*COEFFICIENTS) * rng.standard_normal((1, count)).repeat(n, axis=0) for n in plan.runs]
    size = np.concatenate([np.full(n, rng.uniform(*ROUGH_WATER)) for n in plan.runs])
    keep = np.exp(-1.0 / process_time(calm))
    kicks = rng.standard_normal((len(size), seconds + 1, 3)) * np.sqrt(1 - keep**2)
    rough = lfilter([1.0], [1.0, -keep], kicks, axis=1) * size[:, None, None] * np.asarray(typical_rates(calm))
    return ScatteredShip(calm, like.new_tensor(np.concatenate(shares)), like.new_tensor(rough))


def _sailed(
    ship: ScatteredShip, layers: Sequence[Sequence[Block]], manoeuvres: Sequence[Manoeuvre], rng: np.random.Generator,
    seconds: int,
) -> Solution:  # fmt: skip
    """All runs, each from a heading of its own."""
    vessel = Vessel(ship, [MixedEffect(ship.hull, layer) for layer in layers])
    start = ship.shares.new_zeros(len(manoeuvres), 6)
    start[:, 0] = ship.particulars.speed
    inputs = Inputs(vessel.gear.at_rest(start[:, 0] * 0)[..., -1], time=start[:, 0] * 0)
    whole = vessel.model.start(start, inputs)
    whole[:, 5] = torch.as_tensor(rng.uniform(0.0, 2 * np.pi, len(start))).to(start)
    return _by_seconds(
        rollout(vessel, manoeuvres, whole, torch.arange(0.0, seconds + 1, STEP_S).to(start), step=STEP_S)
    )


def _by_seconds(sailed: Solution) -> Solution:
    """Samples of every second, in a straight line between those of every other."""

    def filled(x: Tensor) -> Tensor:
        out = x.new_empty(2 * len(x) - 1, *x.shape[1:])
        out[::2], out[1::2] = x, 0.5 * (x[1:] + x[:-1])
        return out

    inputs = Inputs(**{name: filled(values) for name, values in sailed.inputs.given.items()})
    times, states, shown, orders = (filled(x) for x in (sailed.times, sailed.states, sailed.shown, sailed.orders))
    return Solution(times, states, shown, orders, inputs, sailed.ended)


def _measured(
    ship: Ship, sailed: Solution, layers: Sequence[Sequence[Block]], rng: np.random.Generator, plan: _Plan
) -> dict[str, Float[np.ndarray, "rows n"]]:
    """What recorders write, with delay and noise of every case."""
    vessel = Vessel(CalmWater(ship), [MixedEffect(ship, layer) for layer in layers])
    states, shown = sailed.states.transpose(0, 1), sailed.shown.T
    inputs = Inputs(**{name: values.T for name, values in sailed.inputs.given.items()})
    wet = vessel.situation(states, inputs)
    seen = vessel.sensors.record(wet, vessel.model(states, inputs), shown)
    channels = {name: seen[name].double().numpy() for name in ("x", "y", "vn", "ve", "psi", "r", "u_log", "shaft")}
    channels["delta"] = seen["delta"].double().numpy()
    late = np.concatenate([np.full(n, rng.uniform(0.0, 0.5)) for n in plan.runs])[:, None]
    level = np.concatenate([rng.uniform(0.8, 1.3, (1, len(MEASURED))).repeat(n, axis=0) for n in plan.runs])
    for k, name in enumerate(MEASURED):
        values = channels["shaft" if name == "shaft_recorded" else name]
        if name in {"x", "y", "vn", "ve"}:
            values = values - late * np.gradient(values, axis=1)
        noise = level[:, [k]] * FIRST_NOISE[k] * rng.standard_normal(values.shape)
        channels[name] = values + noise
    return channels


def _recording(sailed: Solution, measured: Mapping[str, np.ndarray], row: int) -> Recording:
    """One run as a case holds it."""
    time = sailed.times.double().numpy()
    still = np.zeros(len(time))
    order = sailed.orders[:, row].double().numpy()
    inputs = {"delta": measured["delta"][row], "delta_order": order, "order_lead": still, "shaft": 1 + still}
    run = Recording(f"r{row}", time, inputs, meta={"rudder_noise": 0.0, "kind": ""})
    return with_measured(run, np.stack([measured[name][row] for name in MEASURED], axis=-1))
