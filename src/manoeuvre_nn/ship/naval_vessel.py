"""The multipurpose naval vessel of Blanke & Christensen: surge, sway, yaw and roll, two screws and two rudders."""

from math import pi, sqrt

import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Factor
from manoeuvre_nn.core.particulars import Particulars, Stability
from manoeuvre_nn.core.units import DEGREE, GRAVITY
from manoeuvre_nn.ship.four_degrees import Drive, FourDegreeShip, HullSeries

LENGTH, BEAM, DRAUGHT, VOLUME, RHO, SPEED = 51.5, 8.6, 2.3, 357.0, 1014.0, 8.0
"""L, B, T [m], displaced volume [m^3], density of the water [kg/m^3], nominal speed [m/s] (Perez 2005)."""
MASS = VOLUME * RHO
GM, KG, X_G = 1.1, 3.36, -3.38
"""GM, height of G above the keel, G forward of the origin of the captive tests [m]."""
Z_G = DRAUGHT - KG
"""G below that origin, which lies in the waterline [m]."""
INERTIA = {"roll": 2.3763e6, "yaw": 47.934e6}
"""I_xx, I_zz [kg m^2]."""
ADDED = {
    "Xudot": -17400.0, "Yvdot": -393000.0, "Ypdot": -296000.0, "Yrdot": -1400000.0, "Kvdot": 296000.0,
    "Kpdot": -774000.0, "Krdot": 0.0, "Nvdot": 538000.0, "Npdot": 0.0, "Nrdot": -38.7e6,
}  # fmt: skip
"""Derivatives by accelerations [kg, kg m, kg m^2]."""
HULL = {
    "X": {"u |u|": -1960.0, "v r": 0.33 * MASS + MASS, "r r": MASS * X_G, "p r": -MASS * Z_G},
    "Y": {"|u| v": -11800.0, "u r": 131000.0 - MASS, "v |v|": -3700.0, "v |r|": -794000.0, "r |v|": -182000.0,
          "phi |u| |v|": 10800.0, "phi |u| |r|": 251000.0, "phi u u": -74.0},
    "N": {"|u| v": -92000.0, "|u| r": -4710000.0, "r |r|": -202000000.0, "r |v|": -15600000.0,
          "phi |u| |v|": -214000.0, "phi u |r|": -4980000.0, "phi u |u|": -8000.0, "u r": -MASS * X_G},
    "K": {"|u| v": 9260.0, "u r": -102000.0 + MASS * Z_G, "v |v|": 29300.0, "v |r|": 621000.0, "r |v|": 142000.0,
          "phi |u| |v|": -8400.0, "phi |u| |r|": -196000.0, "phi u u": -1180.0, "|u| p": -15500.0,
          "p |p|": -416000.0, "p": -500000.0, "phi phi phi": -0.325 * MASS * GRAVITY},
}  # fmt: skip
"""Derivatives in SI and the products that go with the mass (Blanke & Christensen 1993; Perez 2005)."""
RUDDER_AREA, RUDDER_SPAN, LIFT_SLOPE = 1.5, 1.5, 0.054 / DEGREE
"""Area [m^2] and span [m] of each rudder, slope of its lift [1/rad] (Perez 2005)."""
STERN = -23.79
"""Rudder stock forward of the origin [m]: G is 20.41 m forward of it."""
DIAMETER = 1.6
"""Propeller diameter [m] (Perez 2005)."""
THRUST = (0.543, -0.466)
"""c1, c2 of K_T: means of the two propellers of a twin-screw ship at sea (Hess & Faller 2000, Table 3, ship 2)."""
WAKE, DEDUCTION = 0.2, 0.1
"""Wake fraction and thrust deduction (Hess & Faller 2000, for their two ships)."""
SCREW_OFFSET = 0.2
"""Distance of a screw from the centre plane over the beam [-]: usual with two shafts, not of the source."""
VELOCITY_POWERS = {"u": 0.5, "v": 0.5, "r": -0.5, "p": -0.5, "phi": 0.0}
"""Exponents of length with which motions go by Froude's law."""


def naval_vessel(scale: Factor = 1.0, rolls: bool = True) -> FourDegreeShip:
    """The naval vessel, or a larger or smaller one of the same form by Froude's law.

    Args:
        scale: Length over that of the source: 2.5 is a frigate of 129 m.
        rolls: Whether the ship is free to roll; else it is held upright: three degrees of freedom.

    Returns:
        The ship.

    Raises:
        InputError: If the scale is not positive.

    Source:
        Blanke & Christensen 1993, 10th Ship Control Systems Symposium; dimensions and rudders by Perez 2005 (Marine
        Systems Simulator), where N_phi|uv| multiplies ``phi |u phi|``: here, as its name says, ``phi |u v|``. Rudders
        lie in the race of Perez' propellers by momentum theory, without flow straightening (Soeding 1998); thrust, wake
        and thrust deduction are those of Hess & Faller's ship 2. The rudder does not stall here.
    """
    if not scale > 0:
        raise InputError(f"ship.scale={scale}: expected a factor on the length, more than 0")
    length, speed = scale * LENGTH, SPEED * sqrt(scale)
    restoring = scale**4 * RHO * GRAVITY * GM * VOLUME
    roll = scale**5 * (INERTIA["roll"] - ADDED["Kpdot"])
    particulars = Particulars(
        name="naval vessel", length=length, beam=scale * BEAM, draught=scale * DRAUGHT,
        block=VOLUME / (LENGTH * BEAM * DRAUGHT), speed=speed, rudder_rate=5.0 * DEGREE, rudder_limit=35 * DEGREE,
        rudder_area_ratio=2 * RUDDER_AREA / (LENGTH * DRAUGHT), rho=RHO, displacement=scale**3 * MASS,
        sample_interval=min(1.0, 0.1 * length / speed),
        stability=Stability(scale * GM, scale * KG, 2 * pi * sqrt(roll / restoring)),
        source="Blanke & Christensen 1993; Perez 2005",
    )  # fmt: skip
    terms = {e: {t: scale ** _power(e, t) * c for t, c in row.items()} for e, row in HULL.items()}
    drives = [_drive(scale, sign * SCREW_OFFSET * BEAM) for sign in (1, -1)]
    return FourDegreeShip(particulars, _mass(scale), HullSeries(terms, False, restoring), drives, rolls)


def _power(equation: str, term: str) -> float:
    """Exponent of length with which a coefficient goes: that of the force less those of the motions."""
    force = 3.0 if equation in "XY" else 4.0
    return force - sum(VELOCITY_POWERS[factor.strip("|")] for factor in term.split())


def _mass(scale: float) -> torch.Tensor:
    """Inertia with added masses for u, v, r, p."""
    a, m = ADDED, MASS
    rows = [
        [m - a["Xudot"], 0.0, 0.0, 0.0],
        [0.0, m - a["Yvdot"], m * X_G - a["Yrdot"], -(m * Z_G + a["Ypdot"])],
        [0.0, m * X_G - a["Nvdot"], INERTIA["yaw"] - a["Nrdot"], -a["Npdot"]],
        [0.0, -(m * Z_G + a["Kvdot"]), -a["Krdot"], INERTIA["roll"] - a["Kpdot"]],
    ]
    power = torch.tensor([0.0, 0.0, 1.0, 1.0], dtype=torch.float64)
    return torch.tensor(rows, dtype=torch.float64) * scale ** (3.0 + power + power[:, None])


def _drive(scale: float, y: float) -> Drive:
    """A screw at y [m] to starboard on the ship of the source, and the rudder behind it."""
    mid_span = DRAUGHT - 0.5 * RUDDER_SPAN
    return Drive(
        diameter=scale * DIAMETER, thrust=THRUST, wake=WAKE, wake_drift=0.0, x_p=STERN / LENGTH, deduction=DEDUCTION,
        area=scale**2 * RUDDER_AREA, slope=LIFT_SLOPE, epsilon=1.0, race=1.0, inflow=(1.0, STERN / LENGTH, 0.0, 0.0),
        x_r=STERN / LENGTH, z_r=mid_span / LENGTH, hull_force=0.0, hull_x=0.0, rudder_drag=1.0, y=scale * y,
    )  # fmt: skip
