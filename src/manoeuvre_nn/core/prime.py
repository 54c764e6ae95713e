"""Prime systems: which length, speed and mass make a ship's equations non-dimensional."""

from dataclasses import dataclass
from math import sqrt

from manoeuvre_nn.core.units import GRAVITY, SEA_WATER


@dataclass(frozen=True)
class PrimeSystem:
    """A consistent set of three units; every other unit follows from them.

    Velocities are divided by ``speed``, yaw rates by ``speed / length``, accelerations by ``speed^2 / length``, yaw
    accelerations by ``speed^2 / length^2``, forces by ``mass speed^2 / length``, moments by ``mass speed^2``.

    Attributes:
        name: What the literature calls it.
        length: Unit of length [m].
        speed: Unit of speed [m/s].
        mass: Unit of mass [kg].
    """

    name: str
    length: float
    speed: float
    mass: float

    @property
    def force(self) -> float:
        """Unit of force [N]."""
        return self.mass * self.speed**2 / self.length

    @property
    def moment(self) -> float:
        """Unit of moment [N m]."""
        return self.mass * self.speed**2

    @property
    def velocity_units(self) -> tuple[float, float, float]:
        """Units of u, v [m/s] and r [rad/s]."""
        return self.speed, self.speed, self.speed / self.length

    @property
    def acceleration_units(self) -> tuple[float, float, float]:
        """Units of udot, vdot [m/s^2] and rdot [rad/s^2]."""
        linear = self.speed**2 / self.length
        return linear, linear, linear / self.length


def length_system(length: float, speed: float, rho: float = SEA_WATER) -> PrimeSystem:
    """The (rho, L, U) system of SNAME 1950: forces over ``0.5 rho L^2 U^2``, moments over ``0.5 rho L^3 U^2``.

    Args:
        length: Length between perpendiculars L [m].
        speed: Speed U [m/s].
        rho: Density of the water [kg/m^3].

    Returns:
        The system.

    Source:
        SNAME 1950, Technical and Research Bulletin 1-5.
    """
    return PrimeSystem("rho, L, U", length, speed, 0.5 * rho * length**3)


def bis_system(length: float, mass: float) -> PrimeSystem:
    """The BIS system: speeds over ``sqrt(g L)``, forces over ``m g``, moments over ``m g L``.

    Args:
        length: Length between perpendiculars L [m].
        mass: Mass of the ship m [kg].

    Returns:
        The system.

    Source:
        Norrbin 1970; Rajesh & Bhattacharyya 2009, eq 9.
    """
    return PrimeSystem("BIS", length, sqrt(GRAVITY * length), mass)
