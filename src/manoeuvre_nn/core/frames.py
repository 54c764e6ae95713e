"""Body and earth axes: x north, y east, psi clockwise from north; body x forward, y starboard."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor


def kinematics(state: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3"]:
    """Rates of position and heading from the velocities in body axes.

    ``xdot = u cos psi - v sin psi``, ``ydot = u sin psi + v cos psi``, ``psidot = r``.

    Args:
        state: u, v [m/s], r [rad/s], x, y [m], psi [rad] in the last dimension.

    Returns:
        xdot, ydot [m/s], psidot [rad/s].

    Source:
        Wang 1996, eqs 3.12-3.14 (there as sums over time steps).
    """
    u, v, r, _, _, psi = state.unbind(-1)
    cos, sin = torch.cos(psi), torch.sin(psi)
    return torch.stack([u * cos - v * sin, u * sin + v * cos, r]).movedim(0, -1)


def body_to_earth(
    u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"], psi: Float[np.ndarray, "*n"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Components north and east of a vector given forward and to starboard, at heading ``psi`` [rad]."""
    return u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)


def earth_to_body(
    north: Float[np.ndarray, "*n"], east: Float[np.ndarray, "*n"], psi: Float[np.ndarray, "*n"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Components forward and to starboard of a vector given north and east, at heading ``psi`` [rad]."""
    return north * np.cos(psi) + east * np.sin(psi), -north * np.sin(psi) + east * np.cos(psi)
