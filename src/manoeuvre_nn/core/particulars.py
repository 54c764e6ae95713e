"""Main dimensions and steering gear of a ship, and what the wind blows on and she heels by, estimated if need be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.prime import PrimeSystem
from manoeuvre_nn.core.units import KNOT, SEA_WATER

LONGEST_MODEL = 20.0
"""Shorter ones are models in a tank or on a pond [m]."""
FULL_SCALE = 160.0
"""Length of a ship that usual sizes of winds, currents, forces and sensors' errors at sea hold for [m]."""


@dataclass(frozen=True)
class WindAreas:
    """What the wind blows on.

    Attributes:
        frontal: Projected frontal area A_F [m^2].
        lateral: Projected lateral area A_L [m^2].
        lateral_centre: Centroid of the lateral area forward of midship s_L [m].
        length_overall: Length over all [m].
    """

    frontal: float
    lateral: float
    lateral_centre: float
    length_overall: float


@dataclass(frozen=True)
class Stability:
    """What a ship heels by.

    Attributes:
        gm: Metacentric height GM [m].
        kg: Centre of gravity above the keel KG [m].
        roll_period: Natural period of roll [s].
        roll_damping: Damping ratio of roll [-].
    """

    gm: float
    kg: float
    roll_period: float
    roll_damping: float = 0.08


@dataclass(frozen=True)
class Particulars:
    """A ship's main dimensions and steering gear.

    Attributes:
        name: The ship's name.
        length: Length between perpendiculars L [m].
        beam: Beam B [m].
        draught: Draught T [m].
        block: Block coefficient C_B [-].
        speed: Approach speed U0 of the source [m/s].
        rudder_rate: Turning rate of the rudder [rad/s].
        rudder_limit: Largest rudder angle [rad].
        rudder_area_ratio: Rudder area over L T [-].
        surge_damping: X_u in the (rho, L, T, U0) system that Clarke's linear part is completed with [-].
        rudder_drag: X_dd likewise [-]; None takes ``-2 Yd``.
        record_length: How long the zigzag record is that the source identifies the ship from [s].
        sample_interval: Time between samples that resolves the ship's motion [s].
        longest_turn: Time after which a hard turn of this coefficient set leaves the range where it makes sense [s].
        service_speed: Speed that the ship may reach, whatever it approaches at [m/s]; None is U0.
        rho: Density of the water [kg/m^3].
        displacement: Mass of the ship [kg]; None takes rho C_B L B T.
        resistance: Calm-water resistance R0 at U0 [N]; None estimates it.
        thrust_slope: Loss of thrust with speed s: at constant rpm thrust is ``R0 [1 + s (1 - u/U0)]`` [-].
        rpm: Nominal shaft speed [rpm].
        wind_areas: What the wind blows on; None estimates it.
        stability: What the ship heels by; None estimates it.
        source: Author, year, table.
    """

    name: str
    length: float
    beam: float
    draught: float
    block: float
    speed: float
    rudder_rate: float
    rudder_limit: float
    rudder_area_ratio: float = 0.02
    surge_damping: float = -0.025
    rudder_drag: float | None = None
    record_length: float = 360.0
    sample_interval: float = 1.0
    longest_turn: float = inf
    service_speed: float | None = None
    rho: float = SEA_WATER
    displacement: float | None = None
    resistance: float | None = None
    thrust_slope: float = 1.0
    rpm: float = 80.0
    wind_areas: WindAreas | None = None
    stability: Stability | None = None
    source: str = ""

    def __post_init__(self) -> None:
        """Refuse dimensions that no ship has.

        Raises:
            InputError: If a dimension is not positive, or length, beam and draught are not in that order.
        """
        for key, value in vars(self).items():
            free = key in {"surge_damping", "rudder_drag", "thrust_slope"} or not isinstance(value, int | float)
            if not free and (not value > 0 or (value == inf and key != "longest_turn")):
                raise InputError(f"ship {self.name}: {key} is {value}; it must be positive")
        if not self.length > self.beam > self.draught or self.block > 1:
            raise InputError(
                f"ship {self.name}: length {self.length}, beam {self.beam}, draught {self.draught} m, block "
                f"{self.block}; expected length > beam > draught and block <= 1"
            )

    @property
    def particulars(self) -> "Particulars":
        """Itself: of many ships no more is known, and who wants particulars alone need not ask."""
        return self

    def sized(
        self, values: Sequence[float] | Float[np.ndarray, " k"], powers: Sequence[float]
    ) -> Float[np.ndarray, " k"]:
        """Usual sizes of things at sea for this ship.

        Those of ships stay as they are; models have those of a ship of ``FULL_SCALE`` by Froude's law.

        Args:
            values: Sizes that are usual on ships.
            powers: Exponents of length: 1 for lengths, .5 for speeds and times, -.5 for rates, 3 for forces.

        Returns:
            Sizes in the same units.
        """
        share = self.length / FULL_SCALE if self.is_model else 1.0
        return np.asarray(values) * share ** np.asarray(powers)

    @property
    def prime(self) -> PrimeSystem:
        """The (rho, L, T, U0) system: forces over ``0.5 rho L T U0^2``, moments over ``0.5 rho L^2 T U0^2``.

        Source:
            Wang 1996, eqs 4.24-4.29.
        """
        return PrimeSystem("rho, L, T, U0", self.length, self.speed, 0.5 * self.rho * self.length**2 * self.draught)

    @property
    def is_model(self) -> bool:
        """Whether it is a model in a tank or on a pond."""
        return self.length < LONGEST_MODEL

    def at_speed(self, speed: float) -> "Particulars":
        """The same ship on another approach speed; resistance goes with its square.

        Args:
            speed: Approach speed [m/s].

        Returns:
            The ship.

        Raises:
            InputError: If the speed is not positive or more than twice the ship's own (knots taken for m/s).
        """
        if not 0 < speed <= 2 * self.speed:
            raise InputError(
                f"approach speed {speed / KNOT:.4g} kn; the {self.name} was identified at {self.speed / KNOT:.4g} kn: "
                f"write manoeuvre.speed_kn between 0 and {2 * self.speed / KNOT:.3g}"
            )
        resistance = None if self.resistance is None else self.resistance * (speed / self.speed) ** 2
        return replace(self, speed=speed, service_speed=self.top_speed, resistance=resistance)

    @property
    def top_speed(self) -> float:
        """The larger of approach and service speed [m/s]: a slow ship with its shaft at full speed gathers way."""
        return max(self.speed, self.service_speed or self.speed)

    @property
    def time_unit(self) -> float:
        """Time in which the ship sails its own length, L / U0 [s]."""
        return self.length / self.speed

    @property
    def mass(self) -> float:
        """Displacement, rho C_B L B T if the source does not state it [kg]."""
        return self.displacement or self.rho * self.block * self.length * self.beam * self.draught

    @property
    def calm_resistance(self) -> float:
        """Resistance at U0 [N]; where the source is silent, ``C_T = .003`` on Mumford's wetted surface."""
        surface = 1.7 * self.length * self.draught + self.mass / (self.rho * self.draught)
        return self.resistance or 0.5 * self.rho * 0.003 * surface * self.speed**2

    @property
    def above_water(self) -> WindAreas:
        """What the wind blows on; where the source is silent, a superstructure aft and a freeboard of .04 L."""
        silhouette = self.length * 0.04 * self.length + 0.012 * self.length**2
        return self.wind_areas or WindAreas(0.8 * self.beam**2, silhouette, -0.05 * self.length, 1.03 * self.length)

    @property
    def heeling(self) -> Stability:
        """What the ship heels by; where the source is silent, GM = .04 B, KG = .8 of .7 B and Weiss' period."""
        gm = 0.04 * self.beam
        return self.stability or Stability(gm, 0.56 * self.beam, 0.8 * self.beam / sqrt(gm))
