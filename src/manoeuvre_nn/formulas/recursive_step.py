"""A recursive network as a program: from where a ship stands, and what is kept of the past, to a step later.

The caller keeps the past: of every step's outputs the forces become those of one step before, these those of two.
"""

from collections.abc import Sequence
from copy import deepcopy

import numpy as np
import sympy
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.units import GRAVITY, RPM
from manoeuvre_nn.dynamics.recursion import MIN_SPEED, Recursion
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.recursive_runs import ANGLES
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.check import Run
from manoeuvre_nn.formulas.networks import numbers
from manoeuvre_nn.formulas.program import Builder, Program, Quantity, Reference, added, at_least, logistic, times
from manoeuvre_nn.formulas.ranges import Ranges
from manoeuvre_nn.formulas.tracing import Trace
from manoeuvre_nn.network.recursive import MAX_SHARE, RecursiveNetwork

ONE = sympy.Integer(1)
SPREADS = 2.0
"""Standard deviations of what a network was trained on to both ends of the range of an input."""
MEANINGS = {
    "u": "speed through the water, forward", "v": "speed through the water, to starboard",
    "w": "speed through the water, down", "p": "rate of roll", "q": "rate of pitch",
    "r": "rate of turn, positive to starboard",
}  # fmt: skip
HEADINGS = {
    "phi": "roll, positive to starboard", "theta": "pitch, bow up", "psi": "heading, clockwise from north"
}  # fmt: skip
SIDES = ("starboard", "port")
WIND = 10.0
"""Velocity of the air to both sides in the ranges [m/s]."""


def recursive_step(model: RecursiveShip, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """The next step of a ship that goes by a recursive network.

    Args:
        model: The ship.
        ranges: Not used: the network knows what it was trained on.
        notes: Where it is from.

    Returns:
        Velocities now and one step before, angles, rudders and shafts, forces of past steps and the approach speed to
        velocities and angles a step later, how long it takes, and the forces of this step.
    """
    del ranges
    model = RecursiveShip(model.hull, deepcopy(model.network).double())
    names, angles = _names(model)
    given, outputs = _inputs(model), _outputs(model)
    build = Builder(given, outputs)
    at = dict(zip([q.name for q in given], build.inputs, strict=True))
    build.section("Non-dimensional values")
    units = _units(model, at["U0"])
    now = [build.let(f"{n}_prime", at[n] / units[n], rf"{{{n}}}'") for n in names]
    before = [build.let(f"{n}_prime_1", at[f"{n}_1"] / units[n], rf"{{{n}}}'_{{1}}") for n in names]
    forces = _forces(model, build, at, now)
    past = [at[f"{name}_{k}"] for k, name in _kept(model)]
    new = _next_velocities(model, build, [*forces, *past, *now, *before], now)
    build.section("A step later")
    speed = build.let("U_prime", at_least(sympy.sqrt(now[0] ** 2 + now[1] ** 2), MIN_SPEED), r"{U}'")
    step = build.let("h", model.network.settings.step / speed)
    build.output("dt", step * model.particulars.length / at["U0"])
    for n, value in zip(names, new, strict=True):
        build.output(f"{n}_next", units[n] * value)
    rates = [(a, b) for n, a, b in zip(names, now, new, strict=True) if n in ANGLES]
    for angle, (a, b) in zip(angles, rates, strict=True):
        build.output(f"{angle}_next", at[angle] + 0.5 * step * (a + b))
    for column, force in zip(model.network.settings.columns, forces, strict=True):
        build.output(f"{column}_0", force)
    size = model.particulars.length
    own = [
        f"One step of {model.network.settings.step:g} L/U, L = {size:.6g} m: dt tells how long it takes. Until the "
        "next one every force moves on: thrust_port_1 is thrust_port_0, lift_port_2 is lift_port_1; so does u_1, which "
        "is u. Before a run all are those of a steady approach.",
        "Forces are over .5 rho L^2 U0^2, moments over .5 rho L^3 U0^2.",
    ]
    return Program(
        name="next_step",
        title=f"Next step of the {model.particulars.name}",
        inputs=given,
        outputs=outputs,
        sections=[s for s in build.sections if s.steps],
        notes=[*notes, *own],
        reference=_reference(model, [q.name for q in given], [q.name for q in outputs]),
        symbols=build.symbols,
        vessel=Vessel(model),
    )


def ship_by_steps(program: Program, run: Run) -> RecursiveShip:
    """A ship that goes from step to step by what was written.

    Args:
        program: The program that was written.
        run: What the written thing computes.

    Returns:
        The ship.
    """
    assert program.vessel is not None
    ship = program.vessel.model
    assert isinstance(ship, RecursiveShip)
    (names, angles), columns, size = _names(ship), ship.network.settings.columns, ship.particulars.length

    def step(now: Recursion, controls: Float[Tensor, "rows _"], froude: Float[Tensor, " rows"]) -> Recursion:
        speed = (froude * GRAVITY * size).sqrt()
        given = {name: value.numpy() for name, value in _columns(ship, now, controls, speed).items()}
        found = {name: torch.as_tensor(value).to(now.velocities) for name, value in run(given).items()}
        units = _units(ship, speed)
        return Recursion(
            torch.stack([found[f"{n}_next"] / units[n] for n in names], dim=-1),
            now.velocities,
            torch.stack([found[f"{a}_next"] for a in angles], dim=-1),
            now.time + found["dt"] * speed / size,
            (torch.stack([found[f"{c}_0"] for c in columns], dim=-1), *now.forces[:-1]),
        )

    return RecursiveShip(ship.hull, ship.network, step)


def _names(model: RecursiveShip) -> tuple[tuple[str, ...], list[str]]:
    """Velocities and angles."""
    names = model.network.settings.velocities
    return names, [ANGLES[n] for n in names if n in ANGLES]


def _units(model: RecursiveShip, speed: sympy.Expr | Tensor) -> dict[str, sympy.Expr | Tensor]:
    """Unit of each velocity: U0, of rates U0/L."""
    return {n: speed / model.particulars.length if n in ANGLES else speed for n in model.network.settings.velocities}


def _kept(model: RecursiveShip) -> list[tuple[int, str]]:
    """Steps ago and name of past forces that the network sees, in its order."""
    s = model.network.settings
    found = [(k, name) for k in range(1, s.past_thrust + 1) for name in s.columns]
    return found + [(k, name) for k in range(s.past_thrust + 1, s.past + 1) for name in s.long_kept]


def _inputs(model: RecursiveShip) -> list[Quantity]:
    """All inputs, with the ranges of what the network was trained on."""
    network, p = model.network, model.particulars
    names, angles = _names(model)
    ends = dict(zip(network.input_names, _ends(network), strict=True))
    units = {n: float(unit) for n, unit in _units(model, torch.tensor(p.speed)).items()}
    made = []
    for late, word in ((0, ""), (1, ", one step before")):
        for n in names:
            low, high = (units[n] * end for end in ends[f"{n}-{late}"])
            unit, start = ("rad/s" if n in ANGLES else "m/s"), (p.speed if n == "u" else 0.0)
            made.append(Quantity(f"{n}_1" if late else n, unit, MEANINGS[n] + word, low, high, start))
    made += [Quantity(a, "rad", HEADINGS[a], -0.3, 0.3, symbol=rf"\{a}") for a in angles]
    turns = model.hull.shaft_rpm * RPM
    for side in SIDES:
        word, limit = f"angle of the {side} rudder, positive turns the ship to starboard", p.rudder_limit
        made.append(Quantity(f"delta_{side}", "rad", word, -limit, limit))
    for side in SIDES:
        made.append(Quantity(f"n_{side}", "1/s", f"shaft speed of the {side} side", 0.7 * turns, 1.1 * turns, turns))
    if network.settings.wind:
        word = "velocity of the air over ground"
        made += [Quantity(f"w_{k}", "m/s", f"{word}, {way}", -WIND, WIND) for k, way in (("N", "north"), ("E", "east"))]
    for k, name in _kept(model):
        low, high = ends[f"{name}-{k}"]
        word = f"{name.replace('_', ' ')} {k} {'steps' if k > 1 else 'step'} before"
        made.append(Quantity(f"{name}_{k}", "-", word, low, high, 0.5 * (low + high)))
    word = "speed at which the run began"
    return [*made, Quantity("U0", "m/s", word, 0.9 * p.speed, 1.1 * p.speed, p.speed, parameter=True)]


def _ends(network: RecursiveNetwork) -> Float[np.ndarray, "inputs 2"]:
    """Ends of the ranges of a network's inputs."""
    shift, scale = numbers(network.shift), numbers(network.scale)
    return np.stack([shift - SPREADS * scale, shift + SPREADS * scale], axis=1)


def _outputs(model: RecursiveShip) -> list[Quantity]:
    """All outputs."""
    names, angles = _names(model)
    made = [Quantity("dt", "s", "how long the step takes")]
    made += [Quantity(f"{n}_next", "rad/s" if n in ANGLES else "m/s", f"{MEANINGS[n]}, a step later") for n in names]
    made += [Quantity(f"{a}_next", "rad", f"{HEADINGS[a]}, a step later") for a in angles]
    columns = model.network.settings.columns
    return made + [Quantity(f"{c}_0", "-", f"{c.replace('_', ' ')} of this step") for c in columns]


def _forces(
    model: RecursiveShip, build: Builder, at: dict[str, sympy.Symbol], now: Sequence[sympy.Symbol]
) -> list[sympy.Symbol]:
    """Forces of this step by the force modules."""
    build.section("Forces of this step")
    _, angles = _names(model)
    length, speed = model.particulars.length, at["U0"]
    per_unit = build.let("T_0", length / speed)
    controls = [at[f"delta_{s}"] for s in SIDES] + [at[f"n_{s}"] * per_unit for s in SIDES]
    if model.network.settings.wind:
        controls += [at[f"w_{k}"] / speed for k in "NE"]
    named = [build.let(f"c_{k + 1}", one) for k, one in enumerate(controls)]
    froude = build.let("Fn2", speed**2 / (GRAVITY * length), r"F_n^2")
    with torch.no_grad(), Trace(build) as trace:
        like = torch.ones(1, dtype=torch.float64)
        moving = trace.variable(like.new_full((1, len(now)), 0.1), list(now))
        turned = trace.variable(like.new_full((1, len(angles)), 0.1), [at[a] for a in angles])
        steered = trace.variable(like.new_full((1, len(named)), 0.3), list(named))
        found = trace.formulas(model.forces(moving, turned, steered, trace.variable(like, [froude])))
    return [build.let(f"f_{k + 1}", one) for k, one in enumerate(found)]


def _next_velocities(
    model: RecursiveShip, build: Builder, x: Sequence[sympy.Symbol], last: Sequence[sympy.Symbol]
) -> list[sympy.Symbol]:
    """What the network gives: ``m + d tanh(nodes)``, see :class:`.RecursiveNetwork`."""
    network, s = model.network, model.network.settings
    with torch.no_grad():
        weights, biases, links = network.folded()
    tables = [numbers(w).T for w in weights]
    offsets = [None if b is None else numbers(b)[:, None] for b in biases]
    sides = ("a", "b") if s.symmetric else ("a",)  # the network and its image in the mirror
    assert offsets[0] is not None
    first, count = np.hstack([tables[0], offsets[0]]), len(tables[0]) // len(sides)
    answers = []
    for k, side in enumerate(sides):
        build.section("The network" if k == 0 else "Its image in the mirror")
        nodes = build.weighted(_listed(f"{side}1", count), [*x, ONE], first[k * count : (k + 1) * count], logistic)
        for layer, (table, offset) in enumerate(zip(tables[1:], offsets[1:], strict=True), start=2):
            inputs = nodes if offset is None else [*nodes, ONE]
            table = table if offset is None else np.hstack([table, offset])
            outer = logistic if layer <= len(s.hidden) else None
            nodes = build.weighted(_listed(f"{side}{layer}", len(table)), inputs, table, outer)
        answers.append(nodes)
    build.section("What the network gives")
    found = []
    middle, half, signs = (numbers(t).tolist() for t in (network.middle, network.half_range, network.output_signs))
    wind = x[network.wind_places] if links is not None else []
    for k, node in enumerate(answers[0]):
        terms = [node] if not s.symmetric else [times(0.5, node), times(0.5 * signs[k], answers[1][k])]
        terms += [times(float(links[row, k]), z) for row, z in enumerate(wind) if links is not None]
        if s.about_last:
            share = build.let(f"s_{k + 1}", (last[k] - middle[k]) / half[k])
            held = build.let(f"t_{k + 1}", at_least(-at_least(-share, -MAX_SHARE), -MAX_SHARE))
            terms.append(0.5 * sympy.log((1 + held) / (1 - held)))  # atanh
        node = build.let(f"z_{k + 1}", added(terms))
        found.append(build.let(f"y_{k + 1}", middle[k] + half[k] * sympy.tanh(node)))
    return found


def _listed(name: str, count: int) -> list[str]:
    return [f"{name}_{k + 1}" for k in range(count)]


def _columns(
    model: RecursiveShip, now: Recursion, controls: Float[Tensor, "rows _"], speed: Float[Tensor, " rows"]
) -> dict[str, Tensor]:
    """Inputs of the program where rows stand, in SI."""
    names, angles = _names(model)
    units, columns = _units(model, speed), model.network.settings.columns
    found = {n: now.velocities[:, k] * units[n] for k, n in enumerate(names)}
    found |= {f"{n}_1": now.before[:, k] * units[n] for k, n in enumerate(names)}
    found |= {a: now.angles[:, k] for k, a in enumerate(angles)}
    found |= {f"delta_{side}": controls[:, k] for k, side in enumerate(SIDES)}
    found |= {f"n_{side}": controls[:, 2 + k] * speed / model.particulars.length for k, side in enumerate(SIDES)}
    if model.network.settings.wind:
        found |= {f"w_{way}": controls[:, 4 + k] * speed for k, way in enumerate("NE")}
    found |= {f"{name}_{k}": now.forces[k - 1][:, columns.index(name)] for k, name in _kept(model)}
    return {name: value.double() for name, value in {**found, "U0": speed}.items()}


def _reference(model: RecursiveShip, inputs: Sequence[str], outputs: Sequence[str]) -> Reference:
    """The model's own step as a function of a table of inputs."""
    names, angles = _names(model)
    columns = model.network.settings.columns

    @torch.no_grad()
    def reference(points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n outputs"]:
        at = dict(zip(inputs, torch.as_tensor(points, dtype=torch.float64).T, strict=True))
        speed, length = at["U0"], model.particulars.length
        units, zero = _units(model, speed), torch.zeros(len(points), dtype=torch.float64)
        now, before = (torch.stack([at[n + late] / units[n] for n in names], dim=-1) for late in ("", "_1"))
        turned = torch.stack([at[a] for a in angles], dim=-1)
        controls = [at[f"delta_{s}"] for s in SIDES] + [at[f"n_{s}"] * length / speed for s in SIDES]
        controls += [at[f"w_{k}"] / speed for k in "NE"] if model.network.settings.wind else []
        past = [
            torch.stack([at.get(f"{name}_{k}", zero) for name in columns], dim=-1)
            for k in range(1, model.network.settings.past + 1)
        ]
        stands, steered = Recursion(now, before, turned, zero, tuple(past)), torch.stack(controls, dim=-1)
        after = model.advance(stands, steered, model.froude(speed), model.network.folded())
        forces = model.forces(now, turned, steered, model.froude(speed))
        found = {f"{n}_next": after.velocities[:, k] * units[n] for k, n in enumerate(names)}
        found |= {f"{a}_next": after.angles[:, k] for k, a in enumerate(angles)}
        found |= {f"{c}_0": forces[:, k] for k, c in enumerate(columns)}
        found |= {"dt": after.time * length / speed}
        return torch.stack([found[name] for name in outputs], dim=-1).numpy()

    return reference
