"""The part of a ship's equations that an identification takes as known."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.ship.clarke import clarke_ship
from manoeuvre_nn.ship.taylor import Coefficients, Side, TaylorShip


class _InertiaOnly(Ship):
    """A ship of which only the inertia is known; all forces are left to the network.

    Source:
        Rajesh & Bhattacharyya 2009, section 3.
    """

    def __init__(self, ship: Ship) -> None:
        """Take particulars, prime system and inertia from a ship.

        Args:
            ship: The ship whose acceleration derivatives are known.
        """
        super().__init__(ship.particulars, ship.prime, ship.inertia)
        self._ship = [ship]  # in a list, so that its coefficients are no part of the model

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed of the ship [rpm]."""
        return self._ship[0].shaft_rpm

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Nothing is known."""
        del delta
        return torch.zeros_like(nu)

    def on_approach(self, speed: float) -> "_InertiaOnly":
        """Inertia and units as the ship has them at that speed."""
        return _InertiaOnly(self._ship[0].on_approach(speed))


def clarke_part(ship: Ship | Particulars, Xu: float | None = None, Xdd: float | None = None) -> TaylorShip:  # noqa: N803
    """Clarke's linear estimate from the ship's particulars.

    Args:
        ship: The ship.
        Xu: Surge damping [-]; by default the ship's.
        Xdd: Rudder drag [-]; by default the ship's.

    Returns:
        A linear ship.

    Source:
        Wang 1996, eqs 4.1-4.19.
    """
    particulars = ship.particulars
    drag = particulars.rudder_drag if Xdd is None else Xdd
    return clarke_ship(particulars, Xu=particulars.surge_damping if Xu is None else Xu, Xdd=drag)


def no_part(ship: Ship | Particulars) -> Ship:
    """Nothing but the inertia: the ship's own where it has coefficients, else Clarke's.

    Args:
        ship: The ship.

    Returns:
        A ship without forces.

    Source:
        Rajesh & Bhattacharyya 2009, eqs 10-12.
    """
    return _InertiaOnly(clarke_part(ship) if isinstance(ship, Particulars) else ship)


def clarke_inertia_part(ship: Ship | Particulars) -> Ship:
    """Nothing but Clarke's inertia, whatever else is known of the ship: as it is with measured ones.

    Args:
        ship: The ship.

    Returns:
        A ship without forces.

    Source:
        Wang 1996, eqs 4.7-4.16.
    """
    return _InertiaOnly(clarke_part(ship))


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
    return TaylorShip(p, p.prime, inertia, coefficients, positive_rudder_turns_to=positive_rudder_turns_to)
