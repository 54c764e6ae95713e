"""Ships with effects as programs: the calm-water model's formulas, and what each effect adds to them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import sympy
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.vessel import Vessel, in_words
from manoeuvre_nn.formulas.motion import CONTROLS, HEADING
from manoeuvre_nn.formulas.program import Builder, Program, Quantity, Reference, added, checked_name, singles
from manoeuvre_nn.formulas.state import OWN, rate_of
from manoeuvre_nn.formulas.tracing import Trace

TIME = Quantity("t", "s", "time since the start", high=600.0)
STREAM = (
    Quantity("c_N", "m/s", "velocity of the water over ground, north"),
    Quantity("c_E", "m/s", "velocity of the water over ground, east"),
)
CHECKED_LENGTHS = 5.0
"""Distances over L that formulas are checked within."""
NOT_MOTION = {"blade": "the steering gear", "shaft": "the engine"}
"""Method of an effect -> what it acts on, which is no part of the rate of a ship's state."""


def with_effects(calm: Program, vessel: Vessel) -> Program:
    """Accelerations of a ship with effects, and the velocity of the water where it moves.

    What a person may change of an effect is an input of the program, as a wind's speed and direction are.

    Args:
        calm: The ship without effects.
        vessel: The ship with effects.

    Returns:
        The inputs of the calm-water model, heading, place and time where an effect needs them, states of the effects'
        own and their parameters, to accelerations, the water's velocity and rates of the own states.
    """
    for effect in vessel.effects:
        _check(effect)
    effects = [e.aboard(vessel.calm.corrected(e.ship)) for e in vessel.effects]
    given = _inputs(vessel, calm, effects)
    outputs = [*calm.outputs]
    if any(e.overrides("stream") for e in effects):
        outputs += STREAM
    outputs += [rate_of(q) for q in own_states(effects)]
    build = Builder(given, outputs)
    _write(effects, build, build.go_on(calm), {q.name: q for q in given})
    steps = [step for section in build.sections for step in section.steps]
    used = set().union(*(value.free_symbols for step in steps for _, value in singles(step)))
    kept = [q for q in given if q in calm.inputs or sympy.Symbol(q.name, real=True) in used]
    words = in_words(vessel.effects)
    return replace(
        calm,
        title=f"{calm.title}, with {words}",
        inputs=kept,
        outputs=outputs,
        sections=[s for s in build.sections if s.steps],
        notes=[note.replace("Calm ", f"But for {words}, calm ", 1) for note in calm.notes],
        reference=_reference(vessel, effects, [q.name for q in kept], [q.name for q in outputs]),
        symbols=build.symbols,
        vessel=vessel,
    )


def own_states(effects: Sequence[Effect]) -> list[Quantity]:
    """States of the effects' own, as a ship's roll is to an effect of heel."""
    made: list[Quantity] = []
    for effect in effects:
        for _ in range(effect.memory):
            made.append(Quantity(f"{OWN}{len(made) + 1}", "-", f"state of {effect.label}", -0.3, 0.3))
    return made


def _check(effect: Effect) -> None:
    """Refuse an effect that does not act on the ship's motion itself."""
    acts = [what for name, what in NOT_MOTION.items() if effect.overrides(name)]
    acts += ["a sensor"] if effect.site == "sensor" else []
    if acts:
        raise InputError(
            f"effect.{effect.name} acts on {acts[0]}, which is no part of an exported model: leave it out; forces, "
            "currents and changes of the hull can be exported"
        )


def _tunable(effect: Effect) -> list[Parameter]:
    """What a person may change of an effect: not its form, and no times, by which the formulas are chosen."""
    return [p for p in effect.declared if effect.fittable and not (p.form or p.per_run or p.random)]


def _inputs(vessel: Vessel, calm: Program, effects: Sequence[Effect]) -> list[Quantity]:
    """All inputs that there may be."""
    far = CHECKED_LENGTHS * vessel.calm.particulars.length
    place = (Quantity("x", "m", "position, north", -far, far), Quantity("y", "m", "position, east", -far, far))
    heading = replace(HEADING, low=-np.pi, high=np.pi)
    names = {q.name for q in calm.inputs}
    made = [*calm.inputs, *(q for q in (heading, *place, TIME) if q.name not in names), *own_states(effects)]
    for effect in effects:
        for p in _tunable(effect):
            value = float(effect.value(p.name))
            low, high = max(p.low, value - p.spread), min(p.high, value + p.spread)
            name = checked_name(f"{effect.name}_{p.name}", "parameter")
            made.append(Quantity(name, p.unit, f"{p.name} of {effect.label}", low, high, value, parameter=True))
    return made


def _write(effects: Sequence[Effect], build: Builder, calm: Sequence[sympy.Symbol], given: dict[str, Quantity]) -> None:
    """Write what every effect adds, and the sums."""
    symbols = {q.name: symbol for q, symbol in zip(given.values(), build.inputs, strict=True)}
    columns: list[list[sympy.Expr]] = [[one] for one in calm]
    stream: list[list[sympy.Expr]] = [[], []]
    rates: list[sympy.Expr] = []
    hulls = [e for e in effects if e.overrides("with_changed_inertia")]
    with torch.no_grad(), Trace(build) as trace:
        s = _situation(trace, symbols, given, calm)
        driven = s
        for effect in sorted(effects, key=lambda one: bool(one.memory)):
            build.section(f"{effect.label[:1].upper()}{effect.label[1:]}")
            count = len(rates)
            own = [f"{OWN}{count + k + 1}" for k in range(effect.memory)]
            memory = trace.variable(torch.zeros(1, len(own), dtype=torch.float64), [symbols[name] for name in own])
            try:
                tuned = effect.at(_values(trace, effect, symbols))
                here = driven if effect.memory else s
                caused = tuned.acceleration(here, memory)
                for hull in () if effect in hulls else hulls:
                    caused = hull.at(_values(trace, hull, symbols)).with_changed_inertia(s, caused)
                moved, own_rates = trace.formulas(tuned.stream(s)), trace.formulas(tuned.memory_rate(here, memory))
            except InputError as error:
                raise InputError(f"effect.{effect.name} cannot be exported: it {error}") from error
            for column, formula in zip((*columns, *stream), (*trace.formulas(caused), *moved), strict=True):
                column += [formula] if formula != 0 else []
            driven = driven if effect.memory else driven.with_(nudot=driven.nudot + caused)
            rates += own_rates
    build.section("All accelerations")
    for name, column in zip(("udot", "vdot", "rdot"), columns, strict=True):
        build.output(name, added(column))
    if any(e.overrides("stream") for e in effects):
        for q, column in zip(STREAM, stream, strict=True):
            build.output(q.name, added(column))
    for k, formula in enumerate(rates):
        build.output(f"{OWN}{k + 1}dot", formula)


def _values(trace: Trace, effect: Effect, symbols: dict[str, sympy.Symbol]) -> Tensor:
    """An effect's values, those that may be changed as symbols."""
    tunable = {p.name for p in _tunable(effect)}
    formulas = [
        symbols[f"{effect.name}_{p.name}"] if p.name in tunable else value
        for p, value in zip(effect.declared, effect.values.tolist(), strict=True)
    ]
    return trace.variable(effect.values.double()[None], formulas)


def _situation(
    trace: Trace, symbols: dict[str, sympy.Symbol], given: dict[str, Quantity], calm: Sequence[sympy.Symbol]
) -> Situation:
    """What effects see, as symbols."""

    def column(name: str) -> Tensor:
        if name not in symbols:
            return torch.ones(1, dtype=torch.float64)  # the shaft at its nominal speed
        return trace.variable(torch.tensor([given[name].example], dtype=torch.float64), [symbols[name]])

    nu = trace.variable(
        torch.tensor([[given[name].example for name in "uvr"]], dtype=torch.float64), [symbols[name] for name in "uvr"]
    )
    nudot = trace.variable(torch.zeros(1, 3, dtype=torch.float64), calm)
    return Situation(nu, nudot, *(column(name) for name in ("x", "y", "psi", "delta", "n", "t")))


def _reference(vessel: Vessel, effects: Sequence[Effect], names: Sequence[str], outputs: Sequence[str]) -> Reference:
    """The model itself as a function of a table of inputs."""
    keys = {q.name: key for key, q in CONTROLS.items()}
    memory = [q.name for q in own_states(effects)]
    states = ["u", "v", "r", "x", "y", "psi", *memory]

    @torch.no_grad()
    def reference(points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n outputs"]:
        columns = dict(zip(names, torch.as_tensor(points, dtype=torch.float64).T, strict=True))
        zero = torch.zeros(len(points), dtype=torch.float64)
        state = torch.stack([columns.get(name, zero) for name in states], dim=1)
        tuned = []
        for effect in effects:
            rows = effect.values.double().expand(len(points), -1).clone()
            for k, p in enumerate(effect.declared):
                rows[:, k] = columns.get(f"{effect.name}_{p.name}", rows[:, k])
            tuned.append(effect.at(rows))
        controls = {keys[name]: values for name, values in columns.items() if name in keys}
        inputs = Inputs(delta=columns["delta"], time=columns.get("t", zero), **controls)
        rates = Vessel(vessel.calm, tuned).model(state, inputs)
        north, east = body_to_earth(state[:, 0], state[:, 1], state[:, 5])
        found = dict(zip(("udot", "vdot", "rdot"), rates[:, :3].T, strict=True))
        found |= {"c_N": rates[:, 3] - north, "c_E": rates[:, 4] - east}
        found |= {f"{name}dot": rates[:, 6 + k] for k, name in enumerate(memory)}
        return torch.stack([found[name] for name in outputs], dim=1).numpy()

    return reference
