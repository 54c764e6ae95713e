"""The members of an ensemble, each sailing for itself: what they disagree about is what the data did not tell."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.network.series import Series


class Members(IdentifiedShip):
    """An identified ship whose batches hold every run once for each member: all runs of the first, then of the next.

    A state carries the number of its member. Without one (``acceleration``) nobody knows which member is meant, and the
    whole ensemble answers. Members may be several ensembles put one after the other: a run is then an ensemble's.
    """

    network: HullRudder | Series

    def __init__(self, model: IdentifiedShip, together: int = 1) -> None:
        """Take the members of a model's network.

        Args:
            model: Its network is an ensemble.
            together: Members whose median moves a row; as many follow each other in the network.
        """
        super().__init__(model.known, model.network, model.scaling, model.drive)
        self.together = together

    @property
    def count(self) -> int:
        """Number of members that answer, or of the ensembles that they are."""
        return (int(self.network.trained) or self.network.members) // self.together

    def on_approach(self, speed: float) -> "Members":
        """The model at another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return Members(super().on_approach(speed), self.together)

    @property
    def memory(self) -> int:
        """One: the number of the member that moves a row."""
        return 1

    def start(self, state: Float[Tensor, "*batch 6"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 7"]:
        """The state and the number of its member.

        Args:
            state: u, v, r, x, y, psi; as many rows for every member, or a single one for the first.
            delta: Angle of the rudder blade [rad].

        Returns:
            Whole states.
        """
        del delta
        rows = state[..., 0].numel()
        number = torch.arange(rows, device=state.device) // max(1, rows // self.count)
        return torch.cat([state, number.reshape(*state.shape[:-1], 1).to(state)], dim=-1)

    def forward(
        self,
        state: Float[Tensor, "*batch 7"],
        delta: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"] | None = None,
    ) -> Float[Tensor, "*batch 7"]:
        """Rate of the state, every row by its own member.

        Args:
            state: u, v, r, x, y, psi and the member's number.
            delta: Rudder angle [rad].
            time: Time since the start [s], for shaft speed and wind.

        Returns:
            Its time derivative.
        """
        known, nu, rows = self.known, state[..., :3], state[..., 6].round().long().flatten()
        inputs = self.network_inputs(state, delta, time)
        inputs = inputs.reshape(-1, inputs.shape[-1])
        if self.together > 1:
            inputs = inputs.repeat_interleave(self.together, 0)
            rows = (rows[:, None] * self.together + torch.arange(self.together, device=rows.device)).flatten()
        each = self.network.of(inputs, rows).view(-1, self.together, 3)
        force = each.quantile(0.5, dim=1) if self.together > 1 else each[:, 0]
        nudot = known.acceleration_from_force(nu, known.force(nu, delta) + self.scaling.restore(force.view(nu.shape)))
        return torch.cat([nudot, kinematics(state[..., :6]), torch.zeros_like(state[..., 6:])], dim=-1)


def has_members(dynamics: Dynamics) -> bool:
    """Whether a model is an ensemble.

    Args:
        dynamics: A model.

    Returns:
        True for an identified ship whose network has more than one trained member.
    """
    network = dynamics.network if isinstance(dynamics, IdentifiedShip) else None
    return isinstance(network, HullRudder | Series) and int(network.trained) > 1


def sail_members(model: IdentifiedShip, manoeuvres: Sequence[Manoeuvre]) -> list[list[Recording]]:
    """Every member through every manoeuvre, in one fixed-step batch.

    Args:
        model: The ensemble.
        manoeuvres: What is to be done.

    Returns:
        Members' runs by manoeuvre.
    """
    members = Members(model)
    runs = roll_out(members, [m for _ in range(members.count) for m in manoeuvres])
    return [runs[k :: len(manoeuvres)] for k in range(len(manoeuvres))]


def replay_members(model: IdentifiedShip, recordings: Sequence[Recording]) -> list[list[Recording]]:
    """Every member along every recording, driven by the recorded rudder.

    Args:
        model: The ensemble.
        recordings: What was recorded.

    Returns:
        Members' runs by recording.
    """
    members = Members(model)
    runs = replay(members, [r for _ in range(members.count) for r in recordings])
    return [runs[k :: len(recordings)] for k in range(len(recordings))]
