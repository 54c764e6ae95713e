"""A force that no formula gives: what a small network makes of the motion and the heading."""

from math import sqrt
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.effect.common import in_tight_turns, typical

INPUTS = ("u", "v", "r", "delta", "cos_psi", "sin_psi")
"""What the network sees: the motion in units of a tight turn, and the heading as harmonics."""
HIDDEN = 5
"""Nodes of its hidden layer."""
SPREAD_OUT = 0.1 / sqrt(HIDDEN)
"""Prior spread of the outgoing weights: together a tenth of the force of 20 deg of rudder."""


def _declared() -> tuple[Parameter, ...]:
    """Weights of the hidden layer, from fixed random starts, then the outgoing ones."""
    # Hidden nodes that start alike would stay alike.
    starts = torch.randn(HIDDEN, len(INPUTS) + 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    names = (*INPUTS, "bias")
    into = [
        Parameter(f"w{j}_{name}", "-", -8.0, 8.0, None, 1.0, (float(starts[j, k]),), heavy_tailed=False)
        for j in range(HIDDEN)
        for k, name in enumerate(names)
    ]
    out = [
        Parameter(f"{e}{j}", "-", -3.0, 3.0, 0.0, SPREAD_OUT, (0.0,), heavy_tailed=False)
        for e in "XYN"
        for j in range(HIDDEN)
    ]
    return (*into, *out)


class Remainder(Effect):
    """Accelerations ``a_i = A_i sum_j w_ij tanh(b_j + sum_k w_jk z_k)`` of motion and heading.

    ``A`` is what the resistance does in surge and 20 deg of rudder in sway and yaw. It names nothing: it stands for
    what a diagnosis cannot name, or for what a named effect leaves.
    """

    name = "remainder"
    fittable = False
    site = "force"
    family = "remainder"
    label = "a smooth force without a name"
    equations = ("X", "Y", "N")
    fingerprint = "A force that the motion and the heading decide, and that no effect of the shelf has."
    source = "A perceptron with one hidden layer; nothing physical"
    declared: ClassVar[tuple[Parameter, ...]] = _declared()

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Take weights; those not given are the starts, which add nothing."""
        super().__init__(ship, **values)
        self.register_buffer("size", typical(ship))

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """What the network adds."""
        count = HIDDEN * (len(INPUTS) + 1)
        into = self.values[..., :count].unflatten(-1, (HIDDEN, len(INPUTS) + 1))
        out = self.values[..., count:].unflatten(-1, (3, HIDDEN))
        hidden = torch.tanh((into[..., :-1] @ self._inputs(s)[..., None])[..., 0] + into[..., -1])
        return self.get_buffer("size") * (out @ hidden[..., None])[..., 0]

    def _inputs(self, s: Situation) -> Float[Tensor, "*batch inputs"]:
        """Motion in units of a tight turn, and harmonics of the heading."""
        heading = [torch.cos(s.psi), torch.sin(s.psi)]
        return torch.stack(torch.broadcast_tensors(*in_tight_turns(self.ship, s).values(), *heading), dim=-1)
