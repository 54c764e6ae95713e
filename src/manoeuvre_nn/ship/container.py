"""The container ship of Son & Nomoto: surge, sway, yaw and roll about G, with one or two screws."""

from math import pi, sqrt

import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Factor
from manoeuvre_nn.core.particulars import Particulars, Stability
from manoeuvre_nn.core.units import DEGREE, GRAVITY, KNOT, SEA_WATER
from manoeuvre_nn.ship.four_degrees import Drive, FourDegreeShip, HullSeries, twin

LENGTH, BEAM, DRAUGHT, VOLUME, KM = 175.0, 25.40, 8.50, 21_222.0, 10.39
"""L, B, mean draught [m], displaced volume [m^3] and metacentre above the keel [m] (Son & Nomoto 1982, Table 1)."""
MASS, ADDED_X, ADDED_Y = 0.00792, 0.000238, 0.007049
ROLL_INERTIA, YAW_INERTIA = 0.0000176 + 0.0000034, 0.000456 + 0.000419
LEVER_X, LEVER_Y, ALPHA_Y = 0.0313, 0.0313, 0.05
"""m', m_x', m_y'; I_x' + J_x', I_z' + J_z'; l_x', l_y' (centres of the added masses above G) and alpha_y' (forward)."""
HULL = {
    "X": {"u u": -0.0004226, "v r": -0.00311 + MASS + ADDED_Y, "r r": 0.00020, "phi phi": -0.00020, "v v": -0.00386},
    "Y": {"u r": -MASS - ADDED_X, "v": -0.0116, "r": 0.00242, "phi": -0.000063, "v v v": -0.109, "r r r": 0.00177,
          "v v r": 0.0214, "v r r": -0.0405, "v v phi": 0.04605, "v phi phi": 0.00304, "r r phi": 0.009325,
          "r phi phi": -0.001368},
    "N": {"v": -0.0038545, "r": -0.00222, "p": 0.000213, "phi": -0.0001424, "v v v": 0.001492, "r r r": -0.00229,
          "v v r": -0.0424, "v r r": 0.00156, "v v phi": -0.019058, "v phi phi": -0.0053766, "r r phi": -0.0038592,
          "r phi phi": 0.0024195},
    "K": {"u r": ADDED_X * LEVER_X, "v": 0.0003026, "r": -0.000063, "p": -0.0000075, "phi": -0.000021,
          "v v v": 0.002843, "r r r": -0.0000462, "v v r": -0.000588, "v r r": 0.0010565, "v v phi": -0.0012012,
          "v phi phi": -0.0000793, "r r phi": -0.000243, "r phi phi": 0.00003569},
}  # fmt: skip
"""Derivatives over ``.5 rho L^2 U^2`` and ``.5 rho L^3 U^2`` (Son & Nomoto 1982, Table 2), and the mass terms."""
ASPECT = 1.8219
DRIVE = Drive(
    diameter=6.533, thrust=(0.527, -0.455), wake=0.184, wake_drift=1.09, x_p=-0.526, deduction=0.175, area=33.0376,
    slope=6.13 * ASPECT / (ASPECT + 2.25), epsilon=0.921, race=0.631, inflow=(0.088, -0.156, -0.275, 1.96), x_r=-0.5,
    z_r=0.033, hull_force=0.237, hull_x=-0.48, rudder_drag=0.71,
)  # fmt: skip
"""Propeller and rudder (Son & Nomoto 1982, Table 2)."""
SCREW_OFFSET = 0.2
"""Distance of a twin screw from the centre plane over the beam [-]: usual with two shafts, not of the source."""


def container(screws: int = 1, rolls: bool = True, gm: Factor = 0.3) -> FourDegreeShip:
    """The container ship, with its single screw or with two of the same thrust.

    With two screws each has half of the disc area (``D / sqrt 2``) and each rudder half of the area, at the same aspect
    ratio, so that thrust, advance ratio and rudder force on a straight course are those of the single screw.

    Args:
        screws: 1 as in the source, or 2.
        rolls: Whether the ship is free to roll; else it is held upright: three degrees of freedom.
        gm: Metacentric height [m].

    Returns:
        The ship.

    Raises:
        InputError: If there are not one or two screws, or the metacentric height is not positive.

    Source:
        Son & Nomoto 1981 (J. Soc. Nav. Arch. Japan 150), 1982 (Nav. Arch. and Ocean Engineering 20: 73-83), as
        tabulated in the Marine Systems Simulator (Fossen & Perez; m_y' corrected there). Speed: service speed of
        the S-175 hull, Fn = .275. Rudder rate and stop: not of the source, SOLAS' usual ones.
    """
    if screws not in (1, 2):
        raise InputError(f"ship.screws={screws}: expected 1 or 2")
    if not gm > 0:
        raise InputError(f"ship.gm={gm}: expected a metacentric height in m, more than 0")
    unit, weight = 0.5 * SEA_WATER * LENGTH**3, SEA_WATER * GRAVITY * VOLUME
    roll = unit * LENGTH**2 * ROLL_INERTIA
    particulars = Particulars(
        name="container ship", length=LENGTH, beam=BEAM, draught=DRAUGHT, block=VOLUME / (LENGTH * BEAM * DRAUGHT),
        speed=22.15 * KNOT, rudder_rate=2.5 * DEGREE, rudder_limit=35 * DEGREE,
        rudder_area_ratio=DRIVE.area / (LENGTH * DRAUGHT), displacement=SEA_WATER * VOLUME,
        stability=Stability(gm, KM - gm, 2 * pi * sqrt(roll / (weight * gm))), source="Son & Nomoto 1982",
    )  # fmt: skip
    sway, yaw = unit * (MASS + ADDED_Y), unit * LENGTH**2 * YAW_INERTIA
    by_yaw, by_roll = unit * LENGTH * ADDED_Y * ALPHA_Y, -unit * LENGTH * ADDED_Y * LEVER_Y
    surge = unit * (MASS + ADDED_X)
    mass = torch.tensor(
        [[surge, 0, 0, 0], [0, sway, by_yaw, by_roll], [0, by_yaw, yaw, 0], [0, by_roll, 0, roll]], dtype=torch.float64
    )
    hull = HullSeries(HULL, prime=True, restoring=weight * gm, axis=KM - gm - DRAUGHT)
    return FourDegreeShip(particulars, mass, hull, twin(DRIVE, SCREW_OFFSET * BEAM) if screws == 2 else [DRIVE], rolls)
