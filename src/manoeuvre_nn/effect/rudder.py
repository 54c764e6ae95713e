"""Rudders that are not where the indicator says, or do not do what they should there.

Angles are positive to starboard, as everywhere in the package.
"""

from abc import ABC
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE


class RudderEffect(Effect, ABC):
    """A fault of the rudder or of its gear."""

    site = "actuator"
    family = "rudder"
    measured_by = "the angle of the rudder stock"
    equations: ClassVar[tuple[str, ...]] = ("actuator:rudder",)


class RudderOffset(RudderEffect):
    """A blade that stands beside the indicated angle: blade minus indicator, positive to starboard."""

    name = "rudder_offset"
    candidate = True
    label = "a rudder offset"
    fingerprint = "The ship turns one way with the rudder shown amidships, on every heading, more at higher speed."
    source = "delta = shown + offset"
    declared = (Parameter("offset_deg", "deg", -5.0, 5.0, 0.0, 1.5, (1.0, -1.0)),)

    def blade(
        self,
        before: Float[Tensor, "*#batch"],
        order: Float[Tensor, "*#batch"],
        shown: Float[Tensor, "*#batch"],
        elapsed: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*#batch"]:
        """The indicated angle and the offset.

        Args:
            before: Not used.
            order: Not used.
            shown: Indicated angle [rad].
            elapsed: Not used.

        Returns:
            Blade angle [rad].
        """
        del before, order, elapsed
        return shown + self.angle("offset_deg")


class RudderBacklash(RudderEffect):
    """Play between indicator and blade: the blade moves only where the indicator pushes it (play operator)."""

    name = "rudder_backlash"
    candidate = True
    label = "backlash of the rudder"
    fingerprint = "After a reversal the ship answers as if the rudder waited; order and turn make a hysteresis loop."
    source = "Play operator of total width w: blade = clamp(before, shown - w/2, shown + w/2)"
    declared = (Parameter("width_deg", "deg", 0.0, 6.0, 0.0, 1.5, (1.5,)),)

    def blade(
        self,
        before: Float[Tensor, "*#batch"],
        order: Float[Tensor, "*#batch"],
        shown: Float[Tensor, "*#batch"],
        elapsed: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*#batch"]:
        """The angle before, pushed to within half the play of the indicated one.

        Args:
            before: Blade angle at the start [rad].
            order: Not used.
            shown: Indicated angle, without reversal in between [rad].
            elapsed: Not used.

        Returns:
            Blade angle [rad].
        """
        del order, elapsed
        half = 0.5 * self.angle("width_deg")
        return torch.minimum(torch.maximum(before, shown - half), shown + half)


class RudderSlow(RudderEffect):
    """A blade that follows the order at a rate of its own, whatever the indicator does."""

    name = "rudder_slow"
    candidate = True
    label = "a slow rudder"
    fingerprint = "Disagreement while the rudder is moving, the larger the change of angle; none once it rests."
    source = "Rate limit between order and blade"
    declared: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_deg_s", "deg/s", 0.1, 10.0, 2.5, 1.5, (1.2,)),)

    def __init__(self, ship: Ship, **values: float) -> None:
        """Take the nominal rate, at which nothing is wrong, from the ship.

        Args:
            ship: The ship that it acts on.
            values: Parameter = value in its unit.
        """
        nominal = ship.particulars.rudder_rate / DEGREE
        rate = Parameter("rate_deg_s", "deg/s", 0.05 * nominal, nominal, nominal, 0.6 * nominal, (0.5 * nominal,))
        self.declared = (rate,)  # type: ignore[misc] # the null is the ship's
        super().__init__(ship, **values)

    def blade(
        self,
        before: Float[Tensor, "*#batch"],
        order: Float[Tensor, "*#batch"],
        shown: Float[Tensor, "*#batch"],
        elapsed: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*#batch"]:
        """The angle before, moved towards the order; exact while the order is constant.

        Args:
            before: Blade angle at the start [rad].
            order: Helm order [rad].
            shown: Not used.
            elapsed: The time [s].

        Returns:
            Blade angle [rad].
        """
        del shown
        reach = self.angle("rate_deg_s") * elapsed
        return before + torch.minimum(torch.maximum(order - before, -reach), reach)


class RudderSaturation(RudderEffect):
    """A blade that stops before the indicator does."""

    name = "rudder_saturation"
    label = "a rudder that stops early"
    fingerprint = "Disagreement at large rudder angles only, as if less had been ordered."
    source = "delta = clamp(shown, -limit, limit)"
    declared = (Parameter("limit_deg", "deg", 5.0, 45.0, 45.0, 10.0, (25.0, 15.0)),)

    def blade(
        self,
        before: Float[Tensor, "*#batch"],
        order: Float[Tensor, "*#batch"],
        shown: Float[Tensor, "*#batch"],
        elapsed: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*#batch"]:
        """The indicated angle as far as the stop.

        Args:
            before: Not used.
            order: Not used.
            shown: Indicated angle [rad].
            elapsed: Not used.

        Returns:
            Blade angle [rad].
        """
        del before, order, elapsed
        limit = self.angle("limit_deg")
        return torch.minimum(torch.maximum(shown, -limit), limit)
