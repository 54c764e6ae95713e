"""A reference ship, an identified network and stacks of them: the same thing to a solver."""

import copy
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.drive import Drive, air_velocity, approach_speed
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.network.series import Series


class CalmWater(Dynamics):
    """A ship that moves by its own coefficients."""

    def __init__(self, ship: Ship) -> None:
        """Wrap a ship.

        Args:
            ship: The ship.
        """
        super().__init__()
        self.ship = ship

    @property
    def particulars(self) -> Particulars:
        """Those of the ship."""
        return self.ship.particulars

    @property
    def hull(self) -> Ship:
        """The ship itself."""
        return self.ship

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations by the ship's coefficients.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        return self.ship.acceleration(nu, delta)

    def on_approach(self, speed: float) -> "CalmWater":
        """The ship's own way to take on another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return CalmWater(self.ship.on_approach(speed))


class IdentifiedShip(Dynamics):
    """A known part and a network: ``M'_known nudot' = f'_known(nu, delta) + g'(nu, delta)``.

    Attributes:
        known: Inertia and whatever forces are taken as known (Clarke's linear part, or none).
        network: Scaled (u, v, r, delta) -> scaled g; see :class:`Scaling`.
        scaling: What the network's inputs and outputs are in.
        drive: Recorded shaft speed and wind, which a :class:`.Series` makes use of; None is the nominal speed in calm.

    Source:
        Wang 1996, eqs 4.30-4.35; Rajesh & Bhattacharyya 2009, eqs 10-12.
    """

    def __init__(self, known: Ship, network: nn.Module, scaling: "Scaling", drive: Drive | None = None) -> None:
        """Join the parts.

        Args:
            known: Known part.
            network: Scaled inputs (..., 4) -> scaled outputs (..., 3).
            scaling: Input and output scaling in the known part's prime system.
            drive: Recorded shaft speed and wind.
        """
        super().__init__()
        self.known, self.network, self.scaling, self.drive = known, network, scaling, drive

    def network_inputs(
        self, state: Float[Tensor, "*batch n"], delta: Float[Tensor, "*batch"], time: Float[Tensor, "*batch"] | None
    ) -> Float[Tensor, "*batch inputs"]:
        """What the network sees: scaled velocities and rudder, then shaft speed and relative wind if there is a drive.

        Args:
            state: u, v, r, x, y, psi, ...
            delta: Rudder angle [rad].
            time: Time since the start of the recording [s].

        Returns:
            Scaled inputs, 4 or 7.
        """
        inputs = self.scaling.inputs(torch.cat([state[..., :3] / self.known.velocity_units, delta[..., None]], dim=-1))
        if self.drive is None or time is None:
            return inputs
        n, north, east = self.drive.at(time).unbind(-1)
        cos, sin = state[..., 5].cos(), state[..., 5].sin()
        ahead, aside = north * cos + east * sin - state[..., 0], east * cos - north * sin - state[..., 1]
        wind = torch.stack([ahead, aside], dim=-1) / self.particulars.speed
        return torch.cat([inputs, n[..., None], wind], dim=-1)

    def forward(
        self,
        state: Float[Tensor, "*batch 6"],
        delta: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"] | None = None,
    ) -> Float[Tensor, "*batch 6"]:
        """Rate of the state, with what was recorded of shaft speed and wind.

        Args:
            state: u, v, r, x, y, psi.
            delta: Rudder angle [rad].
            time: Time since the start of the recording [s].

        Returns:
            Its time derivative.
        """
        if self.drive is None:
            return super().forward(state, delta, time)
        nu = state[..., :3]
        unknown = self.scaling.restore(self.network(self.network_inputs(state, delta, time)))
        nudot = self.known.acceleration_from_force(nu, self.known.force(nu, delta) + unknown)
        return torch.cat([nudot, kinematics(state)], dim=-1)

    def driven(self, recordings: Sequence[Recording], times: Sequence[Float[np.ndarray, " _"]]) -> "IdentifiedShip":
        """The model with the shaft speed and the wind of recordings.

        Args:
            recordings: One for each row of a batch.
            times: Even times of each row.

        Returns:
            The same model unless its network is a series.
        """
        if not isinstance(self.network, Series):
            return self
        tables = [self._driving(r, t) for r, t in zip(recordings, times, strict=True)]
        longest = max(len(t) for t in times)
        padded = np.stack([np.concatenate([d, np.repeat(d[-1:], longest - len(d), axis=0)]) for d in tables])
        other = copy.copy(self)
        other.drive = Drive(self.known.velocity_units.new_tensor(padded), float(times[0][1] - times[0][0]),
                            float(times[0][0] - recordings[0].time[0]))  # fmt: skip
        return other

    def row(self, number: int) -> "IdentifiedShip":
        """The model that moves one row of a batch that is driven.

        Args:
            number: Number of the row.

        Returns:
            The same where nothing is driven.
        """
        if self.drive is None:
            return self
        other = copy.copy(self)
        other.drive = self.drive.row(number)
        return other

    def _driving(self, recording: Recording, times: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """What a series takes from a recording: its third input from last, and the air's velocity [m/s]."""
        assert isinstance(self.network, Series)
        speed = approach_speed(recording, self.particulars) / self.particulars.speed
        pace = np.full(len(recording), speed)
        if self.network.speed_law == "shaft" and "n" in recording.channels:
            pace = recording["n"] * 60 / self.known.shaft_rpm
        wind = air_velocity(recording, self.particulars) if self.network.feels_wind else (0 * pace, 0 * pace)
        return np.stack([np.interp(times, recording.time, row) for row in (pace, *wind)], axis=-1)

    @property
    def particulars(self) -> Particulars:
        """Those of the known part."""
        return self.known.particulars

    @property
    def hull(self) -> Ship:
        """The known part."""
        return self.known

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations from the known part and the network.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        inputs = torch.cat([nu / self.known.velocity_units, delta[..., None]], dim=-1)
        unknown = self.scaling.restore(self.network(self.scaling.inputs(inputs)))
        return self.known.acceleration_from_force(nu, self.known.force(nu, delta) + unknown)

    def at_shaft(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """Through a series' own n where it has one, see :meth:`Dynamics.at_shaft`."""
        if not isinstance(self.network, Series) or self.network.speed_law != "shaft":
            return super().at_shaft(nu, delta, shaft)
        unknown = self.scaling.restore(self.network(self._inputs_at_shaft(nu, delta, shaft)))
        return self.known.acceleration_from_force(nu, self.known.force(nu, delta) + unknown)

    def _inputs_at_shaft(self, nu: Tensor, delta: Tensor, shaft: Tensor) -> Tensor:
        """What a series sees at a shaft speed in still air, which meets the ship as she goes."""
        assert isinstance(self.network, Series)
        inputs = self.scaling.inputs(torch.cat([nu / self.known.velocity_units, delta[..., None]], dim=-1))
        if self.network.speed_law != "shaft":
            return inputs
        n = (shaft * self.network.shaft).expand(delta.shape)[..., None]
        return torch.cat([inputs, n, -inputs[..., :2]], dim=-1)

    def doubts(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch k 3"]:
        """What the coefficients of a series may add, by the covariance of its fit.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].
            shaft: Shaft speed over the nominal one [-]; only a series with the shaft speed in it makes use of it.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2] by one standard error of each independent combination; no row for other
            networks.
        """
        if not isinstance(self.network, Series) or not bool(self.network.covariance.any()):
            return super().doubts(nu, delta, shaft)
        forces = self.scaling.restore(self.network.doubts(self._inputs_at_shaft(nu, delta, shaft)))
        return self.known.acceleration_from_force(nu[..., None, :].expand(forces.shape), forces)

    @property
    def noise(self) -> Float[Tensor, " 6"]:
        """Standard deviation that recorded u, v, r, x, y, psi had in the fit of a series [SI]; else 0."""
        if not isinstance(self.network, Series):
            return super().noise
        unit, length = self.known.velocity_units, self.particulars.length
        return self.network.noise.to(unit) * torch.cat([unit, unit.new_tensor([length, length, 1.0])])

    def on_approach(self, speed: float) -> "IdentifiedShip":
        """The known part takes on the speed; a network in the (rho, L, T, U0) system thereby scales with it.

        In the BIS system nothing scales: unless the network knows the shaft speed, it answers for one only.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics that share the network.
        """
        known, network = self.known.on_approach(speed), self.network
        if isinstance(network, HullRudder | Series):
            network = network.at_shaft(float(network.shaft) * known.shaft_rpm / self.known.shaft_rpm)
        return IdentifiedShip(known, network, self.scaling)


class Scaling(nn.Module):
    """Shift and scale between prime variables and what a network sees.

    Attributes:
        shift: Subtracted from (u', v', r', delta), shape (4,).
        scale: Divides them then, shape (4,).
        output_scale: Multiplies the network's outputs, shape (3,).
    """

    shift: Tensor
    scale: Tensor
    output_scale: Tensor

    def __init__(
        self, shift: Float[Tensor, " 4"], scale: Float[Tensor, " 4"], output_scale: Float[Tensor, " 3"]
    ) -> None:
        """Store the numbers as buffers, so that a checkpoint holds them.

        Args:
            shift: Offset of the inputs.
            scale: Scale of the inputs.
            output_scale: Scale of the outputs.
        """
        super().__init__()
        self.register_buffer("shift", shift)
        self.register_buffer("scale", scale)
        self.register_buffer("output_scale", output_scale)

    def inputs(self, prime: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
        """What the network sees.

        Args:
            prime: u', v', r', delta.

        Returns:
            Scaled inputs.
        """
        return (prime - self.shift) / self.scale

    def outputs(self, g: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """What the network is trained on.

        Args:
            g: g1', g2', g3' [-].

        Returns:
            Scaled targets.
        """
        return g / self.output_scale

    def restore(self, outputs: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """From the network's outputs to g'.

        Args:
            outputs: Scaled outputs.

        Returns:
            g1', g2', g3' [-].
        """
        return outputs * self.output_scale


class Stacked(Dynamics):
    """Different ships or networks of one structure as rows of a batch.

    Row i of every batch that it is given moves by model i; ``torch.func.vmap`` over the stacked parameters.
    """

    def __init__(self, models: Sequence[Dynamics]) -> None:
        """Stack models of one class and structure.

        Args:
            models: One for each row.

        Raises:
            InputError: If the rows differ in more than their tensors: in L, U0, rudder rate or the model's own rules.
        """
        super().__init__()
        if len({(m.particulars.length, m.particulars.speed, m.particulars.rudder_rate) for m in models}) > 1:
            raise InputError("stacked models differ in L, U0 or rudder rate; run such ships one after the other")
        self._template = [models[0]]  # in a list, so that its parameters are not registered a second time
        self.parameters_of_rows, self.buffers_of_rows = torch.func.stack_module_state(list(models))
        with torch.no_grad():
            # A rule that is not a tensor (sign of the rudder, scaling) would silently be the first row's.
            unit = self._template[0].particulars
            nu = next(iter(self.buffers_of_rows.values())).new_tensor([0.8, -0.1, 0.2]) * unit.speed
            nu, delta = nu / nu.new_tensor([1.0, 1.0, unit.length]), nu.new_tensor(0.2)
            alone = torch.stack([m.acceleration(nu, delta) for m in models])
            if not torch.allclose(self.acceleration(nu.expand(len(models), 3), delta.expand(len(models))), alone):
                raise InputError("stacked models differ in rules, not only in numbers; run them one after the other")

    @property
    def particulars(self) -> Particulars:
        """Those of the first row."""
        return self._template[0].particulars

    @property
    def hull(self) -> Ship:
        """That of the first row."""
        return self._template[0].hull

    def acceleration(self, nu: Float[Tensor, "rows 3"], delta: Float[Tensor, " rows"]) -> Float[Tensor, "rows 3"]:
        """Accelerations of every row by its own model.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """

        def one(parameters: dict, buffers: dict, velocity: Tensor, rudder: Tensor) -> Tensor:
            state = torch.cat([velocity, velocity.new_zeros(3)])
            return torch.func.functional_call(self._template[0], (parameters, buffers), (state, rudder))[:3]

        return torch.func.vmap(one)(self.parameters_of_rows, self.buffers_of_rows, nu, delta)

    def on_approach(self, speed: float) -> "Stacked":
        """Not defined for a stack: set the speed of each model before stacking.

        Args:
            speed: Approach speed [m/s].

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("set the approach speed of each model before stacking them")
