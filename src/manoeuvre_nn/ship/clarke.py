"""Linear derivatives estimated from a ship's main dimensions."""

from math import pi

from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.ship.taylor import TaylorShip

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


def clarke_ship(ship: Particulars, Xu: float = -0.025, Xdd: float | None = None) -> TaylorShip:  # noqa: N803
    """A ship that moves by Clarke's linear derivatives alone: the known part of an identification.

    ``(m - Xudot) udot = Xu (u - U0) + Xdd d^2/2``, ``(m - Yvdot) vdot - Yrdot rdot = Yv v + (Yr - m) r + Yd d``,
    ``(Iz - Nrdot) rdot - Nvdot vdot = Nv v + Nr r + Nd d`` in the (rho, L, T, U0) system.

    Args:
        ship: Main dimensions.
        Xu: Surge damping [-], of the order of -.02 to -.05; what is wrong with it the network takes up.
        Xdd: Rudder drag [-]; by default ``-2 Yd``.

    Returns:
        A linear ship.

    Source:
        Wang 1996, eqs 4.1-4.19 and 4.30-4.32 (Table 4.1 and eqs 4.20-4.23 are lost in the scan); the Clarke columns of
        Tables 5.1-5.3 and A.3-A.5 are reproduced to 2e-5 with ``k_zz = .28 L``. Eq 4.18 gives ``Xdd = -2 Yd``; the
        tables have -.04008 (Mariner) and -.0972 (bulk carrier).
    """
    d = clarke_derivatives(ship)
    mass = 2 * ship.block * ship.beam / ship.length
    inertia = {
        "mx": (1 + SURGE_ADDED_MASS) * mass,
        "my": mass - d["Yvdot"],
        "mz": mass * GYRATION**2 - d["Nrdot"],
        "Yrdot": d["Yrdot"],
        "Nvdot": d["Nvdot"],
    }
    coefficients = {
        "X": {"u": Xu, "dd": -2 * d["Yd"] if Xdd is None else Xdd},
        "Y": {"v": d["Yv"], "r": d["Yr"] - mass, "d": d["Yd"]},
        "N": {"v": d["Nv"], "r": d["Nr"], "d": d["Nd"]},
    }
    return TaylorShip(ship, ship.prime, inertia, coefficients, positive_rudder_turns_to="port")
