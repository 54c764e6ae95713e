"""Latitude and longitude as metres north and east of the first fix."""

import numpy as np
from jaxtyping import Float

EQUATOR = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid [m]."""
FLATTENING = 1 / 298.257223563
"""Its flattening [-]."""

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
