"""A ship that is heavier, lighter or otherwise trimmed than its coefficients say."""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Parameter, Situation
from manoeuvre_nn.effect.common import columns
from manoeuvre_nn.effect.series import HullEffect, diagonal

BY = ("by the stern", "by the bow")


class DisplacementChange(HullEffect):
    """A mass that is a multiple k of the nominal one.

    Mass, moment of inertia and the terms ``m v r`` and ``-m u r`` are multiplied by k, the hull's forces and added
    masses by ``k^e``: e is a form parameter, between 0 (none) and 2 (a slender body that draws k times as much).
    """

    name = "displacement_change"
    candidate = True
    measured_by = "the draughts"
    family = "loading"
    label = "another displacement"
    fingerprint = "A slower or quicker answer to the rudder on every heading, alike to both sides."
    source = "Mass terms exactly; hull forces by slender-body theory, between T^0 and T^2"
    declared: ClassVar[tuple[Parameter, ...]] = (
        Parameter("factor", "-", 0.25, 3.0, 1.0, 0.15, (1.1, 0.9, 1.5, 0.6)),
        Parameter("hull_exponent", "-", -0.5, 2.5, 1.0, 0.7, (1.0,), form=True),
    )

    def change(self, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*rows 3"]]:
        """What the mass changes."""
        mass, hull = self.value("factor")[..., None] - 1, self._of_hull()[..., None]
        force = self.force_of(s, mass[..., None] * self.series.of_mass + self.rescaled(*self.shares(s)))
        return force, mass * self.series.masses + hull * self.series.added

    def shares(self, s: Situation) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3 3"]]:
        """All of the hull alike."""
        hull = diagonal(*[self._of_hull()] * 3)
        return hull, hull

    def _of_hull(self) -> Tensor:
        """What is added to the hull's forces and added masses, over these."""
        return self.value("factor") ** self.value("hull_exponent") - 1


class Loading(HullEffect):
    """A draught that is a multiple k of the nominal one, sides being vertical.

    Mass goes with k, hull forces and added masses with ``k^2``, resistance with the wetted surface
    ``1.7 L T + volume / T``. Rudder and propeller are as they were.
    """

    name = "loading"
    measured_by = "the draughts"
    family = "loading"
    label = "another draught"
    fingerprint = "As another displacement, with another speed on straight courses."
    source = "Slender-body theory, forces as T^2; Mumford's wetted surface"
    declared = (Parameter("draught_ratio", "-", 0.2, 2.0, 1.0, 0.15, (1.1, 0.8, 0.5)),)

    def change(self, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*rows 3"]]:
        """What the draught changes."""
        p, ratio = self.ship.particulars, self.value("draught_ratio")
        side = 1.7 * p.length * p.draught
        wetter = (ratio - 1) * side / (side + p.mass / (p.rho * p.draught))
        speed = s.u / p.speed
        surge = -wetter * p.calm_resistance / self.ship.prime.force * speed * speed.abs()
        mass, hull = ratio[..., None] - 1, ratio[..., None].square() - 1
        force = self.force_of(s, mass[..., None] * self.series.of_mass + self.rescaled(*self.shares(s)))
        return force + columns(surge, 0 * surge, 0 * surge), mass * self.series.masses + hull * self.series.added

    def shares(self, s: Situation) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3 3"]]:
        """All of the hull alike."""
        hull = diagonal(*[self.value("draught_ratio").square() - 1] * 3)
        return hull, hull


class TrimChange(HullEffect):
    """Trim by the stern, which makes a ship steadier on its course.

    With ``t = trim / T``: ``Yv (1 + .67 t)``, ``Yr (1 + .80 t)``, ``Nv - .27 t Yv``, ``Nr (1 + .30 t)`` for the linear
    terms, those of mass excluded. Half of ships are taken to trim by less than .13 T; in ballast MARPOL (Annex I,
    regulation 18) allows a tanker .015 L by the stern, a fourth of T.
    """

    name = "trim_change"
    candidate = True
    measured_by = "the draughts"
    family = "loading"
    label = "another trim"
    equations: ClassVar[tuple[str, ...]] = ("Y", "N")
    fingerprint = "Course stability changes, overshoots most, alike to both sides; straight speed is as it should be."
    source = "Inoue, Hirano & Kijima 1981, numbers not checked against the print"
    declared = (Parameter("trim_m", "m", -1.0, 1.0, 0.0, 0.2, (0.1, -0.1, 0.4, -0.4), within="draught", sides=BY),)

    def change(self, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*rows 3"]]:
        """What the trim changes."""
        return self.force_of(s, self.rescaled(*self.shares(s))), torch.zeros_like(self.series.masses)

    def shares(self, s: Situation) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3 3"]]:
        """Nv gets a share of Yv."""
        trim = (self.value("trim_m") / self.ship.particulars.draught)[..., None, None]
        drift = [[0.0, 0.0, 0.0], [0.0, 0.67, -0.27], [0.0, 0.0, 0.0]]
        return trim * trim.new_tensor(drift), trim * torch.diag(trim.new_tensor([0.0, 0.80, 0.30]))

    def nonlinear(self) -> float:
        """The formula is for linear terms."""
        return 0.0
