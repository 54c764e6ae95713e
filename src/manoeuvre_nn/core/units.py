"""Units at the edge of the program; inside, everything is SI and radians."""

import math

KNOT = 1852.0 / 3600.0
"""One knot [m/s]."""
DEGREE = math.pi / 180.0
"""One degree [rad]."""
RPM = 1.0 / 60.0
"""One revolution a minute [1/s]."""
GRAVITY = 9.81
"""Acceleration of gravity [m/s^2], the value of the BIS prime system in the sources."""
SEA_WATER = 1025.0
"""Density of sea water [kg/m^3]."""
FRESH_WATER = 1000.0
"""Density of fresh water, as in towing tanks and ponds [kg/m^3]."""


def three_digits(value: float) -> str:
    """A number to three digits, never as a power of ten: ``4740``, ``0.0123``."""
    return f"{float(f'{value:.3g}'):.6g}"
