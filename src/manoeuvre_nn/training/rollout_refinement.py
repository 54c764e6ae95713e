"""Closed-loop refinement: linear weights moved so that the model, sailed, stays with the recordings.

Fits to accelerations trust derivatives of what was measured; noise ruins them first. What a recording says without a
derivative is where the ship was and how fast: here a member is replayed with the recorded rudder through stretches of
the recordings, and its linear weights take Gauss-Newton steps that lower the misfit of u, v, r and the heading. No
library does this for ensembles of ships: all perturbed copies of a member are rows of one batched replay.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Factor, Weight
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.members import replay_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder

CHANNELS = ("u", "v", "r", "psi")
RELATIVE_STEP = 1e-4
"""Step of a difference quotient over the size at which a column alone would make an output of unit variance [-]."""


@dataclass(frozen=True)
class Refinement:
    """How a member is refined.

    Attributes:
        steps: Steps that are tried; 0 leaves the member as it is.
        stretch: Length of a stretch in L/U0 [-]: short ones say little, long ones of an unstable ship say anything.
        pull: Weight of staying with the fit to accelerations, a share of the largest curvature [-].
    """

    steps: int = 0
    stretch: Factor = 10.0
    pull: Weight = 1e-6

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range.
        """
        if self.steps < 0 or self.stretch < 2 or self.pull < 0:
            raise InputError(
                f"fit.refine with steps={self.steps}, stretch={self.stretch:g}, pull={self.pull:g}: expected steps and "
                "pull of 0 or more, a stretch of at least 2 ship lengths"
            )


@torch.no_grad()
def refine(
    model: IdentifiedShip, member: int, recordings: Sequence[Recording], inputs: Float[Tensor, "n 4"], how: Refinement
) -> tuple[Float[Tensor, "3 c"], list[float]]:
    """Move a member's linear weights.

    Args:
        model: Known part, ensemble and scaling.
        member: Which one.
        recordings: What was trained on: u, v, r, x, y, psi and the rudder.
        inputs: Scaled inputs of the training tuples, which say how large a column is.
        how: How far.

    Returns:
        The weights, and the mean square misfit (over the variance of the channels) before and after each step taken.
    """
    network = model.network
    assert isinstance(network, HullRudder)
    parts = stretches(recordings, how.stretch * model.particulars.time_unit)
    best = network.output_weights[member].clone()
    scale = _column_sizes(network, member, inputs).expand_as(best).flatten()
    free = (scale > 0).nonzero()[:, 0]
    steps = RELATIVE_STEP / scale[free]
    home, mu = best.flatten()[free].clone(), how.pull
    history: list[float] = []
    for _ in range(how.steps):
        trials = best.flatten().repeat(len(free) + 1, 1)
        trials[torch.arange(len(free)) + 1, free] += steps
        misfit = _misfits(model, member, trials.view(-1, *best.shape), parts)
        if not history:
            history.append(float(misfit[0].square().mean()))
        jacobian = (misfit[1:] - misfit[0]).T / RELATIVE_STEP
        away = (best.flatten()[free] - home) * scale[free]
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ misfit[0]
        size = normal.diagonal().max()
        damped = normal + (mu + how.pull) * size * torch.eye(len(free), dtype=normal.dtype)
        move = -torch.linalg.solve(damped, gradient + how.pull * size * away) / scale[free]
        tried = best.flatten().clone()
        tried[free] += move
        error = float(_misfits(model, member, tried.view(1, *best.shape), parts).square().mean())
        if error < history[-1]:
            best, mu = tried.view_as(best), mu / 5
            history.append(error)
        else:
            mu *= 25
    return best, history


def stretches(recordings: Sequence[Recording], length: float) -> list[Recording]:
    """Recordings cut into pieces of even length [s]; one that is shorter is a piece itself."""
    pieces = []
    for r in recordings:
        edges = np.linspace(r.time[0], r.time[-1], max(1, round(r.duration / length)) + 1)
        pieces += [r.between(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return pieces


def _column_sizes(network: HullRudder, member: int, inputs: Tensor) -> Float[Tensor, "3 c"]:
    """Root mean square of every column of a member's outputs; 0 for one that is none."""
    return torch.stack([columns.square().mean(1).sqrt() for columns in network.columns(inputs, member)])


def _misfits(
    model: IdentifiedShip, member: int, weights: Float[Tensor, "k 3 c"], parts: Sequence[Recording]
) -> Float[Tensor, "k m"]:
    """Replayed minus recorded channels over their standard deviation, a row for each set of weights."""
    network = model.network
    assert isinstance(network, HullRudder)
    copies = network.with_weights(network.input_weights[member].expand(len(weights), -1, -1), weights)
    runs = replay_members(IdentifiedShip(model.known, copies, model.scaling), parts)
    size = {c: float(np.concatenate([p[c] for p in parts]).std()) or 1.0 for c in CHANNELS}
    rows = []
    for row in range(len(weights)):
        errors = []
        for part, members in zip(parts, runs, strict=True):
            run = members[row]
            # A run that broke down rests: its misfit stays finite, and large.
            ahead = [np.interp(part.time, run.time, run[c]) - part[c] for c in CHANNELS]
            lost = 1.0 if run.status == OK else 10.0
            errors += [lost * a / size[c] for a, c in zip(ahead, CHANNELS, strict=True)]
        rows.append(np.concatenate(errors))
    return torch.as_tensor(np.stack(rows))
