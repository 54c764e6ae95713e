"""What is corrected of a calm-water model's own forces: its coefficients, the parameters of its fit, or its parts."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import times
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, calm_accelerations

USUAL_SCATTER = 0.05
"""Relative error of a coefficient that one standard error of a fit counts for: see ``COEFFICIENT_SD_PRIOR``."""


class MotionState(NamedTuple):
    """A motion and what calm water does in it.

    Attributes:
        nu: u, v [m/s], r [rad/s].
        delta: Rudder angle [rad].
        shaft: Shaft speed over the nominal one [-]; None is nominal.
        acceleration: udot, vdot [m/s^2], rdot [rad/s^2] of the model.
        amidships: The same with the rudder amidships, where it is known.
    """

    nu: Float[Tensor, "*batch 3"]
    delta: Float[Tensor, "*batch"]
    shaft: Float[Tensor, "*batch"] | None
    acceleration: Float[Tensor, "*batch 3"]
    amidships: Float[Tensor, "*batch 3"] | None = None


class ModelCorrections(ABC):
    """Accelerations per unit of every correction of a model's own forces.

    Attributes:
        dynamics: The calm-water model.
        names: One a correction.
    """

    names: list[str]

    def __init__(self, dynamics: Model) -> None:
        """Take the model."""
        self.dynamics = dynamics

    def accelerations(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"] | None
    ) -> Float[Tensor, "*batch 3"]:
        """Accelerations of the model that are corrected."""
        given = () if shaft is None else (shaft,)
        return calm_accelerations(self.dynamics, nu, delta, *given)

    @abstractmethod
    def rows(self, motion: MotionState) -> Float[Tensor, "*batch k 3"]:
        """Accelerations, a row each."""

    def together(self, motion: MotionState, shares: Float[Tensor, "*#batch k"]) -> Float[Tensor, "*batch 3"]:
        """Their sum at given sizes."""
        return (self.rows(motion) * shares[..., None]).sum(dim=-2)


class FitCorrections(ModelCorrections):
    """By the standard errors of a fit to recordings, see :meth:`.Model.sensitivities`."""

    def __init__(self, dynamics: Model, count: int) -> None:
        """Take the model and the number of combinations of its parameters."""
        super().__init__(dynamics)
        self.names = [f"fit {k + 1}" for k in range(count)]

    def rows(self, motion: MotionState) -> Float[Tensor, "*batch k 3"]:
        """Accelerations by standard errors, over the relative error of a coefficient that one counts for."""
        shaft = torch.ones_like(motion.acceleration[..., 0]) if motion.shaft is None else motion.shaft
        state = torch.nn.functional.pad(motion.nu, (0, 3))
        return self.dynamics.sensitivities(state, Inputs(motion.delta, shaft)) / USUAL_SCATTER


class CoefficientCorrections(ModelCorrections):
    """By each coefficient of a ship's table.

    Attributes:
        entries: Row and column of each in the table.
    """

    def __init__(self, dynamics: Model, table: Float[Tensor, "terms 3"]) -> None:
        """Take the model and its ship's table."""
        super().__init__(dynamics)
        self.entries = [(int(term), int(equation)) for term, equation in torch.nonzero(table).tolist()]
        self.names = ["XYN"[equation] + (dynamics.hull.terms[term] or "0") for term, equation in self.entries]
        self._table = table
        self._at = table.new_tensor(self.entries).long().reshape(-1, 2).T

    def accelerations(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"] | None
    ) -> Float[Tensor, "*batch 3"]:
        """At the nominal shaft speed, as the products of the coefficients are."""
        return calm_accelerations(self.dynamics, nu, delta)

    def rows(self, motion: MotionState) -> Float[Tensor, "*batch k 3"]:
        """``M^-1`` of each product times its coefficient."""
        hull, (term, equation) = self.dynamics.hull, self._at
        forces = hull.products(motion.nu, motion.delta)[..., term] * self._table[term, equation]
        return hull.acceleration_from_force(forces[..., None] * torch.eye(3).to(motion.acceleration)[equation])

    def together(self, motion: MotionState, shares: Float[Tensor, "*#batch k"]) -> Float[Tensor, "*batch 3"]:
        """``M^-1 (products @ T c)``, without the rows."""
        hull, (term, equation) = self.dynamics.hull, self._at
        table = self._table.new_zeros(*shares.shape[:-1], *self._table.shape)
        table[..., term, equation] = self._table[term, equation] * shares
        return hull.acceleration_from_force(times(hull.products(motion.nu, motion.delta), table))

    def coefficient(self, term: int, equation: int) -> float:
        """One of the table."""
        return float(self._table[term, equation])

    def table(self, ship: Ship, shares: Float[Tensor, "*rows k"]) -> Float[Tensor, "*rows terms 3"]:
        """Coefficients of a ship of the same terms, ``T (1 + c)``."""
        assert ship.table is not None
        factors = ship.table.new_ones(*shares.shape[:-1], *ship.table.shape)
        factors[..., self._at[0], self._at[1]] += shares[..., : len(self.entries)]
        return ship.table * factors


class PartCorrections(ModelCorrections):
    """By the forces of hull (rudder amidships) and rudder, equation by equation: of a model that is no series."""

    def __init__(self, dynamics: Model) -> None:
        """Take the model."""
        super().__init__(dynamics)
        self.names = [f"{equation}{part}" for part in ("hull", "rudder") for equation in "XYN"]

    def rows(self, motion: MotionState) -> Float[Tensor, "*batch k 3"]:
        """``M^-1`` of each part's force in each equation."""
        hull, amidships = self.dynamics.hull, motion.amidships
        if amidships is None:
            amidships = self.accelerations(motion.nu, torch.zeros_like(motion.delta), motion.shaft)
        calm = hull.force_from_acceleration(amidships)
        rudder = hull.force_from_acceleration(motion.acceleration) - calm
        unity = torch.eye(3).to(motion.acceleration)
        return hull.acceleration_from_force(torch.cat([p[..., None, :] * unity for p in (calm, rudder)], dim=-2))


def model_corrections(dynamics: Model) -> ModelCorrections:
    """What can be corrected of a model.

    Returns:
        The parameters of its fit where it was fitted to recordings, else the coefficients of its ship's table, else its
        forces by parts.
    """
    p, hull = dynamics.particulars, dynamics.hull
    units = hull.inertia.new_tensor([p.speed, p.speed, p.speed / p.length])
    state, zero = torch.nn.functional.pad(units, (0, 3 + len(dynamics.own_names))), units[0] * 0
    uncertain = len(dynamics.sensitivities(state, Inputs(zero, zero + 1)))
    if uncertain:
        return FitCorrections(dynamics, uncertain)
    return PartCorrections(dynamics) if hull.table is None else CoefficientCorrections(dynamics, hull.table)
