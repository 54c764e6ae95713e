"""The members of an ensemble, each sailing for itself: what they disagree about is what the data did not tell."""

from collections.abc import Callable, Sequence
from typing import Any, TypeGuard

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, rate_of_state
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel


class Members(Model):
    """An identified ship whose batches hold every run once for each member: all runs of the first, then of the next.

    A state carries the number of its member. Members may be several ensembles put one after the other: a run is then an
    ensemble's.

    Attributes:
        model: The ship; its network is an ensemble.
        together: Members whose median moves a row; as many follow each other in the network.
    """

    def __init__(self, model: IdentifiedShip, together: int = 1) -> None:
        """Take the members of a model's network, which is an ensemble."""
        super().__init__()
        self.model, self.together = model, together

    @property
    def count(self) -> int:
        """Number of members that answer, or of the ensembles that they are."""
        network = self.model.network
        return (network.answering or network.members) // self.together

    @property
    def hull(self) -> Ship:
        """The known part."""
        return self.model.hull

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch 7"]:
        """The state and the number of its member: as many rows for every member, or a single one for the first."""
        rows = state[..., 0].numel()
        number = torch.arange(rows, device=state.device) // max(1, rows // self.count)
        return torch.cat([state, number.reshape(*state.shape[:-1], 1).to(state)], dim=-1)

    def forward(self, state: Float[Tensor, "*batch 7"], inputs: Inputs) -> Float[Tensor, "*batch 7"]:
        """Rate of the state, every row by its own member."""
        model, nu, rows = self.model, state[..., :3], state[..., 6].round().long().flatten()
        seen = model.network_inputs(state, inputs)
        seen = seen.reshape(-1, seen.shape[-1])
        if self.together > 1:
            seen = seen.repeat_interleave(self.together, 0)
            rows = (rows[:, None] * self.together + torch.arange(self.together, device=rows.device)).flatten()
        each = model.network.of(seen, rows).view(-1, self.together, 3)
        force = each.quantile(0.5, dim=1) if self.together > 1 else each[:, 0]
        nudot = model.accelerations(nu, inputs, force.view(nu.shape))
        return torch.cat([rate_of_state(state, nudot), torch.zeros_like(state[..., 6:])], dim=-1)

    def on_approach(self, speed: float) -> "Members":
        """The model at another approach speed."""
        return Members(self.model.on_approach(speed), self.together)


def has_members(model: Model | Vessel) -> TypeGuard[IdentifiedShip]:
    """Whether a model is an identified ship whose network has more than one trained member."""
    parts = () if isinstance(model, Vessel) else model.children()
    return any(isinstance(part, Network) and part.answering > 1 for part in parts)


def sail_members(model: IdentifiedShip, manoeuvres: Sequence[Manoeuvre]) -> list[list[Recording]]:
    """Every member through every manoeuvre in one fixed-step batch: members' runs by manoeuvre."""
    return _each_member(roll_out, model, manoeuvres)


def replay_members(model: IdentifiedShip, recordings: Sequence[Recording]) -> list[list[Recording]]:
    """Every member along every recording, driven by the recorded rudder: members' runs by recording."""
    return _each_member(replay, model, recordings)


def _each_member(
    run: Callable[[Model, list[Any]], list[Recording]], model: IdentifiedShip, items: Sequence[Any]
) -> list[list[Recording]]:
    """Every member through all items in one batch, by item."""
    members = Members(model)
    runs = run(members, [item for _ in range(members.count) for item in items])
    return [runs[k :: len(items)] for k in range(len(items))]
