"""Froude-Krylov forces: what the pressure of the undisturbed wave does to a hull, from its table of offsets."""

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import spherical_jn

from manoeuvre_nn.core.units import GRAVITY, SEA_WATER
from manoeuvre_nn.seakeeping.hull import Immersed


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
