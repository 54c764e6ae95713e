"""Models of a ship's motion as programs: what an engineer pastes into a simulator, rates of change in SI."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import sympy
import torch
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.networks import closed_form, numbers
from manoeuvre_nn.formulas.program import Builder, Program, Quantity, Reference, added, ratio, shifted, times
from manoeuvre_nn.formulas.ranges import Ranges, usual_ranges
from manoeuvre_nn.formulas.ships import accelerations, known_forces

MOTION = (
    Quantity("u", "m/s", "speed through the water, forward"),
    Quantity("v", "m/s", "speed through the water, to starboard"),
    Quantity("r", "rad/s", "rate of turn, positive to starboard"),
    Quantity("delta", "rad", "rudder angle, positive turns the ship to starboard", symbol=r"\delta"),
)
CONTROLS = {
    "shaft": Quantity("n", "-", "shaft speed over the nominal one", example=1.0),
    "approach": Quantity("p", "-", "speed at which the run began, over U0", example=1.0),
    "wind_north": Quantity("w_N", "m/s", "velocity of the air over ground, north"),
    "wind_east": Quantity("w_E", "m/s", "velocity of the air over ground, east"),
}
HEADING = Quantity("psi", "rad", "heading, clockwise from north", symbol=r"\psi")
RATES = (
    Quantity("udot", "m/s^2", "acceleration forward"),
    Quantity("vdot", "m/s^2", "acceleration to starboard"),
    Quantity("rdot", "rad/s^2", "yaw acceleration, positive to starboard"),
)


def ship_in_calm_water(model: CalmWater, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """Accelerations of a ship with coefficients.

    Returns:
        u, v, r, delta to udot, vdot, rdot.

    Raises:
        InputError: If it has states of its own, as a ship that rolls.
    """
    if model.own_names:
        raise InputError(f"the {model.particulars.name} rolls: her equations have no closed form here")
    build = Builder(MOTION, RATES)
    forces = known_forces(model.ship, build.inputs, build)
    assert forces is not None  # of a ship with coefficients
    accelerations(model.ship, forces, build)
    return _of_ship(model, MOTION, build, ranges, notes)


def identified_ship(model: IdentifiedShip, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """Accelerations by the known part and the network: ``M'_known nudot' = f'_known + g'``.

    Returns:
        u, v, r, delta, and shaft, approach and wind where the network takes them, to udot, vdot, rdot.
    """
    known, network = model.known, model.network
    given = [*MOTION, *(CONTROLS[name] for name in CONTROLS if name in network.takes)]
    if "wind_north" in network.takes:
        given.append(HEADING)
    build = Builder(given, RATES)
    motion, more = build.inputs[:4], dict(zip([q.name for q in given[4:]], build.inputs[4:], strict=True))
    build.section("Inputs of the network")
    seen = _network_inputs(model, motion, more, build)
    answer = closed_form(network, seen, build)
    build.section("Forces by the network")
    sizes = numbers(model.scaling.output_scale)
    forces = [
        build.let(f"g_{e}", times(float(a), y) if a != 1 else y) for e, a, y in zip("XYN", sizes, answer, strict=True)
    ]
    own = known_forces(known, motion, build)
    if own is not None:
        build.section("All forces")
        forces = [build.let(f"F_{e}", added([f, g])) for e, f, g in zip("XYN", own, forces, strict=True)]
    accelerations(known, forces, build)
    return _of_ship(model, given, build, ranges, notes)


def _network_inputs(
    model: IdentifiedShip, motion: Sequence[sympy.Expr], more: dict[str, sympy.Expr], build: Builder
) -> list[sympy.Expr]:
    """What the network sees, see :meth:`.IdentifiedShip.network_inputs`."""
    units = [*numbers(model.known.velocity_units).tolist(), 1.0]
    shift, scale = numbers(model.scaling.shift).tolist(), numbers(model.scaling.scale).tolist()
    primes = [ratio(z, unit) for z, unit in zip(motion[:3], units, strict=False)]
    names, symbols = ("uprime", "vprime", "rprime"), ("{u}'", "{v}'", "{r}'")
    primes = [build.let(n, z, s) for n, z, s in zip(names, primes, symbols, strict=True)]
    seen: list[sympy.Expr] = []
    for k, z in enumerate((*primes, motion[3])):
        plain = shift[k] == 0.0 and scale[k] == 1.0
        seen.append(z if plain else build.let(f"x_{k + 1}", shifted(z, shift[k], scale[k])))
    if not more:
        return seen
    pace = more["p"] if "p" in more else more["n"]
    if "p" not in more and float(model.network.shaft_ratio) != 1.0:
        pace = build.let("x_5", times(float(model.network.shaft_ratio), pace))
    u, v, speed = motion[0], motion[1], model.particulars.speed
    ahead, aside = -u, -v
    if "psi" in more:
        north, east, psi = more["w_N"], more["w_E"], more["psi"]
        ahead = added([north * sympy.cos(psi), east * sympy.sin(psi), -u])
        aside = added([east * sympy.cos(psi), -north * sympy.sin(psi), -v])
    wind = [build.let(name, ratio(z, speed)) for name, z in (("w_x", ahead), ("w_y", aside))]
    return [*seen, pace, *wind]


def _of_ship(
    model: Model, inputs: Sequence[Quantity], build: Builder, ranges: Ranges | None, notes: Sequence[str]
) -> Program:
    """The program of a model of a ship."""
    ends, ship = {**usual_ranges(model.hull), **(ranges or {})}, model.hull
    names = {q.name: key for key, q in CONTROLS.items()}
    example = {"u": round(ship.particulars.speed, 3)}
    ranged = []
    for q in inputs:
        low, high = ends[names.get(q.name, q.name)]
        ranged.append(replace(q, low=low, high=high, example=example.get(q.name, q.example)))
    shaft = "" if {"shaft"} & set(_takes(model)) else " at the shaft speed of the approach"
    water = "deep water" if ship.depth == inf else f"water of {ship.depth:.6g} m"
    own = [
        f"Calm {water}{shaft}; the axes move with the ship, forward and to starboard.",
        f"Non-dimensional values: {ship.prime.name}; L = {ship.prime.length:.6g} m, unit of speed "
        f"{ship.prime.speed:.6g} m/s, of force {ship.prime.force:.6g} N, of moment {ship.prime.moment:.6g} N m.",
    ]
    return Program(
        name="accelerations",
        title=f"Accelerations of the {ship.particulars.name}",
        inputs=ranged,
        outputs=RATES,
        sections=[s for s in build.sections if s.steps],
        notes=[*notes, *own],
        reference=_reference(model, [q.name for q in inputs]),
        symbols=build.symbols,
        vessel=Vessel(model),
    )


def _takes(model: Model) -> Sequence[str]:
    return model.network.takes if isinstance(model, IdentifiedShip) else ()


def _reference(model: Model, names: Sequence[str]) -> Reference:
    """The model itself as a function of a table of inputs."""
    keys = {q.name: key for key, q in CONTROLS.items()}

    @torch.no_grad()
    def reference(points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n 3"]:
        columns = dict(zip(names, torch.as_tensor(points, dtype=torch.float64).T, strict=True))
        state = torch.zeros(len(points), 6, dtype=torch.float64)
        for k, name in ((0, "u"), (1, "v"), (2, "r"), (5, "psi")):
            state[:, k] = columns.pop(name, state[:, k])
        inputs = Inputs(delta=columns.pop("delta"), **{keys[name]: value for name, value in columns.items()})
        return model(state, inputs)[:, :3].cpu().numpy()

    return reference
