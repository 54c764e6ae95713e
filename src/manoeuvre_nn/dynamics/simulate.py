"""The accurate solution of one manoeuvre: torchdiffeq between events, heading crossings located."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torchdiffeq import odeint, odeint_event

from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import ACCELERATION, Recording
from manoeuvre_nn.core.ship import check_speed
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.helm import Blade
from manoeuvre_nn.dynamics.limits import LARGEST, OK, inside_physical_range, left_range


@dataclass(frozen=True)
class Problem:
    """What is to be simulated: no solving in it.

    Attributes:
        dynamics: The ship that moves.
        manoeuvre: What the helmsman does.
        interval: Time between samples [s]; None takes the ship's usual one.
    """

    dynamics: Dynamics
    manoeuvre: Manoeuvre
    interval: float | None = None

    def on_approach(self) -> tuple[Dynamics, Float[Tensor, " n"], Float[np.ndarray, " times"]]:
        """The ship at the manoeuvre's approach speed.

        Returns:
            Dynamics, initial state (straight ahead at the origin, heading 0, rudder amidships) and sample times [s].
        """
        speed, ship, dynamics = self.manoeuvre.speed, self.dynamics.particulars, self.dynamics
        if speed is not None and speed != ship.speed:
            check_speed(ship, speed)
            dynamics = dynamics.on_approach(speed)
        # Particulars after on_approach: the usual length of a trial follows from the approach speed.
        times, ship = replace(self, dynamics=dynamics).times(), dynamics.particulars
        reference = next(b for b in dynamics.buffers() if b.is_floating_point())
        state = torch.zeros(6, dtype=reference.dtype)
        state[0] = ship.speed
        state = dynamics.start(state, dynamics.blade_at_rest(state.new_zeros(()))[-1])
        return dynamics, state, times

    def times(self) -> Float[np.ndarray, " times"]:
        """Sample times of a manoeuvre that the ship can do, the ship being at its approach speed already.

        Returns:
            Times [s].
        """
        ship = self.dynamics.particulars
        self.manoeuvre.check(ship)
        return np.arange(0.0, self.manoeuvre.duration_for(ship) + 1e-9, self.interval or ship.sample_interval)


@dataclass(frozen=True)
class _Piece:
    """A time in which one smooth equation holds: the indicator moves evenly or rests, the blade follows."""

    start: float
    end: float
    rudder: float
    rate: float
    order: Tensor
    before: Tensor
    blade: Blade

    def shown(self, t: Tensor) -> Tensor:
        return self.rudder + self.rate * (t - self.start)

    def behind(self, t: Tensor) -> Tensor:
        return self.blade(self.before, self.order, self.shown(t), t - self.start)


def simulate(problem: Problem, *, rtol: float = 1e-8, atol: float = 1e-9) -> Recording:
    """Simulate one manoeuvre with torchdiffeq's Dormand-Prince method.

    The rudder turns at its rate, which is solved exactly, so that integration goes piece by piece from kink to kink;
    the time at which the heading reaches a stage's limit is located by ``odeint_event``.

    Args:
        problem: Ship and manoeuvre.
        rtol: Relative tolerance.
        atol: Absolute tolerance.

    Returns:
        Recording with u, v, r, x, y, psi, delta, delta_order and exact accelerations, with effects also what
        :func:`to_recording` adds. A run that leaves the physical range ends there, and its status says when.
    """
    dynamics, state, times = problem.on_approach()
    options = {"rtol": rtol, "atol": atol, "method": "dopri5"}
    with torch.no_grad():
        states, rudders, blades, orders = _integrate(dynamics, problem.manoeuvre, state, times, options)
        inside = inside_physical_range(states, dynamics.particulars).cpu().numpy()
    end, status, trial = len(times), OK, problem.manoeuvre
    if not inside.all() or len(inside) < len(times):
        end = max(int(np.argmin(inside)) if not inside.all() else len(inside), 2)
        status = left_range(float(times[min(end, len(times) - 1)]))
    states, rudders, blades, orders = states[:end], rudders[:end], blades[:end], orders[:end]
    return to_recording(dynamics, trial, times[:end], states, rudders, orders, status, blades=blades)


def to_recording(
    dynamics: Dynamics,
    manoeuvre: Manoeuvre,
    times: Float[np.ndarray, " n"],
    states: Float[Tensor, "n k"],
    rudders: Float[Tensor, " n"],
    orders: Float[Tensor, " n"],
    status: str,
    *,
    blades: Float[Tensor, " n"] | None = None,
) -> Recording:
    """Put a solution into a recording, accelerations evaluated from the equations.

    With effects, u and v stay those through the water; x, y, psi, r and delta are as sensors write them, and vn, ve
    (over ground, north and east), u_log (log) and shaft (shaft speed over the nominal one) are added.

    Args:
        dynamics: The ship that moved.
        manoeuvre: What was ordered.
        times: Sample times [s].
        states: u, v, r, x, y, psi and the model's own.
        rudders: Rudder angle that the indicator shows [rad].
        orders: Rudder order [rad].
        status: ``ok`` or why it was ended.
        blades: Angle of the rudder blade [rad]; None is the indicated one.

    Returns:
        The recording.
    """
    blades = rudders if blades is None else blades
    solution = [x[None] for x in (states, rudders, orders, blades)]
    (made,) = to_recordings(dynamics, [manoeuvre], times, *solution, status=status)
    return made


def to_recordings(
    dynamics: Dynamics,
    manoeuvres: Sequence[Manoeuvre],
    times: Float[np.ndarray, " n"],
    states: Float[Tensor, "runs n k"],
    rudders: Float[Tensor, "runs n"],
    orders: Float[Tensor, "runs n"],
    blades: Float[Tensor, "runs n"],
    *,
    status: str,
) -> list[Recording]:
    """Put several solutions over the same times into recordings; see :func:`to_recording`.

    Args:
        dynamics: The ship that moved.
        manoeuvres: What was ordered, one a run.
        times: Sample times [s].
        states: u, v, r, x, y, psi and the model's own.
        rudders: Rudder angle that the indicator shows [rad].
        orders: Rudder order [rad].
        blades: Angle of the rudder blade [rad].
        status: ``ok`` or why they were ended.

    Returns:
        One recording a run.
    """
    clock = states.new_tensor(times).expand_as(rudders)
    made = {name: states[..., k] for k, name in enumerate(("u", "v", "r", "x", "y", "psi"))}
    with torch.no_grad():
        nudot = dynamics(states, blades, clock)[..., :3]
        made |= {"delta": rudders, "delta_order": orders} | dict(zip(ACCELERATION, nudot.unbind(-1), strict=True))
        made |= dynamics.recorded(states, rudders, blades, clock)
    channels = {name: values.double().cpu().contiguous().numpy() for name, values in made.items()}
    ship, recordings = dynamics.particulars, []
    for row, manoeuvre in enumerate(manoeuvres):
        meta = {"ship": ship.name, "kind": manoeuvre.kind, "manoeuvre": manoeuvre, "time_unit": ship.time_unit}
        own = {name: values[row] for name, values in channels.items()}
        recordings.append(Recording(manoeuvre.name, times, own, status, meta))
    return recordings


def _integrate(
    dynamics: Dynamics, manoeuvre: Manoeuvre, state: Tensor, times: np.ndarray, options: dict
) -> tuple[Tensor, ...]:
    """Walk through stages and pieces; states, indicated angles, blade angles and orders at the sample times."""
    ship, stages = dynamics.particulars, list(manoeuvre.stages)
    stages[-1] = replace(stages[-1], heading=None, hold=None)  # the last order is held to the end
    now, rudder, course, began = 0.0, 0.0, float(state[5]), 0.0
    stage, amidships = stages.pop(0), state.new_zeros(())
    behind = dynamics.blade_at_rest(amidships)
    states, rudders, blades, orders = [state], [amidships], [behind[-1]], [state.new_tensor(stage.order)]
    chunk = 3.0 * ship.time_unit  # headings are watched in short stretches, so that little is computed in vain
    while len(states) < len(times) and inside_physical_range(state, ship):
        limit = float(times[-1]) if stage.heading is None else min(now + chunk, float(times[-1]))
        piece = _next_piece(dynamics, stage, now, began, rudder, behind, limit)
        samples = times[len(states) :]
        samples = samples[samples <= piece.end + 1e-9]
        solution, reached, state = _solve_piece(dynamics, piece, stage, course, state, samples, options)
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
    dynamics: Dynamics, stage: Stage, now: float, began: float, rudder: float, before: Tensor, limit: float
) -> _Piece:
    """The longest stretch from now on in which the rudder does one thing."""
    error, rate = stage.order - rudder, dynamics.particulars.rudder_rate
    arrival = now + abs(error) / rate if error else inf
    time_out = began + stage.hold if stage.hold is not None else inf
    end = min(arrival, time_out if time_out > now + 1e-9 else inf, limit)
    moving = float(np.sign(error)) * rate if error else 0.0
    return _Piece(now, end, rudder, moving, before.new_tensor(stage.order), before, dynamics.blade)


def _solve_piece(
    dynamics: Dynamics,
    piece: _Piece,
    stage: Stage,
    course: float,
    state: Tensor,
    samples: np.ndarray,
    options: dict,
) -> tuple[Tensor, float | None, Tensor]:
    """Integrate one piece; states at the samples in it, time of the heading crossing if there is one, final state."""
    ship = dynamics.particulars
    far = 2 * torch.tensor(LARGEST, dtype=state.dtype) * state.new_tensor([1.0, 1.0, 1 / ship.length]) * ship.top_speed
    steepest = 1e4 * ship.top_speed / ship.time_unit

    def rate(t: Tensor, y: Tensor) -> Tensor:
        # A run that breaks down rests far outside the range: else its steps shrink without end before it is looked at.
        if not bool((y[:3].abs() <= far).all()):
            return torch.zeros_like(y)
        # Rates beyond all sense, or not numbers, throw it out there at once: the solver gives up on them.
        return torch.nan_to_num(dynamics(y, piece.behind(t)[-1], t), nan=steepest).clamp(-steepest, steepest)

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
