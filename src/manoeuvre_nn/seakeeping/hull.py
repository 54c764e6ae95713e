"""A hull as a table of offsets, and the part of it under water."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError


@dataclass(frozen=True)
class Hull:
    """A table of offsets: straight between stations and between waterlines, nothing beyond the end stations.

    Attributes:
        stations: Places of the sections forward of the origin [m], rising.
        waterlines: Heights above the base line [m], rising from 0.
        half_breadths: Half-breadths [m].
    """

    stations: Float[np.ndarray, " stations"]
    waterlines: Float[np.ndarray, " waterlines"]
    half_breadths: Float[np.ndarray, "stations waterlines"]

    def half_breadth(
        self, x: Float[np.ndarray, " strips"], z: Float[np.ndarray, " slices"]
    ) -> Float[np.ndarray, "strips slices"]:
        """Half-breadths between the lines of the table.

        Args:
            x: Places forward of the origin [m].
            z: Heights above the base line [m].

        Returns:
            Half-breadths [m].
        """
        rows = _share(self.stations, x) @ self.half_breadths
        return np.asarray(rows @ _share(self.waterlines, z).T)


def _share(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """How much each node counts in a linear interpolation."""
    return np.stack([np.interp(at, nodes, unit) for unit in np.eye(len(nodes))], axis=-1)


@dataclass(frozen=True)
class Immersed:
    """A hull below its waterline, cut into small boxes.

    Attributes:
        x: Middles of the strips forward of the origin [m].
        depth: Middles of the slices below the still water [m].
        half_breadth: Half-breadths [m].
        area: Side area of a box [m^2].
    """

    x: Float[np.ndarray, " strips"]
    depth: Float[np.ndarray, " slices"]
    half_breadth: Float[np.ndarray, "strips slices"]
    area: float

    @property
    def volume(self) -> float:
        """Displaced volume [m^3]."""
        return float(2 * self.half_breadth.sum() * self.area)


def immerse(hull: Hull, draught: float, strips: int = 200, slices: int = 40) -> Immersed:
    """Cut the part of a hull that is under water.

    Args:
        hull: The table of offsets.
        draught: Draught on an even keel [m].
        strips: Cuts along the length.
        slices: Cuts along the draught.

    Returns:
        The boxes.

    Raises:
        InputError: If the table ends below the water.
    """
    if not 0 < draught <= hull.waterlines[-1]:
        raise InputError(f"draught {draught} m is outside the offsets: write 0 to {hull.waterlines[-1]:g} m")
    first, length = hull.stations[0], hull.stations[-1] - hull.stations[0]
    x = first + length * (np.arange(strips) + 0.5) / strips
    z = draught * (np.arange(slices) + 0.5) / slices
    return Immersed(x, draught - z, hull.half_breadth(x, z), float(length * draught / strips / slices))
