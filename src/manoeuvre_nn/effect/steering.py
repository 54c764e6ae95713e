"""Rudders that stand where they should but do less or more than they should there, and their late recording."""

from collections.abc import Mapping
from math import pi
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Parameter, Situation
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.effect.common import rudder_part, thrust_of
from manoeuvre_nn.effect.rudder import RudderEffect
from manoeuvre_nn.effect.sensors import shifted


class RudderDelay(RudderEffect):
    """A recorded rudder angle that is late."""

    name = "rudder_delay"
    candidate = True
    site = "sensor"
    label = "a late rudder recording"
    equations: ClassVar[tuple[str, ...]] = ("sensor:delta",)
    fingerprint = "The ship turns before the recorded rudder moves; the lead is the same time at every change."
    source = "delta_m(t) = delta(t - tau)"
    declared = (Parameter("delay_s", "s", -6.0, 10.0, 0.0, 1.5, (1.0, 3.0)),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Take the rudder angle from before.

        Args:
            channels: What perfect sensors would write.
            s: The situation over time.

        Returns:
            All channels.
        """
        delay = self.value("delay_s")
        return {k: shifted(c, s.time, delay) if k == "delta" else c for k, c in channels.items()}

    def indicated(self, recorded: Float[Tensor, "*batch n"], time: Float[Tensor, " n"]) -> Float[Tensor, "*batch n"]:
        """Take the rudder angle from after.

        Args:
            recorded: Recorded rudder angle [rad].
            time: Sample times [s].

        Returns:
            What the indicator showed at these times [rad].
        """
        return shifted(recorded, time, -self.value("delay_s"))


class RudderAreaLoss(RudderEffect):
    """A share of all forces of the rudder that is missing."""

    name = "rudder_area_loss"
    candidate = True
    label = "a loss of rudder area"
    fingerprint = "Everything that the rudder does is smaller by one share, at all angles and to both sides."
    source = "(1 - k) of the terms with the rudder angle"
    declared = (Parameter("fraction", "-", 0.0, 0.9, 0.0, 0.2, (0.15,)),)

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own m"]) -> Float[Tensor, "*batch 3"]:
        """What is missing.

        Args:
            s: The situation.
            memory: Not used.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        del memory
        return -self.value("fraction")[..., None] * rudder_part(self.ship, s)


class RudderStall(RudderEffect):
    """A rudder whose flow separates beyond an angle of attack: sway and yaw by it lose a share, its drag stays.

    The angle of attack is ``delta + gamma atan((v - L r / 2) / u)``, so that the rudder recovers as the ship begins to
    turn; the loss sets in smoothly within ``STALL_WIDTH``.
    """

    name = "rudder_stall"
    label = "a stalling rudder"
    fingerprint = "Weak rudder at the start of a hard-over only; it recovers as drift and yaw turn the inflow."
    source = "Whicker & Fehlner 1958 for the stall; flow straightening gamma of the MMG model, about .4"
    declared = (
        Parameter("angle_deg", "deg", 10.0, 45.0, None, 8.0, (20.0, 28.0)),
        Parameter("loss", "-", 0.0, 0.9, 0.0, 0.3, (0.3,)),
        Parameter("straightening", "-", 0.0, 1.0, 0.4, 0.15, (0.4,), form=True),
    )
    STALL_WIDTH = 2.0 * DEGREE

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own m"]) -> Float[Tensor, "*batch 3"]:
        """What is missing.

        Args:
            s: The situation.
            memory: Not used.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        del memory
        across = s.v - 0.5 * self.ship.particulars.length * s.r
        attack = s.delta + self.value("straightening") * torch.atan2(across, s.u)
        lost = self.value("loss") * torch.sigmoid((attack.abs() - self.angle("angle_deg")) / self.STALL_WIDTH)
        return -lost[..., None] * rudder_part(self.ship, s) * s.nu.new_tensor([0.0, 1.0, 1.0])


class Slipstream(RudderEffect):
    """Rudder forces that follow the propeller race, to a share.

    The dynamic pressure at the rudder over that of the approach is ``phi = [(u/U0)^2 + C T/T0] / (1 + C)`` with the
    thrust loading C of the approach; the rudder's part is multiplied by ``1 + share (phi - 1)``. A coefficient set
    whose rudder forces follow the speed already has a part of this: the share is what is missing, or too much.

    C is estimated with a propeller diameter of .7 T, a wake fraction of .3 and a thrust deduction of .2.
    """

    name = "slipstream"
    label = "rudder forces by the propeller race"
    equations: ClassVar[tuple[str, ...]] = ("Y", "N")
    fingerprint = (
        "Rudder forces follow thrust, not speed: the model's are too weak late in a turn, too strong in coasting."
    )
    source = "Momentum theory of the race (Brix 1993; Soeding 1998): V_inf^2 = V_A^2 (1 + C_Th)"
    declared = (Parameter("share", "-", -1.0, 1.5, 0.0, 0.5, (0.5,)),)

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own m"]) -> Float[Tensor, "*batch 3"]:
        """What is missing.

        Args:
            s: The situation.
            memory: Not used.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        del memory
        speed = self.ship.particulars.speed
        one = torch.ones_like(s.u)
        loading = self._loading()
        thrust = thrust_of(self.ship, s.u, s.shaft) / thrust_of(self.ship, speed * one, one)
        pressure = ((s.u / speed).square() + loading * thrust) / (1 + loading)
        return (self.value("share") * (pressure - 1))[..., None] * rudder_part(self.ship, s)

    def _loading(self) -> float:
        """Thrust loading coefficient C of the approach [-]."""
        p = self.ship.particulars
        disc = pi / 4 * (0.7 * p.draught) ** 2
        return p.calm_resistance / 0.8 / (0.5 * p.rho * (0.7 * p.speed) ** 2 * disc)
