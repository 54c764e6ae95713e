"""Forces that a recursive network sees instead of rudder angles and shaft speeds, each a module that stands alone.

All are non-dimensional: lengths over L, speeds over the approach speed U0, rates times L/U0, forces over
``.5 rho L^2 U0^2``, moments over ``.5 rho L^3 U0^2``. Their constants are rough, as in the source: a network learns
what is a matter of size, so that the *shape* of a force counts. A last dimension of 2 is starboard, port.

Equations 4-25 of the source are lost in the scan; what stands here is rebuilt from its words and from the works that it
names, see each module.

Source:
    Hess & Faller 2000, "Simulation of ship maneuvers using recursive neural networks", 23rd Symp. Naval Hydrodynamics.
"""

from dataclasses import dataclass
from math import pi

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import WindAreas
from manoeuvre_nn.core.units import SEA_WATER
from manoeuvre_nn.core.wind import wind_load

MIN_INFLOW = 1e-6
"""Square of the smallest speed behind a propeller [U0^2]: one that brakes does not turn the water back."""


@dataclass(frozen=True)
class ForceConstants:
    """Numbers of a ship that the forces need; lengths over L, areas over L^2, volumes over L^3.

    Attributes:
        thrust: c1 and c2 of ``K_T = c1 + c2 J`` [-].
        wake: Wake fraction w [-].
        deduction: Thrust deduction t [-].
        diameter: Diameter of one propeller.
        rudder_area: Area of one rudder.
        rudder_aspect: Its height squared over its area [-].
        rudder_position: Its distance forward of midship; negative.
        volume: Displaced volume.
        gm: Metacentric height.
        gm_pitch: The same about the transverse axis.
        wind_areas: What the wind blows on; None for a ship without wind.
        wind_coefficients: CD_t, CD_lAF from ahead and astern, d, see :func:`.wind_load` [-].
        water: Density of the water [kg/m^3].
    """

    thrust: tuple[float, float]
    wake: float
    deduction: float
    diameter: float
    rudder_area: float
    rudder_aspect: float
    rudder_position: float
    volume: float
    gm: float
    gm_pitch: float = 1.0
    wind_areas: WindAreas | None = None
    wind_coefficients: tuple[float, float, float, float] = (0.85, 0.65, 0.55, 0.40)
    water: float = SEA_WATER

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If a size is not positive, or a fraction is not from 0 to below 1.
        """
        for name in ("diameter", "rudder_area", "rudder_aspect", "volume"):
            if not getattr(self, name) > 0:
                raise InputError(f"forces.{name}={getattr(self, name)}: expected a number more than 0")
        for name in ("wake", "deduction"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"forces.{name}={getattr(self, name)}: expected a fraction from 0 to below 1")


class PropellerThrust(nn.Module):
    """Thrust of a propeller behind a hull, from a straight line for the thrust coefficient.

    ``T = (1 - t) rho n^2 D^4 (c1 + c2 J)``, ``J = (1 - w) U / (n D)``; with a shaft that turns astern the sign of the
    first term turns.

    Source:
        Hess & Faller 2000, eqs 5-8; c1 = .600, c2 = -.400 are those of its ship 1 (Table 3).
    """

    def __init__(self, constants: ForceConstants) -> None:
        """Take the constants."""
        super().__init__()
        c, (c1, c2) = constants, constants.thrust
        size = 2 * (1 - c.deduction) * c.diameter**3
        self.at_rest, self.by_advance = size * c.diameter * c1, size * c2

    def forward(self, n: Float[Tensor, "*batch 2"], advance: Float[Tensor, "*#batch 1"]) -> Float[Tensor, "*batch 2"]:
        """Thrust.

        Args:
            n: Shaft speeds, n L/U0.
            advance: Speed of advance, (1 - w) U.

        Returns:
            Thrust of each side.
        """
        return n.abs() * (self.at_rest * n + self.by_advance * advance)


class PropellerRace(nn.Module):
    """Water behind a propeller, by momentum theory, and the force of a rudder that turns it.

    Far behind a propeller of thrust T and thrust loading ``C_T = T / (.5 rho U_A^2 pi D^2/4)`` the water moves at
    ``V = U_A sqrt(1 + C_T)``. Its momentum beyond that of the undisturbed stream is ``T (1 + 1/sqrt(1 + C_T))``; a
    rudder at angle delta turns it, which costs ``1 - cos delta`` of it as thrust and gives ``sin delta`` of it as lift.

    Source:
        Soeding 1998, 22nd Symp. Naval Hydrodynamics (Hess & Faller 2000, eqs 9, 10 and 15).

    Range of validity:
        The rudder is higher than the slipstream and turns all of it; propellers that drive ahead.
    """

    def __init__(self, constants: ForceConstants) -> None:
        """Take the constants."""
        super().__init__()
        self.per_thrust = 4 / (pi * constants.diameter**2)

    def speed(
        self, thrust: Float[Tensor, "*batch 2"], advance: Float[Tensor, "*#batch 1"]
    ) -> Float[Tensor, "*batch 2"]:
        """Speed of the slipstream, ``sqrt(U_A^2 + T / (.5 rho pi D^2/4))``."""
        return torch.addcmul(self.per_thrust * thrust, advance, advance).clamp(min=MIN_INFLOW).sqrt()

    def forward(
        self,
        thrust: Float[Tensor, "*batch 2"],
        advance: Float[Tensor, "*#batch 1"],
        delta: Float[Tensor, "*batch 2"],
        speed: Float[Tensor, "*batch 2"] | None = None,
    ) -> tuple[Float[Tensor, "*batch 2"], Float[Tensor, "*batch 2"]]:
        """What a rudder makes of the slipstream.

        Args:
            thrust: Thrust of each propeller.
            advance: Speed of advance, (1 - w) U.
            delta: Rudder angles [rad].
            speed: That of the slipstream, where it is known already.

        Returns:
            Loss of thrust and additional lift, positive where it turns the ship to starboard.
        """
        speed = self.speed(thrust, advance) if speed is None else speed
        momentum = thrust * (1 + advance / speed)
        return momentum - momentum * delta.cos(), momentum * delta.sin()


class RudderLift(nn.Module):
    """Lift of a rudder in the wake, at the angle at which the water meets it.

    ``L = .5 rho A U_A^2 C_L``, ``C_L = 2 pi Lambda (Lambda + .7) / (Lambda + 1.7)^2 sin a``,
    ``a = delta + atan((v + x_R r) / V)``, with the aspect ratio Lambda, x_R < 0, and V the speed in the slipstream.

    Source:
        Hess & Faller 2000, eqs 11-14 and 17, after Soeding 1998. There a minus stands before the arctangent and the
        distance L_r is positive: rudder angles have the other sign. The speed of the lift's own stagnation pressure is
        not said; here it is that of the wake, since what the propeller adds is added apart (eqs 15, 16).

    Range of validity:
        Below stall.
    """

    def __init__(self, constants: ForceConstants) -> None:
        """Take the constants."""
        super().__init__()
        aspect = constants.rudder_aspect
        slope = 2 * pi * aspect * (aspect + 0.7) / (aspect + 1.7) ** 2
        self.slope = constants.rudder_area * slope
        self.position = constants.rudder_position

    def angle(
        self,
        delta: Float[Tensor, "*batch 2"],
        v: Float[Tensor, "*#batch 1"],
        r: Float[Tensor, "*#batch 1"],
        slipstream: Float[Tensor, "*batch 2"],
    ) -> Float[Tensor, "*batch 2"]:
        """Angle of attack [rad]."""
        across = torch.add(v, r, alpha=self.position)
        return delta + torch.atan2(across, slipstream)

    def forward(
        self, angle: Float[Tensor, "*batch 2"], advance: Float[Tensor, "*#batch 1"]
    ) -> Float[Tensor, "*batch 2"]:
        """Lift without what the slipstream adds.

        Args:
            angle: Angle of attack [rad].
            advance: Speed of advance, (1 - w) U.

        Returns:
            Lift of each rudder, positive where it turns the ship to starboard.
        """
        return self.slope * advance.square() * angle.sin()


class RightingMoment(nn.Module):
    """Moment that rights a ship that heels or trims.

    ``K = rho g V GM sin phi``, and the same with theta and the longitudinal metacentric height. Over
    ``.5 rho L^3 U0^2`` it is ``2 V' GM' sin phi / Fn^2``.

    Source:
        Hess & Faller 2000, eqs 18-20.
    """

    def __init__(self, volume: float, gm: float) -> None:
        """Take displaced volume over L^3 and metacentric height over L."""
        super().__init__()
        self.size = 2 * volume * gm

    def forward(self, angle: Float[Tensor, "*batch"], froude: Float[Tensor, "*#batch"]) -> Float[Tensor, "*batch"]:
        """Moment.

        Args:
            angle: phi or theta [rad].
            froude: ``U0^2 / (g L)``, the square of Froude's number at the approach speed [-].

        Returns:
            What rights the ship, positive for a positive angle.
        """
        return self.size * angle.sin() / froude


class MunkMoment(nn.Module):
    """Moment of the ideal flow about a hull that drifts.

    ``N = .5 rho V U^2 sin 2 beta``, ``sin beta = -v/U``, of which ``-rho V u v`` is left.

    Source:
        Hess & Faller 2000, eqs 23-25, after Munk 1920; the volumes of the added masses are taken as 0 and V.
    """

    def __init__(self, volume: float) -> None:
        """Take the displaced volume over L^3."""
        super().__init__()
        self.size = -2 * volume

    def forward(self, u: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        """Moment, positive to starboard.

        Args:
            u: Speed ahead.
            v: Speed to starboard.

        Returns:
            N.
        """
        return self.size * u * v


class WindForce(nn.Module):
    """Force and moment of a recorded true wind, beyond those of still air, which the hull's resistance contains.

    Its moment about the x axis is no input of its own: it is Y times a height.

    Source:
        :func:`.wind_load`. Hess & Faller 2000 name it as the next step and have none.
    """

    def __init__(self, areas: WindAreas, coefficients: tuple[float, float, float, float], water: float) -> None:
        """Take what the wind blows on, lengths over L, and the density of the water [kg/m^3]."""
        super().__init__()
        self.areas, self.coefficients, self.size = areas, coefficients, 2 / water

    def forward(
        self,
        u: Float[Tensor, "*batch"],
        v: Float[Tensor, "*batch"],
        psi: Float[Tensor, "*batch"],
        air: Float[Tensor, "*batch 2"],
    ) -> Float[Tensor, "*batch 3"]:
        """Force.

        Args:
            u: Speed ahead.
            v: Speed to starboard.
            psi: Heading [rad].
            air: Velocity of the air over ground, north and east.

        Returns:
            X, Y, N.
        """
        ahead, across = earth_to_body(air[..., 0], air[..., 1], psi)
        return self.size * (self._load(u - ahead, v - across) - self._load(u, v))

    def _load(self, ahead: Tensor, across: Tensor) -> Tensor:
        """X, Y, N of a ship that moves through the air, over rho L^2 and rho L^3."""
        surge, sway, arm = wind_load(self.areas, self.coefficients, ahead, across)
        return torch.stack([surge, sway, sway * arm * self.areas.length_overall], dim=-1)


class BasicForces(nn.Module):
    """All forces that a recursive network takes of one step, in the order of its columns.

    Attributes:
        constants: Numbers of the ship.
    """

    def __init__(self, constants: ForceConstants, *, rolls: bool, pitches: bool = False, wind: bool = False) -> None:
        """Put the modules together.

        Args:
            constants: Numbers of the ship.
            rolls: Whether the moment that rights a heeling ship is among the forces.
            pitches: The same for trim.
            wind: Whether the force of the wind is.
        """
        super().__init__()
        self.constants = constants
        self.thrust, self.slipstream = PropellerThrust(constants), PropellerRace(constants)
        self.lift, self.munk = RudderLift(constants), MunkMoment(constants.volume)
        heights = [constants.gm] * rolls + [constants.gm_pitch] * pitches
        self.righting = nn.ModuleList(RightingMoment(constants.volume, gm) for gm in heights)
        self.wind: WindForce | None = None
        if wind:
            assert constants.wind_areas is not None
            self.wind = WindForce(constants.wind_areas, constants.wind_coefficients, constants.water)

    def forward(
        self,
        velocities: Float[Tensor, "*batch freedom"],
        angles: Float[Tensor, "*batch angles"],
        controls: Float[Tensor, "*batch _"],
        froude: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*batch columns"]:
        """Forces at a state.

        Args:
            velocities: u, v, ..., r.
            angles: phi, theta, as far as the network has them, psi [rad].
            controls: Rudder angles of both sides [rad], shaft speeds of both sides; for the wind, the velocity of the
                air over ground, north and east.
            froude: ``U0^2 / (g L)`` [-].

        Returns:
            Thrust of both sides, lift of both sides, K, M as far as they are asked for, N; X, Y, N of the wind.
        """
        u, v, r = velocities[..., :1], velocities[..., 1:2], velocities[..., -1:]
        delta, n = controls[..., :2], controls[..., 2:4]
        advance = (1 - self.constants.wake) * torch.linalg.vector_norm(velocities[..., :2], dim=-1, keepdim=True)
        thrust = self.thrust(n, advance)
        behind = self.slipstream.speed(thrust, advance)
        loss, more = self.slipstream(thrust, advance, delta, behind)
        lift = self.lift(self.lift.angle(delta, v, r, behind), advance) + more
        moments = [right(angles[..., k], froude)[..., None] for k, right in enumerate(self.righting)]
        wind = [] if self.wind is None else [self.wind(u[..., 0], v[..., 0], angles[..., -1], controls[..., 4:])]
        return torch.cat([thrust - loss, lift, *moments, self.munk(u, v), *wind], dim=-1)
