"""Propeller, engine and resistance."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.effect.common import ACROSS, columns, during, from_some_time

FAMILY = "propeller and resistance"
KILO = 1000.0


class PropellerSideForce(Effect):
    """A lateral force of the propeller, .48 L aft of midship, positive to starboard, in proportion to n squared."""

    name = "propeller_side_force"
    site = "force"
    candidate = True
    measured_by = "shaft speed and torque"
    family = FAMILY
    label = "a side force of the propeller"
    equations = ("Y", "N")
    fingerprint = "The ship turns one way with the rudder amidships on every heading, and more at higher shaft speed."
    source = "Transverse thrust of a single screw as a constant force at n0, with n^2"
    declared = (Parameter("force_kN", "kN", -10000.0, 10000.0, 0.0, 100.0, (50.0, -50.0), sides=ACROSS),)
    ARM = -0.48

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The force at the propeller."""
        sway = KILO * self.value("force_kN") * s.shaft.square()
        return columns(torch.zeros_like(sway), sway, self.ARM * self.ship.particulars.length * sway)


class PropellerPitchError(Effect):
    """Thrust that deviates by a fraction at every shaft speed, and the side force and moment that go with it.

    What a coefficient set makes of shaft speed and advance ratio otherwise, the race over the rudder, is left as it is.
    """

    name = "propeller_pitch_error"
    site = "force"
    candidate = True
    measured_by = "shaft speed and torque"
    family = FAMILY
    label = "a pitch error of the propeller"
    equations = ("X",)
    fingerprint = "Another speed on a straight course at the same shaft speed; the surplus grows as speed is lost."
    source = "dT = f T with T = R0 [(1 + s) n^2 - s n u/U0], or the ship's own thrust"
    declared = (
        Parameter("fraction", "-", -1.0, 1.0, 0.0, 0.15, (0.1, -0.1, 0.4, -0.4), sides=("more thrust", "less thrust")),
    )

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The surplus of thrust and of what goes with it."""
        return self.value("fraction")[..., None] * self.ship.thrust(s.u, s.shaft)


class ThrustLoss(Effect):
    """An engine that slows down for a while, or from some time on, or a propeller that does as if it did.

    The propeller, and the rudder in its race, act as with a shaft slower by a fraction than the recorded one, or than
    the nominal one where none was recorded: ``n -> n (1 - f)`` in :meth:`~manoeuvre_nn.core.ship.Ship.shaft_force`.
    """

    name = "thrust_loss"
    site = "force"
    candidate = True
    measured_by = "shaft speed and torque"
    family = FAMILY
    label = "a loss of thrust"
    equations = ("X",)
    fingerprint = "The ship slows down from some time on, on every heading and without a turn; sway and yaw are right."
    source = "Shaft speed as a step; what it does is the ship's own, else T = R0 [(1 + s) n^2 - s n u/U0]"
    declared = (Parameter("rpm_loss", "-", 0.0, 1.0, 0.0, 0.2, (0.15, 0.5)), *from_some_time())

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """What the ship does with the slower shaft, less what she does with the one that is shown."""
        slower = s.shaft * (1 - self.value("rpm_loss") * during(self, s.time))
        nu, delta, shown = s.nu.expand(*slower.shape, 3), s.delta.expand(slower.shape), s.shaft.expand(slower.shape)
        lost = self.ship.shaft_force(nu, delta, slower) - self.ship.shaft_force(nu, delta, shown)
        return self.ship.acceleration_from_force(lost)


class PowerLimit(Effect):
    """An engine that loses shaft speed as the ship loses speed: ``n/n0`` follows ``1 - k (1 - u/U0)`` with a lag.

    Its own state is n/n0; what the shaft speed does to the ship is the ship's own
    :meth:`~manoeuvre_nn.core.ship.Ship.shaft_force`.
    """

    name = "power_limit"
    candidate = True
    measured_by = "shaft speed and torque"
    site = "actuator"
    family = FAMILY
    label = "an engine at its limit"
    equations = ("X",)
    fingerprint = "More speed is lost in turns to both sides than by the hull alone; straight runs are right."
    source = "Linear shaft speed along the engine's limit curve; first-order lag"
    declared = (
        Parameter("rpm_slope", "-", 0.0, 1.0, 0.0, 0.3, (0.1, 0.5)),
        Parameter("lag_s", "s", 1.0, 60.0, 8.0, 5.0, (8.0,), form=True),
    )
    memory = 1

    def _limit(self, s: Situation) -> Tensor:
        """Shaft speed that the engine can hold, n/n0 [-]."""
        return 1 - self.value("rpm_slope") * (1 - s.u / self.ship.particulars.speed)

    def memory_at_start(self, s: Situation) -> Float[Tensor, "*batch 1"]:
        """Shaft speed of a steady approach."""
        return self._limit(s)[..., None]

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*own 1"]) -> Float[Tensor, "*batch 1"]:
        """Rate of the shaft speed."""
        return ((self._limit(s) - memory[..., 0]) / self.value("lag_s"))[..., None]

    def shaft(self, s: Situation, memory: Float[Tensor, "*own 1"]) -> Float[Tensor, "*batch"]:
        """Shaft speed."""
        return memory[..., 0] + 0.0 * s.u

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """The tachometer shows the shaft speed of the situation."""
        return {k: s.shaft if k == "shaft_recorded" else c for k, c in channels.items()}


class HullFouling(Effect):
    """Added resistance as a fraction of the calm-water resistance at approach speed, growing with u squared."""

    name = "hull_fouling"
    site = "force"
    candidate = True
    measured_by = "shaft speed and torque"
    family = FAMILY
    label = "a fouled hull"
    equations = ("X",)
    fingerprint = (
        "Less speed on every heading, straight and turning, as the square of the speed; sway and yaw are right."
    )
    source = "dX = -a R0 (u/U0) |u/U0|; a of .1 to .8 (Schultz 2007)"
    declared = (Parameter("added_resistance", "-", 0.0, 5.0, 0.0, 0.3, (0.2, 1.0)),)

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The added resistance."""
        p = self.ship.particulars
        speed = s.u / p.speed
        surge = -self.value("added_resistance") * p.calm_resistance * speed * speed.abs()
        return columns(surge, torch.zeros_like(surge), torch.zeros_like(surge))


class IceResistance(Effect):
    """A resisting force that does not depend on the speed; it fades below ``SLOW``."""

    name = "ice_resistance"
    site = "force"
    candidate = True
    acts_indoors = False
    measured_by = "shaft speed and torque"
    family = FAMILY
    label = "resistance by ice"
    equations = ("X",)
    fingerprint = "Less speed by a constant force: relatively more the slower the ship is."
    source = "Resistance in brash ice at low speed, nearly independent of speed"
    declared = (Parameter("force_kN", "kN", 0.0, 20000.0, 0.0, 200.0, (100.0, 500.0)),)
    SLOW = 0.1

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The resistance."""
        surge = -KILO * self.value("force_kN") * torch.tanh(s.u / self.SLOW)
        return columns(surge, torch.zeros_like(surge), torch.zeros_like(surge))
