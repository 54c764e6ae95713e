"""What no answer may name, to learn ``unknown`` from: effects of the shelf that are no candidates, and made-up forces.

Examples of what is outside the classes make a network doubt what it has not seen (Hendrycks et al. 2019). The forces
are products of two functions drawn from a short list; none is taken from the referee.
"""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.effect.bank import Bank
from manoeuvre_nn.effect.common import in_tight_turns, typical
from manoeuvre_nn.effect.local import Tow
from manoeuvre_nn.effect.rudder import RudderSaturation, RudderStall
from manoeuvre_nn.effect.sensors import GyroSpeedError, TimeSync, WrongFrame

KINDS = 10
"""Functions that forces are products of."""
COPIES = 5
"""Made-up forces for every effect of the shelf in :func:`others`."""


class DrawnForce(Effect):
    """A force in one equation that is a product of two functions of motion, rudder, heading or time."""

    name = "drawn_force"
    site = "force"
    family = "drawn force"
    label = "a made-up force"
    equations: ClassVar[tuple[str, ...]] = ("X", "Y", "N")
    fingerprint = "None: drawn at random."
    source = "None"
    declared: ClassVar[tuple[Parameter, ...]] = (
        Parameter("size", "-", -2.0, 2.0, 0.0, 0.3, (0.15, -0.15)),
        Parameter("equation", "-", 0.0, 3.0, None, 1.0, (0.0,), period=3.0),
        Parameter("first", "-", 0.0, float(KINDS), None, 1.0, (0.0,), period=float(KINDS)),
        Parameter("second", "-", 0.0, float(KINDS), None, 1.0, (0.0,), period=float(KINDS)),
        Parameter("time_s", "s", 0.0, 120.0, None, 40.0, (40.0,), period=120.0),
    )

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """The product, in the equation that was drawn."""
        z = in_tight_turns(self.ship, s)
        phase = 6.28 * s.time / (15.0 + self.value("time_s"))
        lap = (s.x - s.y) / self.ship.particulars.length
        one = torch.ones_like(z["u"])
        table = [one, z["u"], z["v"], z["r"], z["d"], z["r"].abs(), z["d"].clamp(min=0.0), torch.cos(3 * s.psi)]
        table += [torch.sin(phase), torch.sin(lap)]
        functions = torch.stack([f.expand(one.shape) for f in table], dim=-1)
        product = one
        for name in ("first", "second"):
            which = self.value(name).long().clamp(max=KINDS - 1).expand(one.shape)[..., None]
            product = product * functions.gather(-1, which)[..., 0]
        row = torch.nn.functional.one_hot(self.value("equation").long().clamp(max=2), 3)
        return (self.value("size") * product)[..., None] * row * typical(self.ship)


def others(ship: Ship) -> list[Effect]:
    """Effects that no answer may name.

    Args:
        ship: The ship.

    Returns:
        Prototypes; made-up forces stand several times.
    """
    kinds = (Bank, Tow, RudderSaturation, RudderStall, GyroSpeedError, TimeSync, WrongFrame)
    return [*(kind(ship) for kind in kinds), *(DrawnForce(ship) for _ in range(COPIES))]
