"""What a ship is to the rest of the program: inertia and forces; no solver."""

from abc import ABC, abstractmethod
from math import inf

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import times
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.prime import PrimeSystem


class Ship(ABC, nn.Module):
    """Particulars, inertia and hydrodynamic forces in a prime system: ``M' nudot' = f'(nu, delta)``.

    ``M'`` is constant, so accelerations follow from forces by one multiplication with its inverse. A linear estimate
    (Clarke's) is a ship too: that is how the known part of the forces is handed to the identification.

    Attributes:
        particulars: Main dimensions and steering gear.
        prime: The prime system of inertia and forces.
        inertia: M' [-], shape (3, 3), for surge, sway and yaw.
        depth: Depth of the water that the forces hold for [m]; ``inf`` is deep water.
        terms: Names of the products, one a row of ``table``; none if the forces are no such series.
        own_names: Channels of the states beside u, v, r, x, y, psi: phi and p of a ship that rolls.
        sides: Number of rudders and of propellers: 1, or 2 for a starboard and a port one.
        roll_axis: Height above the water of the axis that heeling moments are about [m].
    """

    depth: float = inf
    terms: tuple[str, ...] = ()
    own_names: tuple[str, ...] = ()
    sides: int = 1
    roll_axis: float = 0.0
    particulars: Particulars
    prime: PrimeSystem
    inertia: Tensor
    inertia_inverse: Tensor
    velocity_units: Tensor
    acceleration_units: Tensor

    def __init__(self, particulars: Particulars, prime: PrimeSystem, inertia: Float[Tensor, "3 3"]) -> None:
        """Store description and inertia, and what follows from them."""
        super().__init__()
        self.particulars, self.prime = particulars, prime
        self.register_buffer("inertia", inertia)
        self.register_buffer("inertia_inverse", torch.linalg.inv(inertia))
        self.register_buffer("velocity_units", inertia.new_tensor(prime.velocity_units))
        self.register_buffer("acceleration_units", inertia.new_tensor(prime.acceleration_units))

    @property
    def table(self) -> Float[Tensor, "terms 3"] | None:
        """Coefficients that :meth:`products` are multiplied by; None if the forces are no such series."""
        return None

    def with_table(self, table: Float[Tensor, "*rows terms 3"]) -> "Ship | None":
        """The same ship with other coefficients, of each row of a batch its own; None if her family has no such way."""
        return None

    def products(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch terms"]:
        """What the coefficients are multiplied by: ``f' = products @ table``.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: Rudder angle [rad], positive turns to starboard.
        """
        raise NotImplementedError

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed on the approach [rpm]: the nominal one unless a family says otherwise."""
        return self.particulars.rpm

    def thrust(self, u: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Propulsive force behind the hull, thrust less thrust deduction, and the side force that goes with it.

        ``T = R0 [(1 + s) (n/n0)^2 - s (n/n0) u/U0]``: thrust linear in the advance ratio, equal to the resistance R0
        on the approach, without a side force. Families that model the propeller override it.

        Args:
            u: Forward speed through the water [m/s].
            shaft: n / n0 [-].

        Returns:
            X, Y [N], N [N m].
        """
        p = self.particulars
        surge = p.calm_resistance * shaft * ((1 + p.thrust_slope) * shaft - p.thrust_slope * u / p.speed)
        return torch.nn.functional.pad(surge[..., None], (0, 2))

    def shaft_force(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """What a shaft speed other than the nominal one adds to the right-hand sides, ``dX = T(u, n) - T(u, n0)``.

        Families whose rudder lies in the propeller race override it.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: Rudder angle [rad].
            shaft: n / n0 [-].

        Returns:
            Addition to f' [-].
        """
        u = nu[..., 0]
        units = u.new_tensor([self.prime.force, self.prime.force, self.prime.moment])
        return (self.thrust(u, shaft) - self.thrust(u, torch.ones_like(u))) / units

    def acceleration_from_si(self, force: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations udot, vdot [m/s^2], rdot [rad/s^2] that an external force X, Y [N], N [N m] causes."""
        units = force.new_tensor([self.prime.force, self.prime.force, self.prime.moment])
        return (force / units) @ self.inertia_inverse.T * self.acceleration_units

    def shallow_change(
        self,
        nu: Float[Tensor, "*batch 3"],
        delta: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"],
        zeta: Float[Tensor, "*own"],
    ) -> tuple[Float[Tensor, "*both 3"], Float[Tensor, "*own 3"]] | None:
        """What shallow water adds, where the coefficients say it.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: Rudder angle [rad].
            shaft: n / n0 [-].
            zeta: Draught over the water under the keel, ``T / (h - T)`` [-].

        Returns:
            Additions to f' and to the diagonal of M' [-]; None where the coefficients hold for deep water alone.
        """
        return None

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides of surge, sway and yaw, mass terms such as ``(m + Xvr) v r`` included.

        ``f' = products @ table``; families whose forces are no such series override it.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            f' [-] in the ship's prime system.
        """
        assert self.table is not None
        return times(self.products(nu, delta), self.table)

    @abstractmethod
    def on_approach(self, speed: float) -> "Ship":
        """The ship as it comes into a manoeuvre at another speed [m/s]; each family says what is scaled or held."""

    def rates(
        self, nu: Float[Tensor, "*batch 3"], own: Float[Tensor, "*batch k"], inputs: Inputs
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch k"]]:
        """Accelerations, and the rates of the ship's own states; families that have some override it.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            own: Own states, see :attr:`own_names`.
            inputs: Rudder and shaft, and how the sides differ.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2]; rates of the own states.
        """
        nudot = self.acceleration(nu, inputs.delta)
        if inputs.shaft is not None:
            nudot = nudot + self.acceleration_from_force(self.shaft_force(nu, inputs.delta, inputs.shaft))
        return nudot, own

    def added(
        self, nudot: Float[Tensor, "*batch 3"], heeling: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch k"]]:
        """What external forces add to the rates: the accelerations that they cause, and those of the own states.

        Args:
            nudot: Accelerations by the forces without a heeling moment, see :meth:`acceleration_from_si`.
            heeling: Moment about the longitudinal axis [N m], positive to starboard.

        Returns:
            Additions to udot, vdot [m/s^2], rdot [rad/s^2] and to the rates of the own states.
        """
        return nudot, nudot[..., :0]

    def by_rudder(
        self,
        nu: Float[Tensor, "*batch 3"],
        delta: Float[Tensor, "*batch"],
        other: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"] | None = None,
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
        """What the rudder does at one angle and not at another.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: The one [rad].
            other: The other [rad].
            shaft: n / n0 [-]; None is nominal.

        Returns:
            Accelerations by its forces, and its heeling moment [N m], as :meth:`added` wants them; 0 of a ship that
            does not roll.
        """
        force = self.force(nu, delta) - self.force(nu, other)
        if shaft is not None:
            force = force + self.shaft_force(nu, delta, shaft) - self.shaft_force(nu, other, shaft)
        return self.acceleration_from_force(force), torch.zeros_like(force[..., 0])

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations ``nudot = units M'^-1 f'`` by :meth:`force`: udot, vdot [m/s^2], rdot [rad/s^2]."""
        return self.acceleration_from_force(self.force(nu, delta))

    def acceleration_from_force(self, force: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations udot, vdot [m/s^2], rdot [rad/s^2] that given right-hand sides f' [-] cause."""
        return force @ self.inertia_inverse.T * self.acceleration_units

    def force_from_acceleration(self, nudot: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """The right-hand sides f' [-] that cause given accelerations [m/s^2, rad/s^2], ``f' = M' nudot'``."""
        return (nudot / self.acceleration_units) @ self.inertia.T
