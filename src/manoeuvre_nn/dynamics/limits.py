"""The range of motion in which a manoeuvring model means anything."""

from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from manoeuvre_nn.core.particulars import Particulars

OK = "ok"
MIN_PRIME_SPEED = -0.5
"""Least u/U0 [-]: a ship that goes astern."""
MAX_PRIME_VELOCITIES = (2.5, 1.5, 3.0)
"""Largest u/U0, v/U0 and r L/U0 [-]; the tightest real circles have r L/U0 of 1 to 1.5."""


def inside_physical_range(state: Float[Tensor, "*batch n"], ship: Particulars) -> Bool[Tensor, "*batch"]:
    """Whether a state is one that a ship in a manoeuvre can be in.

    Forward speed from -.5 to 2.5 U0, sway up to 1.5 U0, yaw rate up to 3 U0/L (the tightest real circles have 1 to
    1.5); a number that is not finite is outside.

    Args:
        state: u, v, r, x, y, psi and whatever else moves.
        ship: The ship, for L and, as U0, the larger of its approach and service speed.

    Returns:
        True inside.
    """
    low, high = _limits(ship.top_speed, ship.length, state.dtype, state.device)
    nu = state[..., :3]
    return ((nu > low) & (nu < high)).all(-1)


@cache
@torch.inference_mode(False)
def _limits(
    speed: float, length: float, dtype: torch.dtype, device: torch.device
) -> tuple[Float[Tensor, " 3"], Float[Tensor, " 3"]]:
    """Least and largest u, v [m/s] and r [rad/s]: kept, for every step of every rollout asks for them."""
    units = torch.tensor([speed, speed, speed / length], dtype=dtype, device=device)
    high = units * torch.tensor(MAX_PRIME_VELOCITIES, dtype=dtype, device=device)
    return torch.cat([MIN_PRIME_SPEED * units[:1], -high[1:]]), high


def left_range(time: float) -> str:
    """Status of a run that was ended because it left the range at a time [s]."""
    return f"left the physical range at {time:.4g} s"
