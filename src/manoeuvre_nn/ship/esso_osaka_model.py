"""The 3-m model of the tanker Esso Osaka: particulars, for measured manoeuvres."""

from manoeuvre_nn.core.ship import Particulars, WindAreas
from manoeuvre_nn.core.units import DEGREE, FRESH_WATER


def esso_osaka_model() -> Particulars:
    """The model of the free-running tests in an open pond.

    The displacement follows as 244.7 kg (244.6 in the source). Approach speeds of the runs lie between .3 and .54 m/s;
    .4 m/s is their middle. The rudder's rate is not stated: the recorded angle goes through 40 deg within one sample of
    .1 s, so that it is rather the order, and no slower rate may be laid over it. The rudder stop is the largest angle
    recorded, 35.3 deg. The nominal shaft speed is that at which the recorded model keeps .4 m/s ahead (u/n .034 m in
    the middle). The centroid of the lateral wind area and L_OA (1.023 L, the ship's) are not stated with the records.

    Returns:
        Particulars.

    Source:
        Wakita et al. 2022 (doi 10.1007/s00773-021-00867-1) and Miyauchi et al. 2022 (doi 10.1007/s00773-022-00889-3):
        L, B, T, mass, block coefficient, rudder area .0106 m^2, wind areas; the rest from the records that are
        published with them.
    """
    return Particulars(
        name="Esso Osaka model",
        length=3.0,
        beam=0.489,
        draught=0.201,
        block=0.830,
        speed=0.4,
        rudder_rate=400 * DEGREE,
        rudder_limit=35.3 * DEGREE,
        rudder_area_ratio=0.0106 / (3.0 * 0.201),
        record_length=180.0,
        sample_interval=0.2,
        rho=FRESH_WATER,
        displacement=244.6,
        rpm=60 * 12.0,
        wind_areas=WindAreas(frontal=0.135, lateral=0.520, lateral_centre=0.0, length_overall=3.07),
        source="Wakita et al. 2022; Miyauchi et al. 2022",
    )
