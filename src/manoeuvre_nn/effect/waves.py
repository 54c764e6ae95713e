"""Waves: a mean force that pushes the ship away, and the motion that the instruments see."""

from collections.abc import Mapping
from math import pi, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.effect.common import columns, compass, direction
from manoeuvre_nn.effect.sensors import add

HEIGHT = Parameter("Hs", "m", 0.0, 20.0, 0.0, 2.5, (1.5, 5.0))


class WaveDrift(Effect):
    """Mean second-order forces of a sea.

    With ``q = rho g L Hs^2 / 16`` and a the direction the waves come from, off the bow to starboard:
    ``X = -.08 q cos a``, ``Y = -.35 q sin a |sin a|``, ``N = -.03 q L sin 2a``. They do not depend on the speed.
    """

    name = "wave_drift"
    site = "force"
    candidate = True
    acts_indoors = False
    measured_by = "the wind and the waves"
    family = "wind and waves"
    label = "wave drift forces"
    equations = ("X", "Y", "N")
    fingerprint = "Forces turn with the compass like wind but do not depend on speed; turning circles drift down wave."
    source = "Short-wave limit rho g L Hs^2 / 16 (Faltinsen et al. 1980) with round coefficients of merchant ships"
    declared = (HEIGHT, direction("from_deg"))

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """Mean force of the waves."""
        p = self.ship.particulars
        scale = p.rho * GRAVITY * p.length / 16.0 * self.value("Hs").square()
        angle = self.angle("from_deg") - s.psi
        sin = torch.sin(angle)
        yaw = -0.03 * p.length * torch.sin(2 * angle)
        return columns(-0.08 * scale * torch.cos(angle), -0.35 * scale * sin * sin.abs(), scale * yaw)


class FirstOrderWaves(Effect):
    """Motion at wave frequency on top of the manoeuvre: zero mean, seen by every instrument, of no effect on the path.

    A long-crested sea of equal-energy components of Bretschneider's spectrum with seeded phases. The ship is taken to
    move with the mean of the water over its length (``X = k L cos(m) / 2``, m the angle off the bow)::

        surge = a cos(m) j0(X)    sway = a sin(m) j0(X)    yaw = a k sin(m) cos(m) 3 j1(X) / X

    so that short waves average out. Velocities are the rates of these at the frequency of encounter, which follows from
    the components being fixed in earth axes.
    """

    name = "first_order_waves"
    fittable = False
    acts_indoors = False
    measured_by = "the wind and the waves"
    site = "sensor"
    family = "wind and waves"
    label = "wave-frequency motion"
    equations = ("sensor:psi", "sensor:r", "sensor:vn", "sensor:ve", "sensor:u_log", "sensor:x", "sensor:y")
    fingerprint = "Oscillation of 4 to 20 s in yaw rate, heading and velocity with zero mean and no trace in the track."
    source = "Bretschneider 1959 spectrum; long-wave limit of the response averaged over the length, own derivation"
    declared = (HEIGHT, Parameter("period_s", "s", 4.0, 20.0, None, 4.0, (9.0,), power=0.5), direction("from_deg"))

    phases: Tensor
    ratios: Tensor

    def __init__(self, ship: Ship, seed: int = 0, components: int = 15, **values: Endless) -> None:
        """Draw the phases.

        Args:
            ship: The ship that it acts on.
            seed: Number of the realisation.
            components: How many regular waves make the sea.
            values: Parameter = value in its unit.
        """
        super().__init__(ship, **values)
        draw = torch.rand(components, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        energy = (torch.arange(components, dtype=torch.float64) + 0.5) / components
        self.register_buffer("phases", self.values.new_tensor((2 * pi * draw).tolist()), persistent=False)
        # Frequency over peak frequency below which a share of the energy lies: exp(-1.25 (wp/w)^4) = share.
        self.register_buffer("ratios", self.values.new_tensor((1.25 / -energy.log()).pow(0.25).tolist()))

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Add the motion to what the recorder writes."""
        (surge, sway, yaw), (du, dv, dr) = self._motion(s)
        added = {"psi": yaw, "r": dr, "u_log": du}
        added |= dict(zip("xy", body_to_earth(surge, sway, s.psi), strict=True))
        added |= dict(zip(("vn", "ve"), body_to_earth(du, dv, s.psi), strict=True))
        return add(channels, **added)

    def _motion(self, s: Situation) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
        """Surge, sway [m], yaw [rad] and their rates."""
        omega = 2 * pi / self.value("period_s")[..., None] * self.ratios
        number = omega.square() / GRAVITY
        north, east = (-c[..., None] for c in compass(self.value("from_deg")))  # where the waves run to
        cos, sin = earth_to_body(north, east, s.psi[..., None])  # of the angle off the bow
        along = north * s.x[..., None] + east * s.y[..., None]
        encounter = omega - number * (cos * s.u[..., None] + sin * s.v[..., None])
        phase = omega * s.time[..., None] - number * along + self.phases
        half = 0.5 * number * self.ship.particulars.length * cos
        mean, slope = _mean(half), _mean_slope(half)
        amplitude = self.value("Hs")[..., None] * sqrt(2.0 / len(self.phases)) / 4.0
        sizes = [amplitude * cos * mean, amplitude * sin * mean, amplitude * number * sin * cos * slope]
        # Water runs with the wave under a crest, a w cos(phase): moved by a sin(phase), turned by its slope along x.
        swing = (torch.sin(phase), torch.sin(phase), -torch.cos(phase))
        rate = (torch.cos(phase), torch.cos(phase), torch.sin(phase))
        moved = tuple((a * w).sum(-1) for a, w in zip(sizes, swing, strict=True))
        moving = tuple((a * w * encounter).sum(-1) for a, w in zip(sizes, rate, strict=True))
        return moved, moving


def _mean(half: Tensor) -> Tensor:
    """Mean of a wave over the length, sin X / X."""
    return torch.sinc(half / pi)


def _mean_slope(half: Tensor) -> Tensor:
    """Mean slope of a wave over the length, weighted as in a moment: 3 (sin X - X cos X) / X^3."""
    far = half.abs() > 0.05
    x = torch.where(far, half, 1.0)
    return torch.where(far, 3 * (torch.sin(x) - x * torch.cos(x)) / x**3, 1 - half.square() / 10)
