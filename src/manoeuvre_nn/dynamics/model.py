"""A reference ship, an identified network and stacks of them: the same thing to a solver."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, rate_of_state


class CalmWater(Model):
    """A ship that moves by its own coefficients; what the shaft adds follows the ship's own rule."""

    def __init__(self, ship: Ship) -> None:
        """Wrap a ship."""
        super().__init__()
        self.ship = ship

    @property
    def hull(self) -> Ship:
        """The ship itself."""
        return self.ship

    @property
    def own_names(self) -> tuple[str, ...]:
        """Those of the ship."""
        return self.ship.own_names

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """The state of a ship that is upright and does not roll."""
        return nn.functional.pad(state, (0, len(self.own_names))) if self.own_names else state

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state by the ship's coefficients."""
        nudot, own = self.ship.rates(state[..., :3], state[..., 6:], inputs)
        return rate_of_state(state, nudot, own)

    def on_approach(self, speed: float) -> "CalmWater":
        """The ship's own way to take on another approach speed."""
        return CalmWater(self.ship.on_approach(speed))


class IdentifiedShip(Model):
    """A known part and a network: ``M'_known nudot' = f'_known(nu, delta) + g'(nu, delta)``.

    Attributes:
        known: Inertia and whatever forces are taken as known (Clarke's linear part, or none).
        network: Scaled (u, v, r, delta) and what else it takes -> scaled g; see :class:`Scaling`.
        scaling: What the network's inputs and outputs are in.

    Source:
        Wang 1996, eqs 4.30-4.35; Rajesh & Bhattacharyya 2009, eqs 10-12.
    """

    def __init__(self, known: Ship, network: Network, scaling: Scaling) -> None:
        """Join the parts."""
        super().__init__()
        self.known, self.network, self.scaling = known, network, scaling

    @property
    def hull(self) -> Ship:
        """The known part."""
        return self.known

    def network_inputs(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch columns"]:
        """What the network sees: scaled velocities and rudder (4), and shaft and relative wind (7) if one is given."""
        delta = inputs.delta.expand(state.shape[:-1])
        seen = self.scaling.inputs(torch.cat([state[..., :3] / self.known.velocity_units, delta[..., None]], dim=-1))
        given = {name: value for name, value in inputs.given.items() if name in self.network.takes}
        if not given:
            return seen
        one = seen.new_ones(())
        pace = given["approach"] if "approach" in given else self.network.shaft_ratio * given.get("shaft", one)
        ahead, aside = -state[..., 0], -state[..., 1]  # without wind the air meets the ship as she goes
        if "wind_north" in given:
            over_ground = earth_to_body(given["wind_north"], given["wind_east"], state[..., 5])
            ahead, aside = over_ground[0] + ahead, over_ground[1] + aside
        wind = torch.stack([ahead, aside], dim=-1) / self.particulars.speed
        return torch.cat([seen, pace.expand(delta.shape)[..., None], wind], dim=-1)

    def accelerations(
        self, nu: Float[Tensor, "*batch 3"], inputs: Inputs, unknown: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch 3"]:
        """Accelerations from the known part and given outputs of the network.

        Args:
            nu: u, v [m/s], r [rad/s].
            inputs: Rudder and shaft; where the network does not take the shaft, the known part's rule holds.
            unknown: Scaled outputs of the network.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        force = self.known.force(nu, inputs.delta) + self.scaling.restore(unknown)
        nudot = self.known.acceleration_from_force(force)
        if inputs.shaft is None or "shaft" in self.network.takes:
            return nudot
        extra = self.known.shaft_force(nu, inputs.delta, inputs.shaft)
        return nudot + self.known.acceleration_from_force(extra)

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch 6"]:
        """Rate of the state from the known part and the network."""
        unknown = self.network(self.network_inputs(state, inputs))
        return rate_of_state(state, self.accelerations(state[..., :3], inputs, unknown))

    def sensitivities(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch k 3"]:
        """What the network's coefficients may add, by the covariance of its fit."""
        forces = self.scaling.restore(self.network.sensitivities(self.network_inputs(state, inputs)))
        return self.known.acceleration_from_force(forces)

    @property
    def noise(self) -> Float[Tensor, " 6"]:
        """Standard deviation that recorded u, v, r, x, y, psi had in the network's fit [SI]; 0 without one."""
        unit, length = self.known.velocity_units, self.particulars.length
        return self.network.noise_of_fit.to(unit) * torch.cat([unit, unit.new_tensor([length, length, 1.0])])

    def on_approach(self, speed: float) -> "IdentifiedShip":
        """The known part takes on the speed; a network in the (rho, L, T, U0) system thereby scales with it.

        In the BIS system nothing scales: unless the network knows the shaft speed, it answers for one only.

        Args:
            speed: Approach speed [m/s].

        Returns:
            A new model that shares the network.
        """
        known = self.known.on_approach(speed)
        network = self.network.at_shaft(known.shaft_rpm / self.known.shaft_rpm)
        return IdentifiedShip(known, network, self.scaling)
