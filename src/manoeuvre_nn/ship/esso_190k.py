"""The Esso 190 000 dwt tanker."""

from math import inf
from typing import Literal

from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.particulars import Particulars, Stability, WindAreas
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.ship.tanker import TankerShip

# Rajesh & Bhattacharyya 2009, section 5.1. The rudder stop is not stated: 35 deg, the usual one. Rudder area: A/(LT)
# of 1.7 %, usual for tankers; only Clarke's estimate uses it. Records: section 5.2.2.
PARTICULARS = Particulars(
    name="Esso 190 000 dwt tanker", length=304.8, beam=47.17, draught=18.46, block=0.83, speed=16 * KNOT,
    rudder_rate=2.33 * DEGREE, rudder_limit=35 * DEGREE, rudder_area_ratio=0.017, record_length=1500.0,
    # Not in the paper, but for the volume: what a ship of this type has; wind and heel need it.
    displacement=225_500e3, resistance=1889.2e3, rpm=80.0, wind_areas=WindAreas(1150.0, 3300.0, -30.0, 313.0),
    stability=Stability(6.5, 13.5, 13.6),
    source="Rajesh & Bhattacharyya 2009, section 5.1",
)  # fmt: skip
VOLUME = 220_000.0
RPM_SERVICE = 80.0
SELF_PROPULSION = 15.990 * KNOT
"""Speed that 80 rpm keeps up: root of ``Xuu u^2 + L gT (1 - t) = 0`` (a test solves it)."""

# Rajesh & Bhattacharyya 2009, Table 1, after van Berlekom & Goddard 1972. Xvr, Yur and Nur are the printed sums
# 1 + Xvr, Yur - 1 and Nur - xG.
COEFFICIENTS = {
    "t": 0.22, "cun": 0.605, "cnn": 38.2, "Tuu": -0.00695, "Tun": -0.00063, "Tnn": 3.54e-5,
    "m11": 1.05, "Xuu": -0.0377, "Xvr": 2.02, "Xvv": 0.3, "Xccdd": -0.093, "Xccbd": 0.152,
    "Xudz": -0.05, "Xuuz": -0.0061, "Xvrz": 0.387, "Xvvzz": 0.0125,
    "m22": 2.02, "Yur": -0.752, "Yuv": -1.205, "Yvv": -2.4, "Yccd": 0.208, "Yccbbd": -2.16, "YT": 0.04,
    "Yvdz": -0.387, "Yurz": 0.182, "Yvvz": -1.5, "Yccbbdz": -0.191,
    "m33": 0.1232, "Nur": -0.231, "Nuv": -0.451, "Nvr": -0.3, "Nccd": -0.098, "Nccbbd": 0.688, "NT": -0.02,
    "Nrdz": -0.0045, "Nurz": -0.047, "Nuvz": -0.241, "Nvrz": -0.12, "Nccbbdz": 0.344,
}  # fmt: skip


def esso_190k(
    depth: Endless = inf, rpm: float = RPM_SERVICE, shaft: Literal["hold", "similarity"] = "hold"
) -> TankerShip:
    """The tanker in deep or shallow water.

    Args:
        depth: Water depth h [m].
        rpm: Shaft speed [rpm].
        shaft: ``hold`` keeps the rpm at other approach speeds, ``similarity`` scales it with the speed.

    Returns:
        The ship.

    Source:
        Rajesh & Bhattacharyya 2009, Table 1. Positive rudder turns to port there.
    """
    speed = SELF_PROPULSION * rpm / RPM_SERVICE
    return TankerShip(PARTICULARS, VOLUME, COEFFICIENTS, rpm=rpm, self_propulsion=speed, depth=depth, shaft=shaft)
