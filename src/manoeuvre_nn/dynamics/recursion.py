"""Where a recursive network stands, step by step."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.frames import body_to_earth

MIN_SPEED = 0.05
"""Speed over U0 below which steps grow no longer."""


class Recursion(NamedTuple):
    """Where every row stands: the network's last outputs and what is kept of the past.

    Attributes:
        velocities: Last outputs, over U0 and U0/L.
        before: Those of one step before.
        angles: phi, theta, psi [rad], as far as the network has their rates.
        time: In L/U0.
        forces: Those of past steps, the latest first.
    """

    velocities: Float[Tensor, "rows freedom"]
    before: Float[Tensor, "rows freedom"]
    angles: Float[Tensor, "rows angles"]
    time: Float[Tensor, " rows"]
    forces: tuple[Float[Tensor, "rows columns"], ...]


class Unrolled(NamedTuple):
    """Runs in closed loop, the start first.

    Attributes:
        velocities: Over U0 and U0/L.
        angles: phi, theta, psi [rad], as far as the network has their rates.
        time: In L/U0.
        track: x and y over L.
    """

    velocities: Float[Tensor, "rows steps freedom"]
    angles: Float[Tensor, "rows steps angles"]
    time: Float[Tensor, "rows steps"]
    track: Float[Tensor, "rows steps 2"]


class RecordedSteps(NamedTuple):
    """Recorded runs at the steps of a network.

    Attributes:
        time: In L/U0; a run that is over goes on with its last sample.
        velocities: Over U0 and U0/L.
        angles: phi, theta, psi [rad].
        forces: By the force modules.
    """

    time: Float[Tensor, "rows steps"]
    velocities: Float[Tensor, "rows steps freedom"]
    angles: Float[Tensor, "rows steps angles"]
    forces: Float[Tensor, "rows steps columns"]

    def start(self, rows: Int[Tensor, " some"], steps: Int[Tensor, " some"], past: int) -> Recursion:
        """Where a network stands that takes over at a step; what was before the run is filled with its start.

        Args:
            rows: Runs.
            steps: Steps of these runs.
            past: Past values that are kept.

        Returns:
            As many rows.
        """
        before = [self.forces[rows, (steps - k).clamp(min=0)] for k in range(1, past + 1)]
        last = self.velocities[rows, (steps - 1).clamp(min=0)]
        at = rows, steps
        return Recursion(self.velocities[at], last, self.angles[at], self.time[at], tuple(before))


def track_of(
    velocities: Float[Tensor, "rows steps freedom"], psi: Float[Tensor, "rows steps"], time: Float[Tensor, "rows steps"]
) -> Float[Tensor, "rows steps 2"]:
    """Track from the origin by the trapezoidal rule; non-dimensional."""
    over_ground = torch.stack(body_to_earth(velocities[..., 0], velocities[..., 1], psi), dim=-1)
    passed = 0.5 * (over_ground[:, 1:] + over_ground[:, :-1]) * time.diff(dim=1)[..., None]
    return torch.cat([torch.zeros_like(over_ground[:, :1]), passed.cumsum(1)], dim=1)
