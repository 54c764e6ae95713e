"""The Mariner class cargo ship: the set of Wang's thesis, the same corrected, and Chislett & Strom-Tejsen's own."""

from manoeuvre_nn.core.particulars import Particulars, Stability, WindAreas
from manoeuvre_nn.core.prime import length_system
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.ship.taylor import TaylorShip

# Wang 1996, Table 3.1. The rudder stop is not stated; 35 deg is the largest angle used there. Records: section 4.4.1.
WANG = Particulars(
    name="Mariner", length=152.4, beam=21.763, draught=8.138, block=0.600, speed=7.614,
    rudder_rate=2.5 * DEGREE, rudder_limit=35 * DEGREE, rudder_area_ratio=0.02, record_length=360.0,
    surge_damping=-0.0253, rudder_drag=-0.04008,  # Wang 1996, Table 5.1, column Clarke
    # Not in the thesis: what a ship of this type has; wind and heel need it.
    displacement=16_274e3, resistance=350.1e3, rpm=76.0, wind_areas=WindAreas(420.0, 1650.0, -4.0, 158.0),
    stability=Stability(0.6, 8.4, 21.5),
    source="Wang 1996, Table 3.1",
)  # fmt: skip

# Wang 1996, Table 3.2, after Crane, Eda & Landsburg 1989.
INERTIA = {"mx": 0.17700, "my": 0.32700, "mz": 0.01750, "Nvdot": 0.00221, "Yrdot": -0.00077}
COEFFICIENTS = {
    "X": {"u": -0.02530, "uu": 0.01896, "uuu": -0.01302, "vv": -0.37800, "rr": 0.01272, "dd": -0.04000, "vr": 0.16800,
          "vd": 0.01960},
    "Y": {"0": -0.00080, "v": -0.24400, "vvv": -10.2120, "vdd": -0.00160, "r": -0.10500, "rvv": 6.46000, "d": 0.05860,
          "ddd": -0.05850, "dvv": 0.50000},
    "N": {"0": 0.00059, "v": -0.05550, "vvv": 2.07000, "vdd": 0.00528, "r": -0.03747, "rvv": -2.31600, "d": -0.02930,
          "ddd": 0.02892, "dvv": 0.20640},
}  # fmt: skip


def mariner() -> TaylorShip:
    """The Mariner as printed, ``N_dvv = +.2064`` included, which the thesis' own simulations used.

    No term of Y or N depends on the speed, and the series is about a constant U0: steady turns come out too tight and
    too slow. It is the ship to compare with the thesis, not the ship to design by.

    Returns:
        The ship.

    Source:
        Wang 1996, Tables 3.1 and 3.2. Positive rudder turns to port there.
    """
    return TaylorShip(WANG, INERTIA, COEFFICIENTS, positive_rudder_turns_to="port")


def mariner_corrected() -> TaylorShip:
    """The same with ``N_dvv = -.2064``, the physical sign.

    Returns:
        The ship.

    Source:
        Wang 1996, Tables 3.1 and 3.2; sign of N_dvv after Chislett & Strom-Tejsen 1965.
    """
    coefficients = COEFFICIENTS | {"N": COEFFICIENTS["N"] | {"dvv": -COEFFICIENTS["N"]["dvv"]}}
    return TaylorShip(WANG, INERTIA, coefficients, positive_rudder_turns_to="port")


# Chislett & Strom-Tejsen 1965: L 160.93 m and 15 kn; beam, draught and block as in Fossen 1994, appendix E.1.3.
# Rudder: stop 40 deg and 5 deg/s in the widely used MSS version of Fossen & Perez.
CHISLETT = Particulars(
    name="Mariner (Chislett & Strom-Tejsen 1965)", length=160.93, beam=23.17, draught=8.23, block=0.6, speed=7.7175,
    rudder_rate=5.0 * DEGREE, rudder_limit=40 * DEGREE, record_length=360.0,
    source="Chislett & Strom-Tejsen 1965; Fossen 1994, appendix E.1.3",
)  # fmt: skip

# All values: Chislett & Strom-Tejsen 1965, as printed in Fossen 1994, appendix E.1.3, times 1e-5.
CHISLETT_MASS, CHISLETT_IZ, CHISLETT_XG = 798e-5, 39.2e-5, -0.023
CHISLETT_ADDED = {"Xudot": -42e-5, "Yvdot": -748e-5, "Yrdot": -9.354e-5, "Nvdot": 4.646e-5, "Nrdot": -43.8e-5}
CHISLETT_COEFFICIENTS = {
    "X": {"u": -184e-5, "uu": -110e-5, "uuu": -215e-5, "vv": -899e-5, "rr": 18e-5, "dd": -95e-5, "udd": -190e-5,
          "rv": 798e-5, "vd": 93e-5, "uvd": 93e-5},
    "Y": {"v": -1160e-5, "r": -499e-5, "vvv": -8078e-5, "vvr": 15356e-5, "vu": -1160e-5, "ru": -499e-5,
          "d": 278e-5, "ddd": -90e-5, "ud": 556e-5, "uud": 278e-5, "vdd": -4e-5, "vvd": 1190e-5,
          "0": -4e-5, "u": -8e-5, "uu": -4e-5},
    "N": {"v": -264e-5, "r": -166e-5, "vvv": 1636e-5, "vvr": -5483e-5, "vu": -264e-5, "ru": -166e-5,
          "d": -139e-5, "ddd": 45e-5, "ud": -278e-5, "uud": -139e-5, "vdd": 13e-5, "vvd": -489e-5,
          "0": 3e-5, "u": 6e-5, "uu": 3e-5},
}  # fmt: skip


def mariner_chislett1965() -> TaylorShip:
    """The Mariner from planar motion tests, the set in wide use.

    Plain factors (no factorials), velocities over the instantaneous speed, ``Yr - m' = -499e-5`` and
    ``Xvr + m' = 798e-5`` as printed, centre of gravity ``xG' = -.023``.

    Returns:
        The ship.

    Source:
        Chislett & Strom-Tejsen 1965, report Hy-6; numbers as in Fossen 1994, appendix E.1.3. Positive rudder turns to
        port there.
    """
    static = CHISLETT_MASS * CHISLETT_XG
    inertia = {
        "mx": CHISLETT_MASS - CHISLETT_ADDED["Xudot"],
        "my": CHISLETT_MASS - CHISLETT_ADDED["Yvdot"],
        "mz": CHISLETT_IZ - CHISLETT_ADDED["Nrdot"],
        "Yrdot": CHISLETT_ADDED["Yrdot"] - static,
        "Nvdot": CHISLETT_ADDED["Nvdot"] - static,
    }
    return TaylorShip(
        CHISLETT,
        inertia,
        CHISLETT_COEFFICIENTS,
        positive_rudder_turns_to="port",
        prime=length_system(CHISLETT.length, CHISLETT.speed, CHISLETT.rho),
        taylor=False,
        scaling="instantaneous",
    )
