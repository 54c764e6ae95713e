"""Latitude and longitude as metres north and east of the first fix."""

import numpy as np
from jaxtyping import Bool, Float

from manoeuvre_nn.core.units import DEGREE

EQUATOR = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid [m]."""
FLATTENING = 1 / 298.257223563
"""Its flattening [-]."""

POLE, FULL_CIRCLE = 90.0, 360.0
"""Largest latitude and largest longitude that anybody writes [deg]."""
NEAR_POLE = 89.0
"""Latitude beyond which east turns too fast from place to place for positions on a plane [deg]."""
MARGIN = 1e-6
"""What rounding may add [deg]."""

Series = Float[np.ndarray, " n"]


def local_metres(latitude: Series, longitude: Series) -> tuple[Series, Series]:
    """Positions on the plane that touches the earth at the first fix; NaN where there is none.

    ``x = M (lat - lat_0)``, ``y = N cos(lat_0) (lon - lon_0)`` with the radii of curvature of the meridian M and of the
    prime vertical N at the first fix. Eastings x metres further north come out
    too long by ``tan(lat) x / 6.4e6``: 2e-4 a km at 50 degrees.

    Args:
        latitude: Geodetic latitude, north positive [rad].
        longitude: Longitude, east positive and continuous [rad].

    Returns:
        North and east of the first fix [m].

    Source:
        Snyder 1987, Map Projections - A Working Manual (USGS Professional Paper 1395), eqs 4-18, 4-20 and chapter 12
        (equidistant cylindrical), with the ellipsoid's radii at the first fix.
    """
    square = FLATTENING * (2 - FLATTENING)
    first = int(np.argmax(np.isfinite(latitude + longitude)))
    root = np.sqrt(1 - square * np.sin(latitude[first]) ** 2)
    meridian, vertical = EQUATOR * (1 - square) / root**3, EQUATOR / root
    north, east = latitude - latitude[first], longitude - longitude[first]
    return meridian * north, vertical * np.cos(latitude[first]) * east


def misplaced(channel: str, values: Series) -> tuple[Bool[np.ndarray, " n"], str]:
    """Which latitudes or longitudes are none, or lie too near a pole.

    Args:
        channel: ``lat`` or ``lon``; of any other channel none is found.
        values: Its samples, as far as they are there [rad].

    Returns:
        Whether each is such a one, and what to say of it.
    """
    size = np.abs(values) / DEGREE
    limit = {"lat": POLE, "lon": FULL_CIRCLE}.get(channel, np.inf)
    with np.errstate(invalid="ignore"):
        beyond, polar = size > limit + MARGIN, (size > NEAR_POLE + MARGIN) & (channel == "lat")
    if beyond.any():
        return beyond, f"expected at most {limit:.0f} deg: are latitude and longitude exchanged? mind the unit, too"
    return polar, f"within {POLE - NEAR_POLE:.0f} deg of a pole, where east has no sense: give x and y in metres"
