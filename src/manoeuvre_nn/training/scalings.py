"""Which shift and scale stand between prime variables and a network."""

import torch

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import Scaling
from manoeuvre_nn.recording.tuples import Tuples

KINDS = ("source", "centred", "standard")


def make_scaling(kind: str, known: Ship, tuples: Tuples) -> Scaling:
    """Choose the scaling of a network's inputs and outputs.

    ``source`` is that of the papers: u', v', r', delta as they are in the prime system (Wang: u/U0, v/U0, rL/U0, rad;
    Rajesh: BIS). ``centred`` takes the approach speed off u', so that every input is 0 on the straight course.
    ``standard`` subtracts the mean and divides by the standard deviation of the training tuples, outputs too.

    Args:
        kind: ``source``, ``centred`` or ``standard``.
        known: Known part, for its prime system and approach speed.
        tuples: Training tuples.

    Returns:
        The scaling.
    """
    check_choice("network.scaling", kind, list(KINDS))
    x, y = tuples.inputs, tuples.targets
    shift, scale, output = torch.zeros_like(x[0]), torch.ones_like(x[0]), torch.ones_like(y[0])
    if kind == "centred":
        shift[0] = known.particulars.speed / known.prime.speed
    if kind == "standard":
        # A channel that never moves keeps the scale 1: it says nothing either way.
        shift, scale, output = x.mean(0), _spread(x), _spread(y)
    return Scaling(shift, scale, output)


def _spread(values: torch.Tensor) -> torch.Tensor:
    spread = values.std(0)
    return torch.where(spread > 1e-12, spread, torch.ones_like(spread))
