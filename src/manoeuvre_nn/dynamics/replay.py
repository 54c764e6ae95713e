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
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.rollout import STEPS_PER_LENGTH
from manoeuvre_nn.dynamics.simulate import to_recording

STATE = ("u", "v", "r", "x", "y", "psi")


def replay(dynamics: Dynamics, recordings: Sequence[Recording], *, start: float = 0.0) -> list[Recording]:
    """Run a model from a recording's state with the recorded rudder, all recordings as one batch.

    Nothing but the rudder, and shaft speed and wind where the model has learnt of them, is taken from the recording
    after the start: u, v, r and the track are the model's own.
    Solved by torchdiffeq's fixed-step fourth-order method, the rudder blade linear between samples. The blade follows
    from ``delta`` of the recording, which is the indicated angle as it was written down, and ``delta_order``, without
    which the indicator stands for the order. Time counts from the first sample.

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
    pairs = list(zip(grids, recordings, strict=True))
    wheels = [_wheel(dynamics, g, r, reference) for g, r in pairs]
    recorded, shown, order = (
        reference.new_tensor(np.stack([_padded(w[k], longest) for w in wheels])) for k in range(3)
    )
    first = reference.new_tensor(np.stack([[np.interp(g[0], r.time, r[k]) for k in STATE] for g, r in pairs]))
    dynamics = dynamics.driven(recordings, grids)
    with torch.no_grad():
        blade = blade_series(dynamics, order, shown, interval)
        states = integrate(dynamics, dynamics.start(first, blade[:, 0]), blade, start, interval)
    return [
        _prediction(
            dynamics.row(row), r, g, start, states[: len(g), row], *(x[row, : len(g)] for x in (recorded, shown, blade))
        )
        for row, (g, r) in enumerate(pairs)
    ]


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    """Values held at the last one up to a length."""
    return np.concatenate([values, np.full(length - len(values), values[-1])])


def _wheel(dynamics: Dynamics, times: np.ndarray, record: Recording, like: Tensor) -> tuple[np.ndarray, ...]:
    """Recorded angle, what the indicator showed, and the order in force at some times."""
    recorded = np.interp(times, record.time, record["delta"])
    clock = like.new_tensor(record.time - record.time[0])
    shown = dynamics.indicated(like.new_tensor(record["delta"]), clock).detach().cpu().numpy()
    shown = np.interp(times, record.time, shown)
    if "delta_order" not in record.channels:
        return recorded, shown, shown
    # An order is given at once: nothing lies between two of them.
    return recorded, shown, record["delta_order"][np.searchsorted(record.time, times + 1e-9, side="right") - 1]


def blade_series(
    dynamics: Dynamics, order: Float[Tensor, "rows times"], shown: Float[Tensor, "rows times"], interval: float
) -> Float[Tensor, "rows times"]:
    """Angle of the rudder blade, sample by sample; an order is taken to be given midway between two samples."""
    behind = [dynamics.blade_at_rest(shown[:, 0])]
    half = torch.full_like(shown[:, 0], 0.5 * interval)
    for k in range(1, shown.shape[1]):
        middle = 0.5 * (shown[:, k - 1] + shown[:, k])
        midway = dynamics.blade(behind[-1], order[:, k - 1], middle, half)
        behind.append(dynamics.blade(midway, order[:, k], shown[:, k], half))
    return torch.stack([angles[:, -1] for angles in behind], dim=1)


def integrate(
    dynamics: Dynamics,
    first: Float[Tensor, "rows n"],
    rudder: Float[Tensor, "rows times"],
    start: float,
    interval: float,
) -> Float[Tensor, "times rows n"]:
    """States at all samples; a rate outside the physical range is zero, so that a lost row rests and stays finite."""
    ship, last = dynamics.particulars, rudder.shape[1] - 1
    times = interval * torch.arange(last + 1, dtype=torch.float64)

    def rate(t: Tensor, state: Tensor) -> Tensor:
        place = min(float(t) / interval, last)
        k = min(int(place), last - 1)
        delta = rudder[:, k] + (place - k) * (rudder[:, k + 1] - rudder[:, k])
        time = torch.full_like(delta, start + float(t))
        return torch.where(inside_physical_range(state, ship)[:, None], dynamics(state, delta, time), 0.0)

    step = min(interval, ship.time_unit / STEPS_PER_LENGTH)
    return odeint(rate, first, times.to(first), method="rk4", options={"step_size": step})


def _prediction(
    dynamics: Dynamics,
    record: Recording,
    grid: np.ndarray,
    start: float,
    states: Tensor,
    recorded: Tensor,
    shown: Tensor,
    blade: Tensor,
) -> Recording:
    """One row as a recording with the recorded rudder, cut where it left the physical range."""
    inside = inside_physical_range(states, dynamics.particulars).cpu().numpy()
    end = len(grid) if inside.all() else max(int(np.argmin(inside)), 2)
    status = OK if inside.all() else left_range(float(grid[end - 1]))
    order = Manoeuvre(record.name, str(record.meta.get("kind", "")), ())
    clock = grid[:end] - grid[0] + start
    made = to_recording(dynamics, order, clock, states[:end], shown[:end], recorded[:end], status, blades=blade[:end])
    # The rudder was written down before: a sensor's fault is in it already.
    made = made.with_channels(delta=made["delta_order"])
    return replace(made, time=grid[:end], meta=record.meta)
