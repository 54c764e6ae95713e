"""Rudders that are not where the indicator says, do less or more than they should there, or are recorded late.

Angles are positive to starboard, as everywhere in the package.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from itertools import pairwise
from math import pi
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, PerRow, Series, Situation
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.effect.common import LATE, rudder_part
from manoeuvre_nn.effect.sensors import shifted


class _RudderEffect(Effect, ABC):
    """A fault of the rudder or of its gear."""

    site = "actuator"
    family = "rudder"
    measured_by = "the angle of the rudder stock"
    equations: ClassVar[tuple[str, ...]] = ("actuator:rudder",)


class RudderOffset(_RudderEffect):
    """A blade that stands beside the indicated angle: blade minus indicator, positive to starboard."""

    name = "rudder_offset"
    candidate = True
    label = "a rudder offset"
    fingerprint = "The ship turns one way with the rudder shown amidships, on every heading, more at higher speed."
    source = "delta = shown + offset"
    declared = (
        Parameter(
            "offset_deg",
            "deg",
            -35.0,
            35.0,
            0.0,
            1.5,
            (1.0, -1.0, 6.0, -6.0),
            sides=("turning to starboard", "turning to port"),
        ),
    )

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """The indicated angle and the offset."""
        return shown + self.angle("offset_deg")


class RudderBacklash(_RudderEffect):
    """Play between indicator and blade: the blade moves only where the indicator pushes it (play operator)."""

    name = "rudder_backlash"
    candidate = True
    label = "backlash of the rudder"
    fingerprint = "After a reversal the ship answers as if the rudder waited; order and turn make a hysteresis loop."
    source = "Play operator of total width w: blade = clamp(before, shown - w/2, shown + w/2)"
    declared = (Parameter("width_deg", "deg", 0.0, 70.0, 0.0, 1.5, (0.6, 2.5, 10.0, 30.0)),)

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """The angle before, pushed to within half the play of the indicated one."""
        half = 0.5 * self.angle("width_deg")
        return torch.clamp(before, shown - half, shown + half)

    def blade_in_turn(self, start: Float[Tensor, "rows 1"], order: Series, shown: Series, elapsed: Series) -> Series:
        """The same angles; one clamp after another is a clamp, so that twice as many are put together in every round.

        Returns:
            Blade angles [rad].
        """
        half = 0.5 * self.angle("width_deg")
        low, high, reach = shown - half, shown + half, 1
        while reach < shown.shape[-1]:
            both = (torch.clamp(a[:, :-reach], low[:, reach:], high[:, reach:]) for a in (low, high))
            low, high = (torch.cat([a[:, :reach], b], dim=-1) for a, b in zip((low, high), both, strict=True))
            reach *= 2
        return torch.clamp(start, low, high)


class RudderSlow(_RudderEffect):
    """A blade that follows the order at a rate of its own, whatever the indicator does."""

    name = "rudder_slow"
    candidate = True
    label = "a slow rudder"
    fingerprint = "Disagreement while the rudder is moving, the larger the change of angle; none once it rests."
    source = "Rate limit between order and blade"
    declared: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_deg_s", "deg/s", 0.1, 10.0, 2.5, 1.5, (1.2,)),)

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Take the nominal rate, at which nothing is wrong, from the ship."""
        nominal = ship.particulars.rudder_rate / DEGREE
        starts = (0.5 * nominal, 0.2 * nominal, 0.08 * nominal)
        rate = Parameter("rate_deg_s", "deg/s", 0.01 * nominal, nominal, nominal, 0.6 * nominal, starts)
        self.declared = (rate,)  # type: ignore[misc] # the null is the ship's
        super().__init__(ship, **values)

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """The angle before, moved towards the order; exact while the order is constant."""
        reach = self.angle("rate_deg_s") * elapsed
        return before + torch.clamp(order - before, -reach, reach)

    def blade_in_turn(self, start: Float[Tensor, "rows 1"], order: Series, shown: Series, elapsed: Series) -> Series:
        """The same angles, from one change of the order to the next at once.

        Returns:
            Blade angles [rad].
        """
        changes = ((order[:, 1:] != order[:, :-1]).any(dim=0).nonzero()[:, 0] + 1).tolist()
        angles = [start]
        for begin, end in pairwise([0, *changes, order.shape[-1]]):
            since = elapsed[:, begin:end].cumsum(dim=-1)
            angles.append(self.blade(angles[-1][:, -1:], order[:, begin:end], shown[:, begin:end], since))
        return torch.cat(angles[1:], dim=-1)


class RudderSaturation(_RudderEffect):
    """A blade that stops before the indicator does."""

    name = "rudder_saturation"
    label = "a rudder that stops early"
    fingerprint = "Disagreement at large rudder angles only, as if less had been ordered."
    source = "delta = clamp(shown, -limit, limit)"
    declared = (Parameter("limit_deg", "deg", 5.0, 45.0, 45.0, 10.0, (25.0, 15.0)),)

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """The indicated angle as far as the stop."""
        limit = self.angle("limit_deg")
        return torch.minimum(torch.maximum(shown, -limit), limit)


class RudderDelay(_RudderEffect):
    """A recorded rudder angle that is late."""

    name = "rudder_delay"
    candidate = True
    site = "sensor"
    label = "a late rudder recording"
    equations: ClassVar[tuple[str, ...]] = ("sensor:delta",)
    fingerprint = "The ship turns before the recorded rudder moves; the lead is the same time at every change."
    source = "delta_m(t) = delta(t - tau)"
    # A start must be nearer than a rudder movement lasts: between movements that do not overlap nothing leads on.
    STARTS_S = (1.0, 4.0, -3.0, *(float(k) for k in range(8, 60, 5)), -8.0)
    declared = (Parameter("delay_s", "s", -60.0, 60.0, 0.0, 1.5, STARTS_S, sides=LATE),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Take the rudder angle from before; it stood still before the run, and is taken to after it."""
        asked = _within(s.time, s.time - self.value("delay_s"))
        return {k: shifted(c, s.time, s.time - asked) if k == "delta" else c for k, c in channels.items()}

    def indicated(
        self, recorded: Float[Tensor, "*batch n"], ordered: Float[Tensor, " n"] | None, time: Float[Tensor, " n"]
    ) -> Float[Tensor, "*batch n"]:
        """Take the rudder angle from after; what was never recorded from the orders, or held where there are none."""
        asked = time + self.value("delay_s")
        known = _within(time, asked)
        angle = shifted(recorded, time, time - known)
        return angle if ordered is None else torch.where(asked == known, angle, ordered)


def _within(time: Float[Tensor, "*#batch n"], asked: Float[Tensor, "*#batch n"]) -> Float[Tensor, "*batch n"]:
    """Times of which a record tells: before its first sample that one, beyond its last that."""
    return torch.minimum(torch.maximum(asked, time[..., :1]), time[..., -1:])


class _RudderForce(_RudderEffect, ABC):
    """A rudder that does more or less than it should at the angle where it stands."""

    axes: ClassVar[tuple[float, float, float]] = (1.0, 1.0, 1.0)
    """Which of surge, sway and yaw are concerned."""

    @abstractmethod
    def share(self, s: Situation) -> Float[Tensor, "*batch"]:
        """What is added to the rudder's part, over this part [-]."""

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own m"]) -> Float[Tensor, "*batch 3"]:
        """A share of what the rudder does and would not do amidships."""
        return self.share(s)[..., None] * rudder_part(self.ship, s)[0] * s.nu.new_tensor(self.axes)

    def heeling(self, s: Situation) -> Float[Tensor, "*batch"]:
        """The same share of its heeling moment."""
        return self.share(s) * rudder_part(self.ship, s)[1]


class RudderAreaLoss(_RudderForce):
    """A share of what the rudder does at its angle, and would not do amidships, that is missing.

    Amidships a rudder is a fin, in the flow that drift and yaw turn: that part belongs to the hull here.
    """

    name = "rudder_area_loss"
    candidate = True
    label = "a loss of rudder area"
    fingerprint = "Everything that the rudder does is smaller by one share, at all angles and to both sides."
    source = "(1 - k) of the terms with the rudder angle"
    declared = (Parameter("fraction", "-", 0.0, 1.0, 0.0, 0.2, (0.1, 0.5, 0.9)),)

    def share(self, s: Situation) -> Float[Tensor, "*batch"]:
        """What is missing."""
        return -self.value("fraction") + torch.zeros_like(s.u)

    def changed_terms(self) -> Float[Tensor, "terms 3 3"] | None:
        """The share that is missing of every term with the rudder angle."""
        if not self.ship.terms:
            return None
        units = self.ship.velocity_units
        over, middle = (self.ship.products(0.5 * units, 0 * units[0] + angle) for angle in (0.5, 0.0))
        lost = -self.value("fraction").reshape(-1)[0] * torch.eye(3).to(self.values)
        return (over != middle)[:, None, None] * lost


class RudderStall(_RudderForce):
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
    axes = (0.0, 1.0, 1.0)

    def share(self, s: Situation) -> Float[Tensor, "*batch"]:
        """What is missing."""
        across = s.v - 0.5 * self.ship.particulars.length * s.r
        attack = s.delta + self.value("straightening") * torch.atan2(across, s.u)
        lost = self.value("loss") * torch.sigmoid((attack.abs() - self.angle("angle_deg")) / self.STALL_WIDTH)
        return -lost


class Slipstream(_RudderForce):
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
    declared = (Parameter("share", "-", -2.0, 3.0, 0.0, 0.5, (0.5,)),)

    def share(self, s: Situation) -> Float[Tensor, "*batch"]:
        """What is missing."""
        speed = self.ship.particulars.speed
        one = torch.ones_like(s.u)
        loading = self._loading()
        thrust = self.ship.thrust(s.u, s.shaft)[..., 0] / self.ship.thrust(speed * one, one)[..., 0]
        pressure = ((s.u / speed).square() + loading * thrust) / (1 + loading)
        return self.value("share") * (pressure - 1)

    def _loading(self) -> float:
        """Thrust loading coefficient C of the approach [-]."""
        p = self.ship.particulars
        disc = pi / 4 * (0.7 * p.draught) ** 2
        return p.calm_resistance / 0.8 / (0.5 * p.rho * (0.7 * p.speed) ** 2 * disc)
