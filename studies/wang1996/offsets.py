"""The table of offsets that Wang's thesis takes wave forces from."""

import numpy as np

from manoeuvre_nn.seakeeping.hull import Hull

# Wang 1996, Tables 7.1 and 7.2. Stations from the forward perpendicular (0) to the after one (10).
STATIONS = (0, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 7, 8, 8.5, 9, 9.5, 10)
WATERLINES = (0.0, 1.219, 2.438, 4.877, 7.315, 8.230, 9.754, 12.192)
"""Heights above the base line [m]: 0, 4, 8, 16, 24, 27, 32 and 40 ft."""
KEEL = (0, 0.394, 0.483, 0.571, 0.660, 0.660, 0.660, 0.660, 0.660, 0.660, 0.660, 0.660, 0.660, 0.432, 0)
"""Half-breadth of the flat keel [m]."""
BOTTOM_TANGENT = {3: 0.860, 4: 3.832, 5: 9.144, 6: 6.268, 7: 2.324, 8: 0.679, 8.5: 0.660}
"""Station -> half-breadth at which the bottom leaves the base line [m]."""
HALF_BREADTHS = (
    (0.759, 0.581, 0.108, 0.0, 0.0, 0.133, 0.879),
    (1.308, 1.432, 1.270, 1.172, 1.245, 1.613, 2.775),
    (1.968, 2.438, 2.730, 2.962, 3.140, 3.610, 4.823),
    (2.978, 3.848, 4.626, 5.102, 5.359, 5.886, 6.988),
    (4.324, 5.534, 6.575, 7.315, 7.597, 8.093, 8.979),
    (7.509, 8.909, 10.173, 10.792, 10.956, 11.195, 11.484),
    (10.293, 11.208, 11.830, 11.986, 12.007, 12.033, 12.039),
    (11.417, 11.916, 12.039, 12.039, 12.039, 12.039, 12.039),
    (10.344, 11.338, 11.983, 12.039, 12.039, 12.039, 12.039),
    (6.833, 8.490, 10.627, 11.703, 11.899, 12.033, 12.039),
    (3.314, 4.423, 6.788, 9.458, 10.271, 11.246, 11.932),
    (2.207, 2.896, 4.518, 7.306, 8.417, 9.976, 11.389),
    (1.445, 1.778, 2.508, 4.677, 5.962, 7.973, 10.252),
    (0.549, 0.568, 0.600, 1.533, 3.057, 5.410, 8.236),
    (0.0, 0.0, 0.0, 0.0, 0.0, 2.130, 4.861),
)
"""Half-breadths on the waterlines above the base line [m], a row for each station; blanks of the table are 0."""


def wang_hull(length: float = 152.4) -> Hull:
    """The hull of the table up to its 40-ft waterline.

    The table belongs to a ship of 24.08 m beam, while the Mariner of the thesis' Table 3.1 has 21.763 m: the forces of
    chapter 7 are those of a beamier ship. The main deck and the station 10 ft abaft the after perpendicular, which
    begins above the 32-ft waterline, are left out. On the base line the bottom is taken to be flat out to its tangent.

    Args:
        length: Length between perpendiculars [m]; the table does not say it, the thesis' Mariner has 152.4 m.

    Returns:
        The hull, stations forward of midship.

    Source:
        Wang 1996, Tables 7.1 and 7.2.
    """
    base = [BOTTOM_TANGENT.get(station, keel) for station, keel in zip(STATIONS, KEEL, strict=True)]
    stations = length * (0.5 - np.array(STATIONS, dtype=float) / 10)
    return Hull(stations[::-1].copy(), np.array(WATERLINES), np.column_stack([base, HALF_BREADTHS])[::-1].copy())
