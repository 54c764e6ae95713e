"""Heel: a roll motion of its own and what it does to the yaw moment."""

from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import GRAVITY


class RollCoupling(Effect):
    """A yaw moment in proportion to heel, the heel being that of the turn.

    ``phi'' + 2 zeta w0 phi' + w0^2 phi = w0^2 phi_s`` with ``phi_s = -(KG - T/2) (u r + dv/dt) / (g GM)`` and
    ``N = N_phi phi`` in units of ``.5 rho L^2 T U0^2``; heel to starboard is positive. dv/dt is that of the ship
    without effects. Own states: heel [rad] and its rate.
    """

    name = "roll_coupling"
    candidate = True
    measured_by = "the heel"
    site = "force"
    family = "heel"
    label = "a yaw moment by heel"
    equations = ("N",)
    fingerprint = "An odd yaw moment as the square of the speed that lags the turn and rings at the roll period."
    source = "Son & Nomoto 1982, the terms linear in heel; roll as an oscillator driven by the centripetal acceleration"
    declared = (Parameter("N_phi", "-", -0.2, 0.2, 0.0, 0.02, (0.01, -0.01)),)
    memory = 2

    def __init__(self, ship: Ship, **values: float) -> None:
        """Refuse a ship that rolls already."""
        if "phi" in ship.own_names:
            name = ship.particulars.name
            raise InputError(f"effect.{self.name}: the {name} rolls by itself: leave it out or write ship.rolls=false")
        super().__init__(ship, **values)

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own 2"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations by the moment of the heel."""
        yaw = self.value("N_phi") * self.ship.particulars.prime.moment * memory[..., 0] + 0.0 * s.u
        return self.ship.acceleration_from_si(torch.stack([0 * yaw, 0 * yaw, yaw], dim=-1))

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*own 2"]) -> Float[Tensor, "*batch 2"]:
        """The roll equation."""
        heel = self.ship.particulars.heeling
        arm = heel.kg - 0.5 * self.ship.particulars.draught
        steady = -arm / (GRAVITY * heel.gm) * (s.u * s.r + s.nudot[..., 1])
        phi, rate = memory.unbind(-1)
        omega = 2 * pi / heel.roll_period
        roll = omega**2 * (steady - phi) - 2 * heel.roll_damping * omega * rate
        return torch.stack(torch.broadcast_tensors(rate, roll), dim=-1)
