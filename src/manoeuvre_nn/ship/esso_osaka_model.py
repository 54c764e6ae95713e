"""The 3-m model of the tanker Esso Osaka: particulars for measured manoeuvres, and its published coefficients."""

from dataclasses import replace

from manoeuvre_nn.core.particulars import Particulars, WindAreas
from manoeuvre_nn.core.units import DEGREE, FRESH_WATER
from manoeuvre_nn.ship.mmg import MMGCoefficients, MMGShip


def esso_osaka_model() -> Particulars:
    """The model of the free-running tests in an open pond.

    The displacement follows as 244.7 kg (244.6 in the source). Approach speeds of the runs lie between .3 and .54 m/s;
    .4 m/s is their middle. The rudder's rate is not stated: the recorded angle goes through 40 deg within one sample of
    .1 s, so that it is rather the order, and no slower rate may be laid over it. The rudder stop is the largest angle
    recorded, 35.3 deg. The nominal shaft speed is that at which the recorded model keeps .4 m/s ahead (u/n .034 m in
    the middle). The centroid of the lateral wind area is that of :func:`esso_osaka_mmg`.

    Returns:
        Particulars.

    Source:
        Wakita et al. 2022 (doi 10.1007/s00773-021-00867-1) and Miyauchi et al. 2022 (doi 10.1007/s00773-022-00889-3):
        L, B, T, mass, block coefficient, rudder area .0106 m^2, wind areas; the rest from the records that are
        published with them.
    """
    return Particulars(
        name="Esso Osaka model", length=3.0, beam=0.489, draught=0.201, block=0.830, speed=0.4,
        rudder_rate=400 * DEGREE, rudder_limit=35.3 * DEGREE, rudder_area_ratio=0.0106 / (3.0 * 0.201),
        record_length=180.0, sample_interval=0.2, rho=FRESH_WATER, displacement=244.6, rpm=60 * 12.0,
        wind_areas=WindAreas(frontal=0.135, lateral=0.520, lateral_centre=-0.013, length_overall=3.0),
        source="Wakita et al. 2022; Miyauchi et al. 2022",
    )  # fmt: skip


def esso_osaka_mmg() -> MMGShip:
    """The same model with the low-speed MMG coefficients that its owners publish.

    Three files of the source give the same numbers but for two: k_1 is -.3223 in the newest and -.3323 in the two
    older ones, X_vr -.0081 in two and .4535 in one. The newest is followed. Whether a number was measured with the
    model held or adjusted to its free runs is not said; Miyauchi et al. start their search from such a set. Density
    998 kg/m^3. The wind's part of the set is not in this ship: see ``benchmarks/esso_osaka_mmg.py``.

    Returns:
        The ship; its approach speed is that of :func:`esso_osaka_model`.

    Source:
        NAOE-5thLab/mmg-1p1r-simulator (CC BY-NC 4.0), MMG_params_EssoOsaka3m.csv and
        principal_particulars_EssoOsaka3m.csv, commits 472e348 and 9f2d5e6, which asks to cite Miyauchi et al. 2022
        (doi 10.1007/s00773-022-00889-3).
    """
    areas = WindAreas(frontal=0.13544, lateral=0.52038, lateral_centre=-0.01299, length_overall=3.0)
    particulars = replace(esso_osaka_model(), beam=0.48925, draught=0.20114, rho=998.0, wind_areas=areas)
    coefficients = MMGCoefficients(
        mass=0.27078, added_x=0.0467, added_y=0.2579, inertia=0.0286, x_g=0.03119,
        x_ahead=-0.02139, x_astern=-0.03189, x_vr=-0.0081, y_v=-0.3728, y_r=0.116, n_v=-0.1458, n_r=-0.04849,
        cross_drag=0.9665, cross_y=2.217, cross_n=0.8097,
        diameter=0.084, pitch_ratio=0.7151, deduction=0.22, wake=0.614, wake_drift=(0.871, -0.359), x_p=-0.517,
        thrust=(0.3278, -0.3223, -0.156), thrust_astern=(-0.251, -0.175, 0.330, -0.233),
        side=(-7.90e-5, 7.99e-3, -4.93e-3, -5.87e-3, -5.58e-4, 5.08e-3, 1.702e-3, 9.16e-4),
        turn=(3.50e-5, -3.17e-3, 1.96e-3, 2.33e-3, 2.25e-4, -2.16e-3, 6.27e-5, 6.25e-5),
        area=0.01063, aspect=1.539, x_r=-0.5, rudder_deduction=0.19, hull_force=0.393, hull_x=-0.45, epsilon=1.42,
        k_x=0.288, k_x_astern=0.144, inflow_astern=-0.176, l_r=-1.08, gamma_port=0.4406, gamma_starboard=0.3506,
    )  # fmt: skip
    return MMGShip(particulars, coefficients)
