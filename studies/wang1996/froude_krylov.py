"""Froude-Krylov forces: what the pressure of the undisturbed wave does to a hull, from its table of offsets."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import spherical_jn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY, SEA_WATER


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


def encounter_frequency(
    frequency: Float[np.ndarray, "*shape"], heading: float, speed: float
) -> Float[np.ndarray, "*shape"]:
    """Frequency at which a moving ship meets waves on deep water, ``w - w^2/g U cos(heading)``.

    Args:
        frequency: Wave frequency [rad/s].
        heading: Direction that the waves run to, off the bow to starboard [rad]: 0 following, pi head sea.
        speed: Speed of the ship [m/s].

    Returns:
        Frequency of encounter [rad/s]; below 0 where the ship overtakes the waves.
    """
    return np.asarray(frequency - frequency**2 / GRAVITY * speed * np.cos(heading))


def sway_and_yaw(
    hull: Immersed, frequency: Float[np.ndarray, " waves"], heading: float, rho: float = SEA_WATER
) -> Complex[np.ndarray, "2 waves"]:
    """Sway force and yaw moment of regular waves of 1 m amplitude on deep water.

    The pressure ``rho g e^(-k d) cos(w_e t - k (x cos m + y sin m))`` is integrated over the wetted hull, as the volume
    integral of its gradient: over the breadth in closed form, over boxes along length and depth. The answer is the
    same at any speed, only the frequency of encounter changes.

    Args:
        hull: The hull under water.
        frequency: Wave frequencies [rad/s].
        heading: Direction m that the waves run to, off the bow to starboard [rad]: 0 following, pi head sea.
        rho: Density of the water [kg/m^3].

    Returns:
        Sway force to starboard [N/m] and yaw moment, bow to starboard [N m/m], about the origin: complex amplitudes H
        of ``Re[H exp(i w_e t)]`` with the crest at the origin at time 0.

    Source:
        Froude-Krylov hypothesis, Wang 1996, eqs 7.10-7.18; the divergence theorem takes the place of his sums over the
        surface.
    """
    k = frequency[:, None, None] ** 2 / GRAVITY
    along, across = k * np.cos(heading), k * np.sin(heading)
    x, half = hull.x[:, None], hull.half_breadth
    weight = rho * GRAVITY * hull.area * np.exp(-k * hull.depth) * np.exp(-1j * along * x)
    push = 2j * np.sin(across * half)  # pressure on port less pressure on starboard
    turn = -2 * along * half**2 * spherical_jn(1, across * half)  # lever of the surge force: int y dp/dx dy
    return np.stack([(weight * push).sum((1, 2)), (weight * (x * push + turn)).sum((1, 2))])
