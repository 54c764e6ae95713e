"""The part of a ship's equations that an identification takes as known."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Derivative
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.ship.clarke import GYRATION, SURGE_ADDED_MASS, clarke_derivatives
from manoeuvre_nn.ship.taylor import Coefficients, Side, TaylorShip


class InertiaOnly(Ship):
    """A ship of which only the inertia is known; all forces are left to the network.

    Source:
        Rajesh & Bhattacharyya 2009, section 3.
    """

    def __init__(self, ship: Ship) -> None:
        """Take particulars, prime system and inertia from a ship."""
        super().__init__(ship.particulars, ship.prime, ship.inertia)
        self._ship = [ship]  # in a list, so that its coefficients are no part of the model

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed of the ship [rpm]."""
        return self._ship[0].shaft_rpm

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Nothing is known."""
        return torch.zeros_like(nu)

    def on_approach(self, speed: float) -> "InertiaOnly":
        """Inertia and units as the ship has them at that speed."""
        return InertiaOnly(self._ship[0].on_approach(speed))


def clarke_part(ship: Ship | Particulars, Xu: Derivative | None = None, Xdd: Derivative | None = None) -> TaylorShip:  # noqa: N803
    """A ship that moves by Clarke's linear derivatives alone, estimated from the ship's particulars.

    ``(m - Xudot) udot = Xu (u - U0) + Xdd d^2/2``, ``(m - Yvdot) vdot - Yrdot rdot = Yv v + (Yr - m) r + Yd d``,
    ``(Iz - Nrdot) rdot - Nvdot vdot = Nv v + Nr r + Nd d`` in the (rho, L, T, U0) system.

    Args:
        ship: The ship.
        Xu: Surge damping [-], of the order of -.02 to -.05; what is wrong with it the network takes up. By default the
            ship's.
        Xdd: Rudder drag [-]; by default the ship's, or ``-2 Yd``.

    Returns:
        A linear ship.

    Source:
        Wang 1996, eqs 4.1-4.19 and 4.30-4.32 (Table 4.1 and eqs 4.20-4.23 are lost in the scan); the Clarke columns of
        Tables 5.1-5.3 and A.3-A.5 are reproduced to 2e-5 with ``k_zz = .28 L``. Eq 4.18 gives ``Xdd = -2 Yd``; the
        tables have -.04008 (Mariner) and -.0972 (bulk carrier).
    """
    p = ship.particulars
    d, mass = clarke_derivatives(p), 2 * p.block * p.beam / p.length
    damping = p.surge_damping if Xu is None else Xu
    drag = next((x for x in (Xdd, p.rudder_drag) if x is not None), -2 * d["Yd"])
    inertia = {
        "mx": (1 + SURGE_ADDED_MASS) * mass,
        "my": mass - d["Yvdot"],
        "mz": mass * GYRATION**2 - d["Nrdot"],
        "Yrdot": d["Yrdot"],
        "Nvdot": d["Nvdot"],
    }
    coefficients = {
        "X": {"u": damping, "dd": drag},
        "Y": {"v": d["Yv"], "r": d["Yr"] - mass, "d": d["Yd"]},
        "N": {"v": d["Nv"], "r": d["Nr"], "d": d["Nd"]},
    }
    return TaylorShip(p, inertia, coefficients, positive_rudder_turns_to="port")


def no_part(ship: Ship | Particulars) -> Ship:
    """Nothing but the inertia: the ship's own where it has coefficients, else Clarke's.

    Args:
        ship: The ship.

    Returns:
        A ship without forces.

    Source:
        Rajesh & Bhattacharyya 2009, eqs 10-12.
    """
    return InertiaOnly(clarke_part(ship) if isinstance(ship, Particulars) else ship)


def clarke_inertia_part(ship: Ship | Particulars) -> Ship:
    """Nothing but Clarke's inertia, whatever else is known of the ship: as it is with measured ones.

    Args:
        ship: The ship.

    Returns:
        A ship without forces.

    Source:
        Wang 1996, eqs 4.7-4.16.
    """
    return InertiaOnly(clarke_part(ship))


def given_part(
    ship: Ship | Particulars,
    inertia: Mapping[str, float],
    coefficients: Coefficients,
    positive_rudder_turns_to: Side = "starboard",
) -> TaylorShip:
    """A linear (or longer) Taylor series that the user gives.

    Args:
        ship: The ship, for its particulars.
        inertia: ``mx, my, mz, Yrdot, Nvdot`` in the (rho, L, T, U0) system.
        coefficients: Equation -> term -> value in the same system, mass terms included.
        positive_rudder_turns_to: Sign of the rudder in them.

    Returns:
        The known part.

    Raises:
        InputError: If an inertia is missing.
    """
    missing = {"mx", "my", "mz"} - set(inertia)
    if missing:
        raise InputError(f"linear.inertia lacks {', '.join(sorted(missing))}: write linear.inertia.mx=... and so on")
    p = ship.particulars
    return TaylorShip(p, inertia, coefficients, positive_rudder_turns_to=positive_rudder_turns_to)
