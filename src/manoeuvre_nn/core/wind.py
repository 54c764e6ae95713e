"""Load of the wind on the part of a ship above the water."""

from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.particulars import Particulars, WindAreas

AIR = 1.225
"""Density of air [kg/m^3]."""
COEFFICIENTS = {
    "cargo_loaded": (0.85, 0.65, 0.55, 0.40),
    "container_loaded": (0.90, 0.55, 0.55, 0.40),
    "car_carrier": (0.95, 0.55, 0.60, 0.80),
    "ferry": (0.90, 0.45, 0.50, 0.80),
    "gas_carrier": (0.70, 0.60, 0.65, 0.50),
    "tanker_loaded": (0.70, 0.90, 0.55, 0.40),
    "tanker_ballast": (0.70, 0.75, 0.55, 0.40),
    "research": (0.85, 0.55, 0.65, 0.60),
}
"""Kind of ship -> transverse resistance CD_t, CD_lAF from ahead and from astern, cross-force parameter."""
TANKER_BLOCK = 0.75
"""Block coefficient from which a ship without a stated kind is taken for a tanker."""


def usual_kind(ship: Particulars) -> str:
    """Kind of a ship that does not state it: a loaded tanker if it is full, else a loaded cargo ship."""
    return "tanker_loaded" if ship.block > TANKER_BLOCK else "cargo_loaded"


def wind_load(
    areas: WindAreas,
    coefficients: tuple[float, float, float, float],
    ahead: Float[Tensor, "*#batch"],
    across: Float[Tensor, "*#batch"],
    third: tuple[Tensor | float, Tensor | float] = (0.0, 0.0),
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Load of the air on a ship, by Blendermann's functions.

    With the air relative to the ship at angle g (0 from ahead, positive from port) and speed V_rw::

        X = .5 rho V_rw^2 A_F C_X    C_X = -CD_lAF cos g / den
        Y = .5 rho V_rw^2 A_L C_Y    C_Y = CD_t sin g / den
        N = Y L_oa [s_L / L_oa - .18 (|g| - pi/2)]
        den = 1 - (d/2) (1 - CD_lAF A_F / (A_L CD_t)) sin^2 2g

    Args:
        areas: What the wind blows on.
        coefficients: CD_t, CD_lAF from ahead and from astern, and d, of ``COEFFICIENTS``.
        ahead: Speed of the ship through the air, forward [m/s].
        across: To starboard [m/s].
        third: Shares of a third harmonic in X and Y, by which published curves differ [-].

    Returns:
        X, Y [N], and the arm N/Y over L_oa [-].

    Source:
        Blendermann 1994, J. Wind Eng. Ind. Aerodyn. 51; the step of CD_lAF at beam wind is smoothed.
    """
    side, bow, stern, cross = coefficients
    square = ahead.square() + across.square() + 1e-12
    speed = square.sqrt()
    cos, sin = ahead / speed, across / -speed
    cos2, sin2 = cos.square(), sin.square()
    along = torch.sigmoid(cos / 0.05) * (bow - stern) + stern
    # sin^2 2g = 4 sin^2 g cos^2 g
    den = (along * (areas.frontal / (areas.lateral * side)) - 1) * cos2 * sin2 * (2 * cross) + 1
    pressure = square / den * (0.5 * AIR)
    # Shares of cos 3g = cos g (4 cos^2 g - 3) and sin 3g = sin g (3 - 4 sin^2 g)
    surge = cos * ((cos2 * 4 - 3) * third[0] + 1)
    sway = sin * ((sin2 * -4 + 3) * third[1] + 1)
    arm = torch.atan2(sin.abs(), cos) * -0.18 + (areas.lateral_centre / areas.length_overall + 0.09 * pi)
    return pressure * along * surge * -areas.frontal, pressure * sway * (side * areas.lateral), arm
