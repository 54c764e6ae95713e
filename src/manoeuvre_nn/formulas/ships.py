"""What is taken as known of a ship's forces, in closed form. A new family of ships adds one function."""

from collections.abc import Sequence
from functools import singledispatch

import numpy as np
import sympy

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.baselines import FittedProducts
from manoeuvre_nn.formulas.networks import numbers, sums_of_products, taylor_product
from manoeuvre_nn.formulas.program import Builder, added, ratio, shifted
from manoeuvre_nn.ship.known import InertiaOnly
from manoeuvre_nn.ship.tanker import TankerShip
from manoeuvre_nn.ship.taylor import TaylorShip

Motion = Sequence[sympy.Expr]
"""u, v [m/s], r [rad/s], delta [rad], positive to starboard."""


@singledispatch
def products(ship: Ship, motion: Motion, build: Builder) -> list[sympy.Expr]:
    """What a ship's coefficients are multiplied by: a product for each row of its ``table``.

    Args:
        ship: The ship.
        motion: Symbols of the motion.
        build: What values are named with.

    Raises:
        InputError: If nobody has written it down.
    """
    name = ship.particulars.name
    raise InputError(f"the known part of the {name} has no closed form here: train with linear=clarke or linear=none")


def known_forces(ship: Ship, motion: Motion, build: Builder) -> list[sympy.Expr] | None:
    """The forces that are taken as known, ``f' = products @ table``.

    Args:
        ship: The known part.
        motion: Symbols of the motion.
        build: What values are named with.

    Returns:
        X, Y, N over the units of the ship's prime system; None where none are known.
    """
    if isinstance(ship, InertiaOnly):
        return None
    build.section("Forces that are taken as known")
    own = products(ship, motion, build)
    assert ship.table is not None  # of a ship that has products
    return sums_of_products(own, numbers(ship.table).T, build, "f")


def accelerations(ship: Ship, forces: Sequence[sympy.Expr], build: Builder) -> None:
    """``nudot = units M'^-1 f'``: the outputs udot, vdot, rdot of the program.

    Args:
        ship: Whose inertia holds.
        forces: X, Y, N over the units of the ship's prime system.
        build: What values are named with.
    """
    build.section("Accelerations by the inverse of the inertia")
    table = numbers(ship.inertia_inverse) * numbers(ship.acceleration_units)[:, None]
    for name, row in zip(("udot", "vdot", "rdot"), table, strict=True):
        kept = np.flatnonzero(row).tolist()
        build.outputs([name], [forces[k] for k in kept], row[None, kept])


@products.register
def taylor_ship(ship: TaylorShip, motion: Motion, build: Builder) -> list[sympy.Expr]:
    """Products of a = u/Us - U0/Us, v, r and delta, times (Us/U0)^2.

    Returns:
        One a term.
    """
    units = numbers(ship.velocity_units).tolist()
    u, v, r = (ratio(z, unit) for z, unit in zip(motion[:3], units, strict=True))
    named = [build.let("a", added([u, sympy.Integer(-1)])), build.let("b", v), build.let("q", r), motion[3]]
    if ship.rudder_sign < 0:
        named[3] = build.let("d", -motion[3])
    square = sympy.Integer(1)
    if ship.scaling == "instantaneous":
        speed = build.let("S", shifted(sympy.sqrt(motion[0] ** 2 + motion[1] ** 2), 0.0, ship.prime.speed))
        names = ("a_S", "b_S", "q_S")
        named[:3] = [build.let(name, z / speed) for name, z in zip(names, named[:3], strict=True)]
        square = speed**2
    return [taylor_product(term, named) * square for term in ship.terms]


@products.register
def tanker(ship: TankerShip, motion: Motion, build: Builder) -> list[sympy.Expr]:
    """Products of Van Berlekom & Goddard's model at the nominal shaft speed.

    Returns:
        One a term.
    """
    u, v = motion[:2]
    length = sympy.Float(ship.particulars.length)
    r, d = build.let("Lr", length * motion[2]), build.let("d", -motion[3])
    slope, constant = (sympy.Float(a) for a in numbers(ship.race))
    square, linear, always = (sympy.Float(a) for a in numbers(ship.thrust_series))
    beta, race = build.let("b", v / u), build.let("c2", slope * u + constant, r"{c}^{2}")
    thrust = build.let("LgT", length * (square * u**2 + linear * u + always), r"{L g T}")
    across, rudder = sympy.Abs(v), race * d
    own = [u**2, v * r, v**2, rudder * d, rudder * beta, thrust, u * v, across * v, rudder, u * r]
    return [*own, race * sympy.Abs(beta) * beta * sympy.Abs(d), across * r]


@products.register
def learnt_products(ship: FittedProducts, motion: Motion, build: Builder) -> list[sympy.Expr]:
    """The products of the ship whose coefficients were learnt.

    Returns:
        One a term.
    """
    return products(ship.whose, motion, build)
