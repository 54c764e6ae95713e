"""A bank beside the ship."""

from typing import Literal

from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.effect.common import columns, compass, direction, factor

Side = Literal["starboard", "port"]
SUCTION, CUSHION = 0.1, 0.05
"""k_Y and k_N of a strength of 1, of the order measured at moderate under-keel clearance."""


class Bank(Effect):
    """A straight vertical bank on one side: suction towards it, the bow pushed away from it.

    ``Y = k_Y rho u|u| B T y``, ``N = -k_N rho u|u| B T L y``, ``y = +- B / (2 d)``, d the distance of midship from the
    bank. The bank line runs in a compass direction; ``distance_m`` is that of the run's origin from it, to the side of
    the bank. With ``follow`` the bank keeps that distance whatever the ship does.
    """

    name = "bank"
    site = "force"
    acts_indoors = False
    measured_by = "the forces of lines and thrusters"
    family = "local force"
    label = "a bank"
    equations = ("Y", "N")
    fingerprint = "Sway and yaw of opposite sense, as the square of the speed, falling with the distance from a line."
    source = "Form of Norrbin 1974, y_B = (B/2)(1/y_s - 1/y_p); k_Y and k_N are orders of magnitude"
    declared = (
        Parameter("strength", "-", 0.0, 20.0, 0.0, 2.0, (1.0,)),
        Parameter("distance_m", "m", 20.0, 2000.0, None, 200.0, (100.0, 300.0)),
        direction("along_deg"),
        factor("cn", 0.4),
    )

    def __init__(self, ship: Ship, side: Side = "starboard", follow: bool = False, **values: Endless) -> None:
        """Choose the side.

        Args:
            ship: The ship that it acts on.
            side: On which side of a ship that sails along the bank it is.
            follow: Whether the bank keeps its distance.
            values: Parameter = value in its unit.
        """
        check_choice("effect.bank.side", side, ("starboard", "port"))
        super().__init__(ship, **values)
        self.sign, self.follow = (1.0 if side == "starboard" else -1.0), follow

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """Suction and the moment off the bank."""
        p = self.ship.particulars
        near = self.sign * 0.5 * p.beam / self._distance(s)
        scale = self.value("strength") * p.rho * p.beam * p.draught * s.u * s.u.abs() * near
        return columns(0.0 * scale, SUCTION * scale, -self.value("cn") * CUSHION * p.length * scale)

    def _distance(self, s: Situation) -> Tensor:
        """Distance of midship from the bank [m], never less than half a beam."""
        away = self.value("distance_m") + 0.0 * s.x
        if not self.follow:
            north, east = compass(self.value("along_deg"))
            away = away - self.sign * (north * s.y - east * s.x)
        half = 0.5 * self.ship.particulars.beam
        return half + nn.functional.softplus(away - half, beta=0.5)
