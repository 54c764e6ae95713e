"""The accurate solution of one manoeuvre: torchdiffeq between events, heading crossings located."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torchdiffeq import odeint, odeint_event

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars, check_speed
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import MAX_PRIME_VELOCITIES, OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.vessel import RudderGear, Vessel, as_vessel

ROWS_AT_ONCE = 16
"""Rows that are turned into recordings at once: enough to share the overhead, few enough to stay in the cache."""


@dataclass(frozen=True)
class Solution:
    """Runs of a batch over the same times.

    Attributes:
        times: Sample times [s].
        states: u, v, r, x, y, psi and the model's own.
        shown: Rudder angle that the indicator shows [rad].
        orders: Rudder order [rad].
        inputs: Angle of the rudder blade [rad], shaft, wind and time.
        ended: Time at which a row left the physical range [s], from which on it means nothing; ``inf`` if it did not.
    """

    times: Float[Tensor, " times"]
    states: Float[Tensor, "times rows n"]
    shown: Float[Tensor, "times rows"]
    orders: Float[Tensor, "times rows"]
    inputs: Inputs
    ended: Float[Tensor, " rows"]

    def row(self, row: int) -> "Solution":
        """One of the runs."""
        return self.part(len(self.times), [row])

    def part(self, count: int, rows: list[int]) -> "Solution":
        """Some of the rows up to a sample."""
        states, shown, orders = (x[:count, rows] for x in (self.states, self.shown, self.orders))
        inputs = Inputs(**{name: values[:count, rows] for name, values in self.inputs.given.items()})
        return Solution(self.times[:count], states, shown, orders, inputs, self.ended[rows])


@dataclass(frozen=True)
class _Piece:
    """A time in which one smooth equation holds: the indicator moves evenly or rests, the blade follows."""

    start: float
    end: float
    rudder: float
    rate: float
    order: Tensor
    before: Tensor
    gear: RudderGear

    def shown(self, t: Tensor) -> Tensor:
        """Angle that the indicator shows [rad]."""
        return self.rudder + self.rate * (t - self.start)

    def behind(self, t: Tensor) -> Tensor:
        """Angles behind the indicator [rad]."""
        return self.gear.after(self.before, self.order, self.shown(t), t - self.start)


def on_approach(ship: Model | Vessel, manoeuvre: Manoeuvre) -> tuple[Vessel, Float[Tensor, " n"]]:
    """A ship as it comes into a manoeuvre.

    Args:
        ship: The model or vessel.
        manoeuvre: What the helmsman does.

    Returns:
        The vessel at the manoeuvre's approach speed, and its state: straight ahead at the origin, heading 0, rudder
        amidships.
    """
    speed, vessel = manoeuvre.speed, as_vessel(ship)
    if speed is not None and speed != vessel.model.particulars.speed:
        check_speed(vessel.model.particulars, speed)
        vessel = vessel.on_approach(speed)
    model = vessel.model
    reference = next(b for b in model.buffers() if b.is_floating_point())
    state = torch.zeros(6, dtype=reference.dtype)
    state[0] = model.particulars.speed
    return vessel, model.start(state, Inputs(vessel.gear.at_rest(state.new_zeros(()))[-1]))


def sample_times(ship: Particulars, manoeuvre: Manoeuvre, interval: float | None = None) -> Float[np.ndarray, " times"]:
    """Sample times of a manoeuvre that the ship can do.

    Args:
        ship: The ship at the manoeuvre's approach speed, from which the usual length of a trial follows.
        manoeuvre: What the helmsman does.
        interval: Time between samples [s]; None takes the ship's usual one.

    Returns:
        Times [s].
    """
    manoeuvre.check(ship)
    return np.arange(0.0, manoeuvre.duration_for(ship) + 1e-9, interval or ship.sample_interval)


def simulate(
    ship: Model | Vessel, manoeuvre: Manoeuvre, interval: float | None = None, *,
    rtol: float = 1e-8, atol: float = 1e-9,
) -> Recording:  # fmt: skip
    """Simulate one manoeuvre to a tolerance with torchdiffeq's Dormand-Prince method: the reference for all others.

    The rudder turns at its rate, which is solved exactly, so that integration goes piece by piece from kink to kink;
    the time at which the heading reaches a stage's limit is located by ``odeint_event``.

    Args:
        ship: The model or vessel that moves.
        manoeuvre: What the helmsman does.
        interval: Time between samples [s]; None takes the ship's usual one.
        rtol: Relative tolerance.
        atol: Absolute tolerance.

    Returns:
        Recording with u, v, r, x, y, psi, delta, delta_order and exact accelerations, with effects also what
        :func:`to_recordings` adds. A run that leaves the physical range ends there, and its status says when.
    """
    vessel, state = on_approach(ship, manoeuvre)
    times = sample_times(vessel.model.particulars, manoeuvre, interval)
    options = {"rtol": rtol, "atol": atol, "method": "dopri5"}
    with torch.no_grad():
        states, shown, blades, orders = _integrate(vessel, manoeuvre, state, times, options)
    outside = np.flatnonzero(~inside_physical_range(states, vessel.model.particulars).cpu().numpy())
    count = int(outside[0]) if len(outside) else len(states)
    ended = states.new_tensor([times[count] if count < len(times) else inf])
    clock = torch.as_tensor(times)
    inputs = Inputs(blades[:, None], time=clock[: len(blades), None].to(blades))
    solution = Solution(clock, states[:, None], shown[:, None], orders[:, None], inputs, ended)
    (made,) = to_recordings(vessel, [manoeuvre], solution)
    return made


def to_recordings(
    ship: Model | Vessel, manoeuvres: Sequence[Manoeuvre], solution: Solution, ends: Sequence[float] | None = None
) -> list[Recording]:
    """Put a solution into recordings, accelerations evaluated from the equations.

    With effects, u and v stay those through the water; x, y, psi, r and delta are as sensors write them, and vn, ve
    (over ground, north and east), u_log (log) and shaft (shaft speed over the nominal one) are added.

    Args:
        ship: The model or vessel that moved.
        manoeuvres: What was ordered, one a row.
        solution: The runs.
        ends: When each run is over [s]; None lets all go on to the last time.

    Returns:
        One recording a row, cut where it left the physical range, which its status says.
    """
    vessel, times = as_vessel(ship), solution.times.double().cpu().numpy()
    alike: dict[tuple[int, str], list[int]] = {}
    for row, ended in enumerate(solution.ended.tolist()):
        end = times[-1] if ends is None else ends[row]
        count = max(int(np.searchsorted(times, min(end + 1e-9, ended - 1e-9))), 2)
        alike.setdefault((count, OK if ended > end + 1e-9 else left_range(ended)), []).append(row)
    made: dict[int, Recording] = {}
    for (count, status), rows in alike.items():
        for some in range(0, len(rows), ROWS_AT_ONCE):
            part = rows[some : some + ROWS_AT_ONCE]
            channels = _channels(vessel, solution.part(count, part))
            for k, row in enumerate(part):
                own, m = {name: values[k] for name, values in channels.items()}, manoeuvres[row]
                meta = {"ship": vessel.model.particulars.name, "time_unit": vessel.model.particulars.time_unit}
                made[row] = Recording(m.name, times[:count], own, status, {**meta, "kind": m.kind, "manoeuvre": m})
    return [made[row] for row in range(len(manoeuvres))]


def _channels(vessel: Vessel, solution: Solution) -> dict[str, np.ndarray]:
    """What is written down of runs, a row each."""
    states, shown, orders = (x.transpose(0, 1) for x in (solution.states, solution.shown, solution.orders))
    inputs = Inputs(**{name: values.transpose(0, 1) for name, values in solution.inputs.given.items()})
    made = {name: states[..., k] for k, name in enumerate(("u", "v", "r", "x", "y", "psi"))}
    with torch.no_grad():
        rates = vessel.model(states, inputs)
        made |= {"delta": shown, "delta_order": orders}
        made |= dict(zip(ACCELERATION, rates[..., :3].unbind(-1), strict=True))
        made |= vessel.record(states, rates, shown, inputs)
    return {name: values.double().cpu().contiguous().numpy() for name, values in made.items()}


def _integrate(
    vessel: Vessel, manoeuvre: Manoeuvre, state: Tensor, times: np.ndarray, options: dict
) -> tuple[Tensor, ...]:
    """Walk through stages and pieces; states, indicated angles, blade angles and orders at the sample times."""
    ship, stages = vessel.model.particulars, list(manoeuvre.stages)
    stages[-1] = replace(stages[-1], heading=None, hold=None)  # the last order is held to the end
    now, rudder, course, began = 0.0, 0.0, float(state[5]), 0.0
    stage, amidships = stages.pop(0), state.new_zeros(())
    behind = vessel.gear.at_rest(amidships)
    states, rudders, blades, orders = [state], [amidships], [behind[-1]], [state.new_tensor(stage.order)]
    chunk = 3.0 * ship.time_unit  # headings are watched in short stretches, so that little is computed in vain
    while len(states) < len(times) and inside_physical_range(state, ship):
        limit = float(times[-1]) if stage.heading is None else min(now + chunk, float(times[-1]))
        piece = _next_piece(vessel, stage, now, began, rudder, behind, limit)
        samples = times[len(states) :]
        samples = samples[samples <= piece.end + 1e-9]
        solution, reached, state = _solve_piece(vessel.model, piece, stage, course, state, samples, options)
        samples = samples[: len(solution)]
        states += list(solution)
        rudders += [piece.shown(state.new_tensor(t)) for t in samples]
        blades += [piece.behind(state.new_tensor(t))[-1] for t in samples]
        orders += [piece.order] * len(samples)
        crossed = reached is not None
        now = piece.end if reached is None else reached
        at = torch.tensor(now, dtype=torch.float64)
        rudder, behind = float(piece.shown(at)), piece.behind(at)
        if abs(rudder - stage.order) < 1e-12:
            rudder = stage.order
        timed_out = stage.hold is not None and now >= began + stage.hold - 1e-9
        if (crossed or timed_out) and stages:
            stage, began = stages.pop(0), now
    return torch.stack(states), torch.stack(rudders), torch.stack(blades), torch.stack(orders)


def _next_piece(
    vessel: Vessel, stage: Stage, now: float, began: float, rudder: float, before: Tensor, limit: float
) -> _Piece:
    """The longest stretch from now on in which the rudder does one thing."""
    error, rate = stage.order - rudder, vessel.model.particulars.rudder_rate
    arrival = now + abs(error) / rate if error else inf
    time_out = began + stage.hold if stage.hold is not None else inf
    end = min(arrival, time_out if time_out > now + 1e-9 else inf, limit)
    moving = float(np.sign(error)) * rate if error else 0.0
    return _Piece(now, end, rudder, moving, before.new_tensor(stage.order), before, vessel.gear)


def _solve_piece(
    model: Model,
    piece: _Piece,
    stage: Stage,
    course: float,
    state: Tensor,
    samples: np.ndarray,
    options: dict,
) -> tuple[Tensor, float | None, Tensor]:
    """Integrate one piece; states at the samples in it, time of the heading crossing if there is one, final state."""
    ship = model.particulars
    limits = torch.tensor(MAX_PRIME_VELOCITIES, dtype=state.dtype)
    far = 2 * limits * state.new_tensor([1.0, 1.0, 1 / ship.length]) * ship.top_speed
    steepest = 1e4 * ship.top_speed / ship.time_unit

    def rate(t: Tensor, y: Tensor) -> Tensor:
        # A run that breaks down rests far outside the range: else its steps shrink without end before it is looked at.
        if not bool((y[:3].abs() <= far).all()):
            return torch.zeros_like(y)
        # Rates beyond all sense, or not numbers, throw it out there at once: the solver gives up on them.
        return torch.nan_to_num(model(y, Inputs(piece.behind(t)[-1], time=t)), nan=steepest).clamp(-steepest, steepest)

    grid = np.unique(np.concatenate([[piece.start], samples, [piece.end]]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-9])]
    path = odeint(rate, state, state.new_tensor(grid, dtype=torch.float64), **options)
    at = np.searchsorted(grid, samples - 1e-9)
    if stage.heading is None:
        return path[at], None, path[-1]
    beyond = _beyond(stage, course)
    hits = np.flatnonzero([beyond(y) >= 0 for y in path[1:]])
    if not hits.size:
        return path[at], None, path[-1]
    first = int(hits[0])
    reached, state = _locate(rate, beyond, path[first], grid[first], grid[first + 1], options)
    return path[at][: int(np.sum(samples <= reached))], reached, state


def _beyond(stage: Stage, course: float) -> Callable[[Tensor], Tensor]:
    """How far the heading is past the stage's limit [rad]."""
    assert stage.heading is not None
    limit, direction = course + stage.heading, stage.direction
    return lambda y: direction * (y[..., 5] - limit)


def _locate(
    rate: Callable, beyond: Callable[[Tensor], Tensor], state: Tensor, start: float, end: float, options: dict
) -> tuple[float, Tensor]:
    """Time and state of the crossing between two samples; at once if the limit is already passed."""
    if beyond(state) >= 0:
        return start, state

    def event(t: Tensor, y: Tensor) -> Tensor:
        return torch.stack([beyond(y), t - end - 1.0])  # the second element bounds the search

    begin = torch.tensor(start, dtype=torch.float64)
    time, path = odeint_event(rate, state, begin, event_fn=event, **options)
    return float(time), path[-1]
