"""Predictions driven by a recorded rudder: the model's own motion, the measured helm."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model, runge_kutta_step
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.recorded_inputs import held_columns, recorded_inputs, step_inputs
from manoeuvre_nn.dynamics.rollout import STEPS_PER_LENGTH
from manoeuvre_nn.dynamics.simulate import Solution, to_recordings
from manoeuvre_nn.dynamics.vessel import Vessel, as_vessel

STATE = ("u", "v", "r", "x", "y", "psi")
"""What a recording must say of the state at the start; a model's own states are taken where they were recorded."""


def replay(ship: Model | Vessel, recordings: Sequence[Recording], *, start: float = 0.0) -> list[Recording]:
    """Run a model from a recording's state with the recorded rudder, all recordings as one batch.

    Nothing but the rudder, and shaft speed and wind where the model has learnt of them, is taken from the recording
    after the start: u, v, r and the track are the model's own. The blade follows from ``delta`` of the recording,
    which is the indicated angle as it was written down, and ``delta_order``, without which the indicator stands for the
    order. Time counts from the first sample.

    Args:
        ship: The model or vessel.
        recordings: What was recorded.
        start: Time after the first sample at which the model takes over [s].

    Returns:
        One prediction a recording, sampled at the ship's usual interval; one that leaves the physical range ends there.

    Raises:
        InputError: If a recording is shorter than ``start``.
    """
    vessel = as_vessel(ship)
    own = vessel.model.driven(recordings, start)
    if own is not None:
        return own
    model, interval = vessel.model, vessel.model.particulars.sample_interval
    grids = []
    for record in recordings:
        if record.duration <= start + 2 * interval:
            raise InputError(f"recording {record.name} lasts {record.duration:g} s; nothing is left after {start:g} s")
        grids.append(np.arange(record.time[0] + start, record.time[-1] + 1e-9, interval))
    reference = next(b for b in model.buffers() if b.is_floating_point())
    pairs = list(zip(grids, recordings, strict=True))
    rudders = zip(*(_rudder(vessel, g, r, reference) for g, r in pairs), strict=True)
    helm = held_columns(dict(zip(("recorded", "shown", "order"), rudders, strict=True)))
    recorded, shown, order = (column.to(reference) for column in helm.values())
    first = reference.new_tensor(np.stack([_state(r, g[0], model.own_names) for g, r in pairs]))
    taken = held_columns(recorded_inputs(model, recordings, grids))
    with torch.no_grad():
        blade = blade_series(vessel, order, shown, interval)
        columns = {"delta": blade, **{name: column.to(reference) for name, column in taken.items()}}
        states = integrate(model, first, columns, interval=interval, start=start)
        lost = ~inside_physical_range(states, model.particulars)
    clock = start + interval * torch.arange(len(states), dtype=torch.float64)
    ended = torch.where(lost.any(0), clock[lost.int().argmax(0)], torch.inf)
    inputs = Inputs(**{name: c.T for name, c in columns.items()}, time=clock[:, None].to(blade).expand_as(blade.T))
    orders = [Manoeuvre(r.name, str(r.meta.get("kind", "")), ()) for r in recordings]
    solution = Solution(clock, states, shown.T, recorded.T, inputs, ended)
    made = to_recordings(vessel, orders, solution, [float(clock[len(g) - 1]) for g in grids])
    return [_as_recorded(run, r, g) for run, (g, r) in zip(made, pairs, strict=True)]


def _state(record: Recording, time: float, own: Sequence[str]) -> list[float]:
    """State at a time; NaN for an own state that was not recorded."""
    known = [name for name in own if name in record.channels]
    found = {name: float(np.interp(time, record.time, record[name])) for name in (*STATE, *known)}
    return [found.get(name, np.nan) for name in (*STATE, *own)]


def _as_recorded(run: Recording, record: Recording, grid: np.ndarray) -> Recording:
    """A prediction with the recording's times and the recorded rudder: a sensor's fault is in that already."""
    status = OK if run.status == OK else left_range(float(grid[len(run) - 1]))
    run = run.with_channels(delta=run["delta_order"])
    return replace(run, time=grid[: len(run)], status=status, meta=record.meta)


def _rudder(vessel: Vessel, times: np.ndarray, record: Recording, like: Tensor) -> tuple[np.ndarray, ...]:
    """Recorded angle, what the indicator showed, and the order in force at some times."""
    recorded = np.interp(times, record.time, record["delta"])
    clock = like.new_tensor(record.time - record.time[0])
    sound = record.ordered_rudder(vessel.model.particulars.rudder_rate)
    ordered = None if sound is None else like.new_tensor(sound)
    shown = vessel.gear.indicated(like.new_tensor(record["delta"]), ordered, clock).detach().cpu().numpy()
    shown = np.interp(times, record.time, shown)
    if "delta_order" not in record.channels:
        return recorded, shown, shown
    # An order is given at once: nothing lies between two of them.
    return recorded, shown, record["delta_order"][np.searchsorted(record.time, times + 1e-9, side="right") - 1]


def blade_series(
    vessel: Vessel, order: Float[Tensor, "rows times"], shown: Float[Tensor, "rows times"], interval: float
) -> Float[Tensor, "rows times"]:
    """Angle of the rudder blade, sample by sample; an order is taken to be given midway between two samples."""
    behind = [vessel.gear.at_rest(shown[:, 0])]
    half = torch.full_like(shown[:, 0], 0.5 * interval)
    for k in range(1, shown.shape[1]):
        middle = 0.5 * (shown[:, k - 1] + shown[:, k])
        midway = vessel.gear.after(behind[-1], order[:, k - 1], middle, half)
        behind.append(vessel.gear.after(midway, order[:, k], shown[:, k], half))
    return torch.stack([angles[:, -1] for angles in behind], dim=1)


def integrate(
    model: Model,
    first: Float[Tensor, "rows known"],
    columns: Mapping[str, Float[Tensor, "rows times"]],
    *,
    interval: float,
    start: float,
    largest_step: float | None = None,
) -> Float[Tensor, "times rows n"]:
    """States at all samples of recorded inputs, by :func:`.runge_kutta_step`.

    The recorded rudder has a kink at every sample: steps end there. One that may be longer takes the parabolas of
    :func:`.step_inputs` for the inputs, and a cubic spline leads through the states. A rate outside the physical range
    is zero, so that a lost row rests and stays finite.

    Args:
        model: The model.
        first: u, v, r, x, y, psi at the first sample, and the model's own states where they are known; NaN where not.
        columns: Name of an input -> its samples, linear in between.
        interval: Time between samples [s].
        start: Time of the first [s].
        largest_step: Largest step [s]; None takes that of rollouts, and none over several samples.

    Returns:
        Whole states.
    """
    ship, count = model.particulars, columns["delta"].shape[1]
    parts = ceil(interval / (largest_step or ship.time_unit / STEPS_PER_LENGTH) - 1e-9)
    ends = np.arange(parts * (count - 1) + 1) / parts
    span = int((largest_step or 0.0) / interval + 1e-9)
    if span > 1:
        ends = np.append(np.arange(0.0, count - 1, span), count - 1)

    def rate(state: Tensor, inputs: Inputs) -> Tensor:
        return torch.where(inside_physical_range(state, ship)[:, None], model(state, inputs), 0.0)

    now = Inputs(**{name: c[:, 0] for name, c in columns.items()}, time=torch.full_like(columns["delta"][:, 0], start))
    begin = model.start(first[:, :6], now)
    known = nn.functional.pad(first[:, 6:], (0, begin.shape[1] - first.shape[1]), value=torch.nan)
    states = [torch.cat([begin[:, :6], torch.where(known.isnan(), begin[:, 6:], known)], dim=-1)]
    steps = step_inputs(columns, ends, interval=interval, start=start)
    for inputs, length in zip(steps, np.diff(ends) * interval, strict=True):
        states.append(runge_kutta_step(rate, states[-1], inputs, first.new_tensor(length)))
    if span <= 1 or count <= 2:
        return torch.stack(states[::parts])
    return first.new_tensor(CubicSpline(ends, torch.stack(states).numpy())(np.arange(count)))
