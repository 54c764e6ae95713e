"""Heave and pitch of a ship taken as a box, in closed form."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.form import HullForm


def box_motions(
    form: HullForm,
    frequency: Float[np.ndarray, " waves"],
    draught: Float[np.ndarray, " n"],
    speed: Float[np.ndarray, " n"],
    heading: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n waves 2"]:
    """Amplitudes of heave and pitch in regular waves of 1 m amplitude.

    With k = w^2/g, the box's breadth b = C_B B and a = w_e/w = 1 - w U cos(heading)/g::

        2 k T/w^2 x'' + A^2/(k b a^3 w) x' + x = (F, G) cos, sin(w_e t)
        A = 2 sin(k b a^2/2) e^(-k T a^2)        f^2 = (1 - k T)^2 + (A^2/(k b a^3))^2
        F = e^(-k_e T) f 2/(k_e L) sin(k_e L/2)  with k_e = |k cos(heading)|
        G = e^(-k_e T) f 24/((k_e L)^2 L) (sin(k_e L/2) - k_e L/2 cos(k_e L/2))

    Both are uncoupled, with the natural frequency sqrt(g/(2 T)).

    Args:
        form: Length, breadth and block coefficient.
        frequency: Wave frequencies [rad/s].
        draught: Draughts T [m].
        speed: Speeds U [m/s].
        heading: Direction that the waves run to, off the bow [rad]: 0 following, pi head sea.

    Returns:
        Heave [m/m] and pitch [rad/m].

    Source:
        Jensen, Mansour & Olsen 2004, "Estimation of ship motions using closed-form expressions", Ocean Engineering 31.
    """
    k, box = frequency**2 / GRAVITY, form.block * form.breadth
    across, depth = np.cos(heading)[:, None], k * draught[:, None]
    a = 1 - frequency * speed[:, None] / GRAVITY * across
    radiated = 2 * np.sin(k * box * a**2 / 2) * np.exp(-depth * a**2)
    # A^2 falls off as a^4: damping is 0 where the waves keep up with the ship (a = 0)
    moving = np.where(np.abs(a) < 1e-6, 1.0, a)
    damping = np.where(np.abs(a) < 1e-6, 0.0, radiated**2 / (k * box * moving**3))
    half = np.maximum(k * np.abs(across) * form.length / 2, 1e-9)  # k_e L/2
    push = np.exp(-2 * half * draught[:, None] / form.length) * np.hypot(1 - depth, damping)
    # sin s - s cos s = s^3/3 for small s, where the difference would be noise
    lever = np.where(half < 1e-2, half / 3, (np.sin(half) - half * np.cos(half)) / half**2)
    amplitudes = push[..., None] * np.stack([np.sin(half) / half, 6 * lever / form.length], axis=-1)
    resonance = np.hypot(1 - 2 * depth * a**2, damping * a)
    return np.abs(amplitudes) / resonance[..., None]
