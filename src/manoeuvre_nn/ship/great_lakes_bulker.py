"""A 730-ft Great Lakes bulk carrier."""

from manoeuvre_nn.core.particulars import Particulars, Stability, WindAreas
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.ship.taylor import TaylorShip

# Wang 1996, Table A.1; A/(LT) = .027 reproduces the Clarke column of Table A.4 (not stated in the thesis).
PARTICULARS = Particulars(
    name="Great Lakes bulk carrier", length=217.627, beam=23.005, draught=8.100, block=0.905, speed=5.144,
    rudder_rate=2.5 * DEGREE, rudder_limit=35 * DEGREE, rudder_area_ratio=0.027, record_length=360.0,
    longest_turn=400.0,
    surge_damping=-0.02, rudder_drag=-0.0972,  # Wang 1996, Table A.3, row Clarke
    # Not in the thesis: what a ship of this type has; wind and heel need it.
    displacement=37_611e3, resistance=179.3e3, rpm=88.0, wind_areas=WindAreas(330.0, 1500.0, -20.0, 222.5),
    stability=Stability(2.5, 7.6, 11.2),
    source="Wang 1996, Table A.1, after Eda et al. 1982",
)  # fmt: skip

# Wang 1996, Table A.2.
INERTIA = {"mx": 0.19505, "my": 0.33234, "mz": 0.02724}
COEFFICIENTS = {
    "X": {"u": -0.02000, "uu": 0.01800, "vv": -0.26007, "rr": 0.01310, "dd": -0.09833, "vr": 0.299023},
    "Y": {"v": -0.32535, "vvv": -7.38289, "vrr": -0.60718, "r": -0.16200, "rrr": 2.40185, "d": 0.08194,
          "ddd": -0.25469},
    "N": {"v": -0.08732, "vvv": -3.04665, "vrr": 0.07576, "r": -0.04433, "rrr": -0.24180, "rvv": -0.84361,
          "d": -0.04675, "ddd": 0.23857},
}  # fmt: skip


def great_lakes_bulker() -> TaylorShip:
    """The bulk carrier as printed.

    Because no Y or N term depends on the speed, a 25-deg turn loses all its way and runs astern after 578 s: turns are
    limited to 400 s.

    Returns:
        The ship.

    Source:
        Wang 1996, Tables A.1 and A.2. Positive rudder turns to port there.
    """
    return TaylorShip(PARTICULARS, INERTIA, COEFFICIENTS, positive_rudder_turns_to="port")
