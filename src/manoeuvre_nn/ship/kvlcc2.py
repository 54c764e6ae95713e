"""The tanker KVLCC2 of the SIMMAN workshops: particulars at model and at full scale, for measured manoeuvres."""

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE, FRESH_WATER, KNOT

RUDDER_LIMIT = 35 * DEGREE


def kvlcc2_hsva() -> Particulars:
    """The 7-m model (1:45.714) of the free-running zigzags in HSVA's tank.

    The displacement follows as 3272 kg, the value of the test report. The sampling interval is .03 L/U0; the record is
    as long as the tests usually are.

    Returns:
        Particulars.

    Source:
        SIMMAN 2008 workshop, test report of HSVA (Cura Hochbaum 2006): L, B, T, speed, shaft speed 10.23 1/s, rudder
        area .0654 m^2 and rate 15.8 deg/s. Block coefficient: SIMMAN 2008, hull data. The rudder stop is the largest
        angle that was tested.
    """
    return Particulars(
        name="KVLCC2 model (HSVA)", length=7.0, beam=1.2688, draught=0.4550, block=0.8098, speed=1.179,
        rudder_rate=15.8 * DEGREE, rudder_limit=RUDDER_LIMIT, rudder_area_ratio=0.0654 / (7.0 * 0.4550),
        record_length=180.0, sample_interval=0.2, rho=FRESH_WATER, rpm=60 * 10.23,
        source="SIMMAN 2008; HSVA test report 2006",
    )  # fmt: skip


def kvlcc2() -> Particulars:
    """The ship itself, as MARIN's free-running zigzags give it (model values scaled up without scale correction).

    Returns:
        Particulars.

    Source:
        SIMMAN 2008 workshop, hull and rudder data: L, B, T, block coefficient, rudder area 136.7 m^2 and rate
        2.34 deg/s; approach speed 15.5 kn; 91.7 rpm in MARIN's recordings. The rudder stop is not stated: 35 deg, the
        usual one.
    """
    return Particulars(
        name="KVLCC2", length=320.0, beam=58.0, draught=20.8, block=0.8098, speed=15.5 * KNOT,
        rudder_rate=2.34 * DEGREE, rudder_limit=RUDDER_LIMIT, rudder_area_ratio=136.7 / (320.0 * 20.8),
        record_length=600.0, sample_interval=1.0, rpm=91.7, source="SIMMAN 2008",
    )  # fmt: skip
