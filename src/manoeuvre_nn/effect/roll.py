"""Heel: a roll motion of its own, or the recorded one, and what it does to sway and yaw."""

from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.effect.common import columns, factor

N_PHI_OF_HALF_FORM = 0.01
"""N_phi at which half of what the form parameters say acts, half of its usual size."""


class RollCoupling(Effect):
    """Sway force and yaw moment by heel; the heel is the recorded one, or else that of the turn.

    ``phi'' + 2 zeta w0 phi' + w0^2 phi = w0^2 phi_s`` with ``phi_s = -(KG - T/2) (u r + dv/dt) / (g GM)``; with r', p'
    and dp'/dt over U0/L and its square::

        Y = (Y_phi + Y_rrphi r'^2) phi + Y_pdot dp'/dt      N = (N_phi + N_rrphi r'^2) phi + N_p p'

    in units of ``.5 rho L T U0^2`` and ``.5 rho L^2 T U0^2``; heel to starboard is positive. dv/dt is that of the ship
    without heel, other forces included as if they acted at half the draught; ``period`` is a factor on the natural
    period, which sway makes a tenth shorter on the container ship. Own states: heel [rad] and its rate. All but N_phi
    are form parameters. Their priors span both published ships: a least-squares fit to what heel does in turns and
    zigzags gives for Son & Nomoto's container ship N_rrphi -.1, Y_phi 0, Y_rrphi .2, N_p .004, Y_pdot .004, for Blanke
    & Christensen's naval vessel -.09, .02, .2, 0, -.004. They act by the share ``N_phi^2 / (N_phi^2 + .01^2)``: without
    N_phi there is no effect. Else five forces that no reported number tells of take up what wrong coefficients do.
    ``damping`` is a factor on zeta, which is .02 to .15 for ships without and with bilge keels, at rest and at speed.
    The arm (KG - T/2)/GM makes one number with N_phi, whose bound is Munk's moment of a heeled hull, about .17, at an
    arm three times as long.
    """

    name = "roll_coupling"
    candidate = True
    measured_by = "the heel"
    site = "force"
    family = "heel"
    label = "a yaw moment by heel"
    equations = ("N",)  # where N_phi acts: of the sway force that goes with it no number is told
    fingerprint = "An odd yaw moment as the square of the speed that lags the turn and rings at the roll period."
    source = (
        "Son & Nomoto 1982 and Blanke & Christensen 1993, the terms in heel that weigh most, v as it goes with r in "
        "turns; roll as an oscillator driven by the centripetal acceleration; Himeno 1981 for the range of its damping"
    )
    declared = (
        Parameter("N_phi", "-", -0.5, 0.5, 0.0, 0.02, (0.01, -0.01)),
        Parameter("N_rrphi", "-", -0.5, 0.5, 0.0, 0.1, (0.0,), form=True),
        Parameter("N_p", "-", -0.03, 0.03, 0.0, 0.004, (0.0,), form=True),
        Parameter("Y_phi", "-", -0.1, 0.1, 0.0, 0.02, (0.0,), form=True),
        Parameter("Y_rrphi", "-", -1.0, 1.0, 0.0, 0.2, (0.0,), form=True),
        Parameter("Y_pdot", "-", -0.03, 0.03, 0.0, 0.004, (0.0,), form=True),
        factor("period", 0.1, low=0.5, high=2.0),
        factor("damping", 0.5, low=0.2, high=3.0),
    )
    memory = 2

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Refuse a ship that rolls already."""
        if "phi" in ship.own_names:
            name = ship.particulars.name
            raise InputError(f"effect.{self.name}: the {name} rolls by itself: leave it out or write ship.rolls=false")
        super().__init__(ship, **values)

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own 2"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations by the forces of the heel."""
        p = self.ship.particulars
        phi, rate, roll = self._heel(s, memory)
        turn, per_second, size = s.r * p.time_unit, p.time_unit, self.value("N_phi")
        share = size**2 / (size**2 + N_PHI_OF_HALF_FORM**2)
        yaw = self.value("N_rrphi") * turn**2 * phi + self.value("N_p") * rate * per_second
        sway = (self.value("Y_phi") + self.value("Y_rrphi") * turn**2) * phi
        sway = p.prime.force * share * (sway + self.value("Y_pdot") * roll * per_second**2)
        yaw = size * phi + share * yaw
        return self.ship.acceleration_from_si(columns(0.0 * s.u, sway, p.prime.moment * yaw))

    def _heel(self, s: Situation, memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Heel [rad], its rate and acceleration: as recorded, or of the oscillator."""
        if s.heel is not None:
            phi, rate, roll = s.heel.unbind(-1)
            return phi, rate, roll
        rate, roll = self.memory_rate(s, memory).unbind(-1)
        return memory[..., 0], rate, roll

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*own 2"]) -> Float[Tensor, "*batch 2"]:
        """The roll equation."""
        heel = self.ship.particulars.heeling
        arm = heel.kg - 0.5 * self.ship.particulars.draught
        steady = -arm / (GRAVITY * heel.gm) * (s.u * s.r + s.nudot[..., 1])
        phi, rate = memory.unbind(-1)
        omega = 2 * pi / (heel.roll_period * self.value("period"))
        roll = omega**2 * (steady - phi) - 2 * heel.roll_damping * self.value("damping") * omega * rate
        return torch.stack(torch.broadcast_tensors(rate, roll), dim=-1)
