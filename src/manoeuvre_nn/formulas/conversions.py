"""A ship as the coefficients that another simulator reads: fitted to the model's own runs, at a price that is told."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, prod

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.effect.series import GYRATION
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.rollouts import TrackDeviation
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.numerics.finite_algebra import lstsq

ZIGZAGS_DEG, CIRCLES_DEG = (5.0, 10.0, 30.0), (10.0, 15.0, 35.0)
"""What coefficients are fitted to: zigzags to either side first, and turning circles to either side. Those that the
deviations are told of are not among them."""
SMALLEST_SHARE = 1e-9
"""Combinations of terms that the runs show by less than this share of the best shown one are left at 0."""
Terms = Mapping[str, Sequence[str]]
"""Equation (X, Y, N) -> products, their variables apart by blanks: ``v |v|``; ``1`` is the constant."""
Coefficients = dict[str, dict[str, float]]
"""Equation -> product -> coefficient."""


@dataclass(frozen=True)
class ForceSamples:
    """What a model does in its own runs.

    Attributes:
        u: Forward speed [m/s].
        v: Speed to starboard [m/s].
        r: Yaw rate [rad/s].
        d: Rudder angle, positive turns to starboard [rad].
        forces: X, Y [N], N [N m] that make the accelerations of a ship with her inertia.
    """

    u: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " n"]
    r: Float[np.ndarray, " n"]
    d: Float[np.ndarray, " n"]
    forces: Float[np.ndarray, "n 3"]


def samples_of(program: Program, kind: str) -> ForceSamples:
    """States of the runs that coefficients are fitted to, with the forces there.

    Args:
        program: Accelerations of a ship in calm water.
        kind: The format that is wanted, for the message.

    Returns:
        The samples.

    Raises:
        InputError: If it is no ship, or one with effects.
    """
    if not program.gives_rates:
        raise InputError(
            f"format={kind} is for models of a ship's motion: write format=c for a response or a recursive network"
        )
    assert program.vessel is not None
    if program.vessel.effects:
        raise InputError(
            f"format={kind} holds coefficients of calm water alone: leave effect= out, or write format=fmu, which "
            "takes effects"
        )
    hull = program.vessel.model.hull
    limit = hull.particulars.rudder_limit / DEGREE
    sides = ("starboard", "port")
    trials = [zigzag(min(a, limit), first=side) for a in ZIGZAGS_DEG for side in sides]
    trials += [turning_circle(min(a, limit), side) for a in CIRCLES_DEG for side in sides]
    runs = roll_out(program.vessel, trials)
    u, v, r, d = (np.concatenate([run[name] for run in runs]) for name in ("u", "v", "r", "delta"))
    rates = np.stack([np.concatenate([run[name] for run in runs]) for name in ACCELERATION], axis=1)
    return ForceSamples(u, v, r, d, rates @ inertia_of(hull).T)


def inertia_of(hull: Ship) -> Float[np.ndarray, "3 3"]:
    """Inertia with added masses, for X, Y [N], N [N m] by accelerations [m/s^2, rad/s^2]."""
    forces = np.array([hull.prime.force, hull.prime.force, hull.prime.moment])
    return hull.inertia.double().numpy() * forces[:, None] / np.array(hull.prime.acceleration_units)


def rigid_body(hull: Ship) -> tuple[float, float]:
    """What of the inertia is the ship's own; the rest is added mass.

    Returns:
        Mass [kg], the displacement, never more than the inertia in surge; moment of inertia by a radius of gyration of
        ``GYRATION`` L [kg m^2].
    """
    mass = min(hull.particulars.mass, float(inertia_of(hull)[0, 0]))
    return mass, mass * (GYRATION * hull.particulars.length) ** 2


def fitted(terms: Terms, variables: Mapping[str, np.ndarray], forces: Float[np.ndarray, "n 3"]) -> Coefficients:
    """Coefficients by linear least squares, each equation by itself.

    Args:
        terms: Products of each equation.
        variables: Values of u, v, r, d in what the products are of.
        forces: X, Y, N.

    Returns:
        A coefficient for each product.
    """
    found: Coefficients = {}
    for column, (equation, products) in enumerate(terms.items()):
        table = np.stack([product_of(term, variables) for term in products], axis=1)
        sizes = np.sqrt(np.mean(table**2, axis=0))
        sizes[sizes == 0] = 1.0
        values = lstsq(table / sizes, forces[:, column], rcond=SMALLEST_SHARE) / sizes
        found[equation] = dict(zip(products, values.tolist(), strict=True))
    return found


def product_of(term: str, variables: Mapping[str, np.ndarray]) -> np.ndarray:
    """The values of a product."""
    known = {"1": np.ones_like(variables["u"]), **variables}
    known |= {f"|{name}|": np.abs(values) for name, values in variables.items()}
    return np.asarray(prod(known[token] for token in term.split()))


def price(deviations: Sequence[TrackDeviation]) -> list[str]:
    """What a conversion costs, a line a manoeuvre."""
    apart = "{0.manoeuvre}: the track deviates from the model's by {0.largest:.3g} L at most, {0.rms:.3g} L rms"
    lost = "{0.manoeuvre}: it leaves the physical range where the model does not, or the model does"
    return [(apart if isfinite(one.largest) else lost).format(one) for one in deviations]
