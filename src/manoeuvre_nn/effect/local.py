"""Forces by tugs, thrusters and banks that act for a while."""

from abc import abstractmethod
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.effect.common import ACROSS, RAMP, columns, compass, during, several

FAMILY = "local force"
KILO = 1000.0
OF_MIDSHIP = ("forward of midship", "aft of midship")
FORCE = Parameter("force_kN", "kN", -20000.0, 20000.0, 0.0, 250.0, (100.0, -100.0), sides=ACROSS)
LEVER_STARTS = (0.0, 0.15, -0.15, 0.3, -0.3)
LEVER = Parameter("lever_m", "m", -0.6, 0.6, None, 0.3, LEVER_STARTS, within="length", sides=OF_MIDSHIP)
TIMES = (*several(3), RAMP)


class _LateralForce(Effect):
    """A constant lateral force for a while, once or more, positive to starboard, at a lever that each gives itself."""

    site = "force"
    acts_indoors = False
    measured_by = "the forces of lines and thrusters"
    exclusive = "line or thruster"
    family = FAMILY
    equations = ("Y", "N")

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The force and its moment."""
        sway = KILO * self.value("force_kN") * during(self, s.time)
        return columns(torch.zeros_like(sway), sway, self._lever() * sway)

    @abstractmethod
    def _lever(self) -> Tensor:
        """Where it acts, forward of midship [m]."""


class SideForce(_LateralForce):
    """A constant lateral force for a while, positive to starboard, at a lever forward of midship."""

    name = "side_force"
    candidate = True
    label = "a side force"
    fingerprint = "Sway and yaw are pushed in a fixed ratio in one interval, on no account of heading or speed."
    source = "Constant force, built up over a ramp"
    declared = (FORCE, LEVER, *TIMES)

    def _lever(self) -> Tensor:
        """Where it acts, forward of midship [m]."""
        return self.value("lever_m")


class BowThruster(_LateralForce):
    """A bow thruster that is left running, positive to starboard, .4 L forward of midship give or take .03 L.

    The form parameter lever is where it acts, over the length: its tunnel is as far forward as the hull has room. No
    ship has more than some 3 MN: the largest passenger ships have four of 5500 kW, and 746 kW give ten tonnes.
    """

    name = "bow_thruster"
    candidate = True
    label = "a running bow thruster"
    fingerprint = "Sway and yaw are pushed to the same side in one interval, as by a force at the bow."
    source = (
        "Constant force, built up over a ramp; loss by forward speed is not modelled; as far forward as possible: "
        "Wartsila, Encyclopedia of Marine and Energy Technology, bow thruster; largest: Oasis of the Seas (Maritime "
        "Executive); thrust of a power: Ship Handling Pro, Thrusters"
    )
    declared = (
        replace(FORCE, low=-3000.0, high=3000.0),
        *TIMES,
        Parameter("lever", "-", 0.25, 0.5, 0.4, 0.03, (0.4,), form=True),
    )

    def _lever(self) -> Tensor:
        """Where it acts, forward of midship [m]."""
        return self.value("lever") * self.ship.particulars.length


class Tow(Effect):
    """A tug or tow line that pulls in a direction off the bow, at a lever forward of midship, for a while."""

    name = "tow"
    site = "force"
    acts_indoors = False
    measured_by = "the forces of lines and thrusters"
    exclusive = "line or thruster"
    family = FAMILY
    label = "a tow line"
    equations = ("X", "Y", "N")
    fingerprint = "All three equations are pushed in fixed ratios in one interval, on no account of heading or speed."
    source = "X = F cos a, Y = F sin a, N = x_t Y; the line follows the ship"
    declared = (
        Parameter("force_kN", "kN", 0.0, 20000.0, 0.0, 250.0, (150.0,)),
        Parameter("angle_deg", "deg", 0.0, 360.0, None, 360.0, (90.0, 270.0, 0.0, 180.0), period=360.0),
        LEVER,
        *TIMES,
    )

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """The force and its moment."""
        pull = KILO * self.value("force_kN") * during(self, s.time)
        ahead, starboard = compass(self.value("angle_deg"))
        return columns(pull * ahead, pull * starboard, self.value("lever_m") * pull * starboard)
