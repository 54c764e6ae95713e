"""Which shift and scale stand between prime variables and a network."""

import torch

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.recording.tuples import Tuples

OF_RESPONSES = ("standard", "range", "none")
"""Scalings of a network that approximates a response."""
KINDS = ("source", "centred", "balanced", "standard", "mirrored", "speed", "approach")


def make_scaling(kind: str, known: Ship, tuples: Tuples) -> Scaling:
    """Choose the scaling of a network's inputs and outputs.

    ``source`` is that of the papers: u', v', r', delta as they are in the prime system (Wang: u/U0, v/U0, rL/U0, rad;
    Rajesh: BIS). ``centred`` takes the approach speed off u', so that every input is 0 on the straight course.
    ``balanced`` also divides g' by its root mean square, which steepest descent needs to get anywhere;
    Levenberg-Marquardt does not, and extrapolates better without (Mariner, zz35, 8 seeds, median dev on tc25: .05 L
    against .21 L).
    ``standard`` subtracts the mean of the training tuples from the inputs and divides inputs and g' by their standard
    deviation. ``mirrored`` does so with u' and g', and divides v', r', delta by their root mean square, so that 0
    stays amidships. ``speed`` divides u' by that of the approach and the others as ``mirrored`` does, so that ratios of
    speeds stay ratios. ``approach`` takes everything in the (rho, L, T, U0) system, whatever the known part's is: what
    coefficients of a series are in.

    Args:
        kind: One of :data:`KINDS`.
        known: Known part, for its prime system and approach speed.
        tuples: Training tuples.

    Returns:
        The scaling.
    """
    check_choice("network.scaling", kind, list(KINDS))
    if kind == "approach":
        return approach_scaling(known)
    x, y = tuples.inputs, tuples.targets
    shift, scale, output = torch.zeros_like(x[0]), torch.ones_like(x[0]), torch.ones_like(y[0])
    if kind in {"centred", "balanced"}:
        shift[0] = known.particulars.speed / known.prime.speed
    if kind == "balanced":
        output = _or_one(y.square().mean(0).sqrt())
    if kind == "standard":
        shift, scale, output = x.mean(0), _or_one(x.std(0)), _or_one(y.std(0))
    if kind in {"mirrored", "speed"}:
        scale, output = _or_one(x.square().mean(0).sqrt()), _or_one(y.std(0))
        scale[0] = known.particulars.speed / known.prime.speed
    if kind == "mirrored":
        shift[0], scale[0] = x[:, 0].mean(), _or_one(x[:, 0].std())
    return Scaling(shift, scale, output)


def approach_scaling(known: Ship) -> Scaling:
    """Velocities over U0 and forces over those of the (rho, L, T, U0) system, whatever that of the known part is."""
    unit, own, new = known.particulars.prime, known.prime, known.inertia.new_tensor
    speed, force, moment = unit.speed / own.speed, unit.force / own.force, unit.moment / own.moment
    return Scaling(new([0.0] * 4), new([speed, speed, speed, 1.0]), new([force, force, moment]))


def response_scaling(kind: str, features: torch.Tensor, targets: torch.Tensor) -> Scaling:
    """Choose the scaling of a network that approximates a response.

    ``standard`` takes the mean off and divides by the standard deviation, ``range`` takes every feature and the target
    to -1 .. 1, ``none`` leaves them in SI.

    Args:
        kind: One of :data:`OF_RESPONSES`.
        features: What the network sees of the learnt records, a row each.
        targets: What it should say, a row each.

    Returns:
        The scaling.
    """
    check_choice("network.scaling", kind, list(OF_RESPONSES))
    both = features, targets
    if kind == "none":
        shifts, sizes = [torch.zeros_like(z[0]) for z in both], [torch.ones_like(z[0]) for z in both]
    elif kind == "range":
        shifts = [0.5 * (z.amin(0) + z.amax(0)) for z in both]
        sizes = [_or_one(0.5 * (z.amax(0) - z.amin(0))) for z in both]
    else:
        shifts, sizes = [z.mean(0) for z in both], [_or_one(z.std(0)) for z in both]
    return Scaling(shifts[0], sizes[0], sizes[1], shifts[1])


def _or_one(size: torch.Tensor) -> torch.Tensor:
    """A channel that never moves keeps the scale 1: it says nothing either way."""
    return torch.where(size > 1e-12, size, torch.ones_like(size))
