"""A ship's series taken apart into what the hull does in sway and in turning, and what its mass does."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship

TANKER = {"uv": "sway", "|v|v": "sway", "Lur": "turn", "L|v|r": "turn", "Lvr": "turn"}
"""Products of the BIS tanker that the hull makes; all others belong to rudder, propeller or resistance."""
LINEAR = {"v", "uv", "r", "ur", "Lur"}
GYRATION = 0.25
"""Radius of gyration in yaw over L [-], where the inertia has to be parted into mass and added mass."""


@runtime_checkable
class DepthShip(Protocol):
    """A ship whose coefficient set has terms for the depth of the water (the BIS tanker)."""

    coefficients: Mapping[str, float]
    zeta: float


@dataclass(frozen=True)
class Parts:
    """Contributions to the right-hand sides f' [-], by what makes them.

    Attributes:
        sway: By the hull's drift: terms with more v than r and no rudder.
        turn: By the hull's yaw rate, mass terms excluded.
        mass: ``m' v' r'`` and ``-m' u' r'``.
    """

    sway: Float[Tensor, "*batch 3"]
    turn: Float[Tensor, "*batch 3"]
    mass: Float[Tensor, "*batch 3"]


class Series(nn.Module):
    """A ship's products and coefficients, sorted.

    Attributes:
        mass: Mass of the ship in its prime system, m' [-].
    """

    def __init__(self, ship: Ship, effect: str) -> None:
        """Sort the terms.

        Args:
            ship: The ship.
            effect: Name of the effect that needs them, for the message.

        Raises:
            InputError: If the ship's forces are no series.
        """
        super().__init__()
        if ship.table is None:
            raise InputError(
                f"effect.{effect}: the {ship.particulars.name} has no table of coefficients; give a ship with one"
            )
        self._ship = [ship]
        self.mass = ship.particulars.mass / ship.prime.mass
        kinds = [_kind(t) for t in ship.terms]
        pure = torch.zeros_like(ship.table)  # coefficients that the mass terms make
        for k, term in enumerate(ship.terms):
            if term in {"r", "ur", "Lur"}:
                pure[k, 1] = -self.mass
            if term in {"vr", "Lvr"}:
                pure[k, 0] = self.mass
        if isinstance(ship, DepthShip):
            pure = pure / ship.prime.speed**2 
        hull = ship.table - pure
        linear = [t in LINEAR for t in ship.terms]
        self.tables = {
            "sway": hull * _mask([k == "sway" for k in kinds], hull),
            "turn": hull * _mask([k == "turn" for k in kinds], hull),
            "mass": pure,
        }
        self.linear = _mask(linear, hull)
