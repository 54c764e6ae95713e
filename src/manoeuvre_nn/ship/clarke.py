"""Linear derivatives estimated from a ship's main dimensions."""

from math import pi

from manoeuvre_nn.core.particulars import Particulars

GYRATION = 0.28
"""Radius of gyration in yaw over L [-]; not stated in the thesis, found from its Tables 5.3 and A.5."""
SURGE_ADDED_MASS = 0.05
"""-Xudot over the displacement [-]: Wang 1996, section 4.2."""


def clarke_derivatives(ship: Particulars) -> dict[str, float]:
    """Linear derivatives of sway and yaw in the (rho, L, T, U0) system.

    Args:
        ship: Main dimensions.

    Returns:
        ``Yvdot, Yrdot, Yv, Yr, Yd, Nvdot, Nrdot, Nv, Nr, Nd`` [-], rudder positive to port, without mass terms.

    Source:
        Clarke, Gedling & Hine 1982 as in Wang 1996, eqs 4.7-4.16, times L/T. Regression over models of merchant ships
        with C_B from .5 to .9.
    """
    length, beam, draught, block = ship.length, ship.beam, ship.draught, ship.block
    slender, width, flat = draught / length, beam / length, beam / draught
    scale = -pi * slender**2 * length / draught
    rudder = 3.0 * ship.rudder_area_ratio
    return {
        "Yvdot": scale * (1 + 0.16 * block * flat - 5.1 * width**2),
        "Yrdot": scale * (0.67 * width - 0.0033 * flat**2),
        "Yv": scale * (1 + 0.40 * block * flat),
        "Yr": scale * (-0.5 + 2.2 * width - 0.080 * flat),
        "Yd": rudder,
        "Nvdot": scale * (1.1 * width - 0.041 * flat),
        "Nrdot": scale * (1 / 12 + 0.017 * block * flat - 0.33 * width),
        "Nv": scale * (0.5 + 2.4 * slender),
        "Nr": scale * (0.25 + 0.039 * flat - 0.56 * width),
        "Nd": -0.5 * rudder,
    }
