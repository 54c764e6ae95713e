"""Shallow water: forces and added masses between keel and bottom."""

from abc import abstractmethod
from collections.abc import Mapping
from math import inf

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Parameter, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.effect.common import columns, factor
from manoeuvre_nn.effect.series import HullEffect, diagonal

# At T/h = .8 Lackenby 1963, Raven 2016 and the tanker add 63, 38 and 64 % to the resistance, waves alone nothing; the
# sources have factors of linear terms alone.
FORM = (
    factor("surge", 0.5),
    factor("sway", 0.3),
    factor("yaw", 0.3),
    factor("nonlinear", 0.5),
    Parameter("source", "-", -0.5, 1.5, 0.5, 0.35, (0.5,), form=True),
)
DEPTH = Parameter("depth_m", "m", 1.0, 1000.0, None, 10.0, (30.0,))
DEEP = 1000.0
"""Depth over draught at which no more than 1e-4 of the effect is left."""
RESISTANCE = 0.16
"""Added resistance over zeta [-]: Xuuz / Xuu of the BIS tanker."""


class _FiniteDepth(HullEffect):
    """Water of a given depth under a ship whose coefficients hold for deep water.

    With ``zeta = T / (h - T)``: ships whose set has terms in zeta use these (Xuuz, ..., inertia included), Yuvz with
    its kink at zeta = .8 rounded. For others the hull's terms and added masses are multiplied by factors, drift terms
    of sway and yaw by f_Yv and f_Nv, terms in r by f_Nr: those of Kijima (``source`` 0), of Ankudinov (1) or, as the
    two lie about 30 % of the change on either side of their mean, of something between. Nonlinear terms, which the
    sources say nothing of, change as these do, times ``nonlinear``. Resistance grows with .16 zeta. The other form
    parameters multiply the changes.

    The depth may be 1.03 to 50 draughts; deep water is no finite depth, so that the parameter has no null and
    :meth:`null` takes ``DEEP`` draughts.
    """

    measured_by = "the depth"
    family = "depth"

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Take the range of depths from the ship.

        Args:
            ship: The ship that it acts on, in deep water.
            values: Parameter = value in its unit.

        Raises:
            InputError: If the ship is in shallow water already, or its forces are no series.
        """
        if ship.depth < inf:
            raise InputError(f"effect.{self.name}: the ship is in shallow water already: write ship.depth=inf")
        draught = ship.particulars.draught
        starts = tuple(share * draught for share in (1.2, 1.5, 2.5, 5.0))
        depth = Parameter("depth_m", "m", 1.03 * draught, 50 * draught, None, draught, starts)
        self.declared = (depth, *(p.on(ship.particulars) for p in type(self).declared[1:]))  # type: ignore[misc] # the range is the ship's
        super().__init__(ship, **values)

    def null(self) -> Float[Tensor, " p"]:
        """Deep water."""
        values = super().null()
        values[0] = DEEP * self.ship.particulars.draught
        return values

    @abstractmethod
    def _immersion(self, s: Situation) -> Tensor:
        """Draught over depth [-]."""

    def change(self, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*rows 3"]]:
        """What the bottom changes."""
        immersion = self._immersion(s)
        own = self.ship.shallow_change(s.nu, s.delta, s.shaft, immersion / (1 - immersion))
        if own is None:
            return self._by_factors(s, immersion)
        force, inertia = own
        return self._form() * force, self._form() * inertia

    def _by_factors(self, s: Situation, immersion: Tensor) -> tuple[Tensor, Tensor]:
        """By factors on the ship's deep-water terms."""
        p, f = self.ship.particulars, self._factors(immersion)
        zeta, speed = immersion / (1 - immersion), s.u / p.speed
        resistance = RESISTANCE * zeta * p.calm_resistance / self.ship.prime.force * speed * speed.abs()
        slower = self._form() * columns(resistance, 0 * resistance, 0 * resistance)
        added = columns(f["Yvdot"] - 1, f["Yvdot"] - 1, f["Nrdot"] - 1) * self.series.added
        return self.force_of(s, self.rescaled(*self._shares_by(f))) - slower, self._form() * added

    def shares(self, s: Situation) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3 3"]]:
        """Factors less 1; nothing where terms in zeta of the ship's own add to those of deep water."""
        immersion = self._immersion(s)
        if self.ship.shallow_change(s.nu, s.delta, s.shaft, immersion / (1 - immersion)) is not None:
            none = diagonal(*[0 * immersion] * 3)
            return none, none
        return self._shares_by(self._factors(immersion))

    def _shares_by(self, f: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """What factors on the ship's deep-water terms add to them."""
        form = self._form()[..., None, :]
        drift = diagonal(0 * f["Yv"], f["Yv"] - 1, f["Nv"] - 1)
        return form * drift, form * diagonal(f["Yvdot"] - 1, f["Nr"] - 1, f["Nr"] - 1)

    def nonlinear(self) -> Float[Tensor, "*rows 1 1"]:
        """Of the nonlinear terms no source has a factor."""
        return self.value("nonlinear")[..., None, None]

    def _form(self) -> Float[Tensor, "*rows 3"]:
        """Factors on the changes of X, Y and N."""
        return columns(self.value("surge"), self.value("sway"), self.value("yaw"))

    def _factors(self, immersion: Tensor) -> dict[str, Tensor]:
        """Factors on deep-water derivatives."""
        return depth_factors(self.ship.particulars, immersion, self.value("source"))


def depth_factors(
    ship: Particulars, immersion: Float[Tensor, "*batch"], source: Float[Tensor, "*#batch"] | float = 0.5
) -> dict[str, Float[Tensor, "*batch"]]:
    """Factors on deep-water derivatives.

    Args:
        ship: Main dimensions.
        immersion: Draught over depth T/h [-].
        source: 0 takes Kijima's factors of Yv, Nv and Nr, 1 those of Ankudinov, values between their weighted mean.

    Returns:
        Factors of Yv, Nv, Nr (also for Yr), Yvdot (also for Xudot) and Nrdot.

    Source:
        Kijima et al. 1990 and Ankudinov et al. 1990 (Taimuri et al. 2020).
    """
    # With F = h/T - 1 and z = 1/F: k0 = 1 + .0775 z^2 - .011 z^3 + .000068 z^5,
    # k1 = w (-.0643 z + .0724 z^2 - .0113 z^3 + .0000767 z^5), k2 = .137 w^2 z / max(B/T, 4), by Horner's rule.
    left = 1 - immersion
    z = immersion / left
    square = z * z
    flat = ship.beam / ship.draught
    wide = ship.block * flat * (1 + ship.beam / ship.length) ** 2
    k0 = ((square * 0.000068 - 0.011) * z + 0.0775) * square + 1
    k1 = (((square * 0.0000767 - 0.0113) * z + 0.0724) * z - 0.0643) * z * wide
    k2 = z * (0.137 / max(flat, 4.0) * wide**2)
    turning = k0 + k1 / 2 + k2 / 3
    ankudinov = {"Yv": 1.5 * turning - 0.5, "Nv": k0 + k1 + k2, "Nr": turning}
    powers = {"Yv": 0.4 * ship.block * flat, "Nv": 0.425 * ship.block * flat}
    powers["Nr"] = 1.5 - 14.28 * ship.draught / ship.length
    kijima = {name: left**-q - immersion for name, q in powers.items()}
    mean = {name: kijima[name] + source * (ankudinov[name] - kijima[name]) for name in powers}
    return mean | {"Yvdot": k0 + k1 * 2 / 3 + k2 * 8 / 15, "Nrdot": k0 + k1 * 8 / 15 + k2 * 40 / 105}


class ShallowWater(_FiniteDepth):
    """Shallow water in which the ship keeps its draught."""

    name = "shallow_water"
    candidate = True
    label = "shallow water"
    fingerprint = "Wider turns with less drift and less loss of speed, to both sides and on every heading."
    source = (
        "Van Berlekom & Goddard 1972; Kijima et al. 1990, f = (1 - T/h)^-q - T/h; Ankudinov et al. 1990 as used by "
        "Taimuri et al. 2020; q of Nv and the factors of added masses not checked against the print, Yr taken as Nr"
    )
    declared = (DEPTH, *FORM)

    def _immersion(self, s: Situation) -> Tensor:
        """Draught over depth [-]."""
        draught = self.ship.particulars.draught
        return draught / self.value("depth_m").clamp(min=1.02 * draught)


class Squat(_FiniteDepth):
    """Shallow water in which the ship sinks in with its speed, so that the water under it becomes less still.

    Sinkage ``C_B S^.81 V_kn^2.08 / 20`` m with the blockage S of a channel ``7.04 B / C_B^.85`` wide; it is kept below
    half the clearance.
    """

    name = "squat"
    label = "shallow water and squat"
    fingerprint = "As in shallow water, and the more so the faster the ship is."
    source = "Barrass 1979 and 2004 for sinkage and width of influence; otherwise as shallow_water"
    declared = (DEPTH, *FORM, factor("sinkage", 0.3))

    def _immersion(self, s: Situation) -> Tensor:
        """Draught under way over depth [-]."""
        p = self.ship.particulars
        depth = self.value("depth_m").clamp(min=1.02 * p.draught)
        blockage = p.draught * p.block**0.85 / (7.04 * depth)
        knots = (s.u / KNOT).square() + 1e-9
        sinkage = self.value("sinkage") * p.block / 20 * blockage**0.81 * knots**1.04
        room = 0.5 * (depth - p.draught)
        return (p.draught + room * (1 - torch.exp(-sinkage / room))) / depth
