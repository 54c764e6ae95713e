"""The three ships of the trial: public coefficient sets, main dimensions, areas and stability, read from ships.json."""

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

RHO, GRAVITY = 1025.0, 9.81
"""Density of sea water [kg/m^3] and acceleration of gravity [m/s^2]."""


@dataclass(frozen=True)
class TrialShip:
    """A ship as the manifests describe it, with the coefficients of its calm-water model.

    Attributes:
        name: Name of the coefficient set.
        particulars: Main dimensions as in a manifest (units in the names).
        wind_areas: Projected areas as in a manifest.
        stability: GM, KG, roll period and damping as in a manifest.
        isherwood: Perimeter of the lateral projection [m], superstructure area [m^2] and number of masts.
        manoeuvres_s: How long each manoeuvre is recorded [s].
        model: Coefficients and what else the equations need.
    """

    name: str
    particulars: dict[str, float | int]
    wind_areas: dict[str, float | int]
    stability: dict[str, float | int]
    isherwood: dict[str, float | int]
    manoeuvres_s: dict[str, int]
    model: dict[str, Any]

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.particulars["length_m"]

    @property
    def beam(self) -> float:
        """Beam [m]."""
        return self.particulars["beam_m"]

    @property
    def draught(self) -> float:
        """Draught [m]."""
        return self.particulars["draft_m"]

    @property
    def speed(self) -> float:
        """Approach speed U0 [m/s]."""
        return self.particulars["approach_speed_m_s"]

    @property
    def rate(self) -> float:
        """Rate of the steering gear [rad/s]."""
        return float(np.radians(self.particulars["rudder_rate_deg_s"]))

    @property
    def rpm(self) -> float:
        """Nominal shaft speed [rpm]."""
        return self.particulars["nominal_rpm"]

    @property
    def resistance(self) -> float:
        """Calm-water resistance at approach speed [N]."""
        return 1e3 * self.particulars["calm_water_resistance_kN"]

    @property
    def force_unit(self) -> float:
        """0.5 rho L T U0^2 [N]."""
        return 0.5 * RHO * self.length * self.draught * self.speed**2

    @property
    def is_tanker(self) -> bool:
        """Whether the equations are those of the tanker."""
        return "volume" in self.model

    @property
    def mass_prime(self) -> float:
        """Mass over 0.5 rho L^2 T [-]."""
        return self.model["volume"] / (0.5 * self.length**2 * self.draught) if self.is_tanker else self.model["Delta"]


@cache
def trial_ships() -> dict[str, TrialShip]:
    """All ships of the trial.

    Returns:
        Name and ship.
    """
    table = json.loads(files("studies.concealed_trial").joinpath("ships.json").read_text())
    return {name: TrialShip(name, **row) for name, row in table.items()}
