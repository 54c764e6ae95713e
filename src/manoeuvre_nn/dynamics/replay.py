"""Predictions driven by a recorded rudder: the model's own motion, the measured helm."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torchdiffeq import odeint

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.model import Dynamics
from manoeuvre_nn.dynamics.rollout import STEPS_PER_LENGTH
from manoeuvre_nn.dynamics.simulate import to_recording

STATE = ("u", "v", "r", "x", "y", "psi")


def replay(dynamics: Dynamics, recordings: Sequence[Recording], *, start: float = 0.0) -> list[Recording]:
    """Run a model from a recording's state with the recorded rudder, all recordings as one batch.

    Nothing but the rudder is taken from the recording after the start: u, v, r and the track are the model's own.
    Solved by torchdiffeq's fixed-step fourth-order method, the rudder linear between samples.

    Args:
        dynamics: The ship or network.
        recordings: What was recorded.
        start: Time after the first sample at which the model takes over [s].

    Returns:
        One prediction a recording, sampled at the ship's usual interval; one that leaves the physical range ends there.

    Raises:
        InputError: If a recording is shorter than ``start``.
    """
    ship = dynamics.particulars
    interval = ship.sample_interval
    grids = []
    for record in recordings:
        if record.duration <= start + 2 * interval:
            raise InputError(f"recording {record.name} lasts {record.duration:g} s; nothing is left after {start:g} s")
        grids.append(np.arange(record.time[0] + start, record.time[-1] + 1e-9, interval))
    reference = next(b for b in dynamics.buffers() if b.is_floating_point())
    longest = max(len(g) for g in grids)
    rudder = reference.new_tensor(
        np.stack([_padded(np.interp(g, r.time, r["delta"]), longest) for g, r in zip(grids, recordings, strict=True)])
    )
    first = reference.new_tensor(
        np.stack([[np.interp(g[0], r.time, r[k]) for k in STATE] for g, r in zip(grids, recordings, strict=True)])
    )
    states = _integrate(dynamics, first, rudder, interval)
    return [
        _prediction(dynamics, record, grid, states[: len(grid), row], rudder[row, : len(grid)])
        for row, (record, grid) in enumerate(zip(recordings, grids, strict=True))
    ]


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    """Values held at the last one up to a length."""
    return np.concatenate([values, np.full(length - len(values), values[-1])])


def _integrate(
    dynamics: Dynamics, first: Float[Tensor, "rows 6"], rudder: Float[Tensor, "rows times"], interval: float
) -> Float[Tensor, "times rows 6"]:
    """States at all samples; a rate outside the physical range is zero, so that a lost row rests and stays finite."""
    ship, last = dynamics.particulars, rudder.shape[1] - 1
    times = interval * torch.arange(last + 1, dtype=torch.float64)

    def rate(t: Tensor, state: Tensor) -> Tensor:
        place = min(float(t) / interval, last)
        k = min(int(place), last - 1)
        delta = rudder[:, k] + (place - k) * (rudder[:, k + 1] - rudder[:, k])
        return torch.where(inside_physical_range(state, ship)[:, None], dynamics(state, delta), 0.0)

    step = min(interval, ship.time_unit / STEPS_PER_LENGTH)
    with torch.no_grad():
        return odeint(rate, first, times.to(first), method="rk4", options={"step_size": step})


def _prediction(dynamics: Dynamics, record: Recording, grid: np.ndarray, states: Tensor, rudder: Tensor) -> Recording:
    """One row as a recording, cut where it left the physical range."""
    inside = inside_physical_range(states, dynamics.particulars).cpu().numpy()
    end = len(grid) if inside.all() else max(int(np.argmin(inside)), 2)
    status = OK if inside.all() else left_range(float(grid[end - 1]))
    order = Manoeuvre(record.name, str(record.meta.get("kind", "")), ())
    made = to_recording(dynamics, order, grid[:end], states[:end], rudder[:end], rudder[:end], status)
    return replace(made, meta=record.meta)
