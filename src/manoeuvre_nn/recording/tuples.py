"""What a network learns from: (u, v, r, delta) -> the part of the forces that the known ship leaves unexplained."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship


@dataclass(frozen=True)
class Tuples:
    """Samples of the unknown forces.

    Attributes:
        inputs: u', v', r' in the known ship's prime system and delta [rad], shape (N, 4).
        targets: g1', g2', g3' in the same system, shape (N, 3).
        times: Time of each sample in its recording [s].
        index: Number of the recording that each sample is from.
    """

    inputs: Float[Tensor, "n 4"]
    targets: Float[Tensor, "n 3"]
    times: Float[Tensor, " n"]
    index: Int[Tensor, " n"]


def to_tuples(recordings: Sequence[Recording], known: Ship, start: float = 0.0, length: float | None = None) -> Tuples:
    """Form the unknown forces from recorded accelerations.

    ``g' = M' nudot' - f'_known(nu, delta)``

    Args:
        recordings: With udot, vdot, rdot.
        known: Inertia and whatever forces are taken as known.
        start: Time after each recording's first sample from which on it is used [s].
        length: How much of each recording is used [s]; None is all of it.

    Returns:
        All samples, recording after recording.

    Source:
        Wang 1996, eqs 4.30-4.35; Rajesh & Bhattacharyya 2009, eqs 10-12.
    """
    parts = []
    for index, record in enumerate(recordings):
        begin = record.time[0] + start
        part = record.between(begin, record.time[-1] if length is None else begin + length)
        nu, nudot, delta, time = (
            torch.as_tensor(values).to(known.inertia)
            for values in (part.stacked("u", "v", "r"), part.stacked(*ACCELERATION), part["delta"], part.time)
        )
        with torch.no_grad():
            targets = known.force_from_acceleration(nudot) - known.force(nu, delta)
        inputs = torch.cat([nu / known.get_buffer("velocity_units"), delta[:, None]], dim=-1)
        number = torch.full((len(part),), index, dtype=torch.long, device=targets.device)
        parts.append((inputs, targets, time, number))
    return Tuples(*(torch.cat(columns) for columns in zip(*parts, strict=True)))
