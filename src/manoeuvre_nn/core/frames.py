"""Body and earth axes: x north, y east, psi clockwise from north; body x forward, y starboard."""

from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

Numbers = TypeVar("Numbers", np.ndarray, Tensor)


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
    return torch.stack([*body_to_earth(u, v, psi), r]).movedim(0, -1)


def body_to_earth(u: Numbers, v: Numbers, psi: Numbers) -> tuple[Numbers, Numbers]:
    """Components north and east of a vector given forward and to starboard, at heading ``psi`` [rad]."""
    cos, sin = _cos_and_sin(psi)
    return u * cos - v * sin, u * sin + v * cos


def body_to_earth_derivatives(
    u: Numbers, v: Numbers, psi: Numbers
) -> tuple[tuple[Numbers, Numbers, Numbers], tuple[Numbers, Numbers, Numbers]]:
    """Derivatives by u, v and psi of the components north and east of :func:`body_to_earth`."""
    cos, sin = _cos_and_sin(psi)
    return (cos, -sin, -u * sin - v * cos), (sin, cos, u * cos - v * sin)


def earth_to_body(north: Numbers, east: Numbers, psi: Numbers) -> tuple[Numbers, Numbers]:
    """Components forward and to starboard of a vector given north and east, at heading ``psi`` [rad]."""
    cos, sin = _cos_and_sin(psi)
    return north * cos + east * sin, east * cos - north * sin


def _cos_and_sin(angle: Numbers) -> tuple[Numbers, Numbers]:
    """Both of an angle [rad]."""
    library: Any = torch if isinstance(angle, Tensor) else np
    return library.cos(angle), library.sin(angle)
