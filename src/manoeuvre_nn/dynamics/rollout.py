"""Many manoeuvres at once: a fixed-step solution in which every run is a row of one tensor.

No library does this: rows reverse their rudders at their own times, so a common step would either miss the crossings or
be cut by every row. Here all rows take the same steps, and only the rows in which something happens within a step take
it again in parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.helm import Helm, helm_of
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.simulate import Problem, to_recording

STEPS_PER_LENGTH = 20
"""Default steps in the time L/U0: 1 s for a 150-m ship at 15 kn."""


@dataclass(frozen=True)
class Rollout:
    """Runs of a batch; a row that left the physical range rests in its last good state from then on.

    Attributes:
        times: Sample times [s].
        states: u, v, r, x, y, psi and the model's own.
        rudders: Rudder angle that the indicator shows [rad].
        blades: Angle of the rudder blade [rad].
        orders: Rudder order [rad].
        ended: Time at which a row left the physical range [s]; ``inf`` if it did not.
    """

    times: Float[Tensor, " times"]
    states: Float[Tensor, "times rows n"]
    rudders: Float[Tensor, "times rows"]
    blades: Float[Tensor, "times rows"]
    orders: Float[Tensor, "times rows"]
    ended: Float[Tensor, " rows"]


def rollout(
    dynamics: Dynamics,
    manoeuvres: Sequence[Manoeuvre],
    start: Float[Tensor, "rows n"],
    times: Float[Tensor, " times"],
    *,
    step: float | None = None,
) -> Rollout:
    """Run a batch of manoeuvres in closed loop with fixed Runge-Kutta steps.

    Rudder kinks and ends of stages are known times and cut a row's step; heading crossings are found on the cubic
    through heading and yaw rate at both ends of a step, and the step is taken again up to there. Gradients pass
    through, the crossings' times included.

    Args:
        dynamics: One ship or network for all rows, or :class:`~manoeuvre_nn.dynamics.model.Stacked` rows.
        manoeuvres: One for each row.
        start: Whole initial states, as ``Dynamics.start`` makes them.
        times: Sample times [s], evenly spaced from 0.
        step: Largest step [s]; by default 1/20 of L/U0.

    Returns:
        The runs.
    """
    ship = dynamics.particulars
    interval = float(times[1] - times[0])
    parts = ceil(interval / (step or ship.time_unit / STEPS_PER_LENGTH) - 1e-9)
    amidships = start.new_zeros(len(manoeuvres))
    helm = helm_of(manoeuvres, amidships + ship.rudder_rate, start[:, 5], dynamics.blade_at_rest(amidships))
    state, ended = start, start.new_full((len(start),), torch.inf)
    states, helms = [start], [helm]
    for first in times[:-1].tolist():
        for k in range(parts):
            state_next, helm = _step(dynamics, helm, state, first + k * interval / parts, interval / parts)
            state = _held(state, state_next, ended)
        alive = inside_physical_range(state, ship)
        if not alive.all():
            ended = torch.where(alive, ended, ended.clamp(max=first + interval))
            state = torch.where(alive[:, None], state, states[-1])
        states.append(state)
        helms.append(helm)
        if ended.isfinite().all():
            break
    missing = len(times) - len(states)
    helms, states = helms + [helm] * missing, states + [states[-1]] * missing
    shown, blades = torch.stack([h.rudder for h in helms]), torch.stack([h.blade[:, -1] for h in helms])
    return Rollout(times, torch.stack(states), shown, blades, torch.stack([h.now(h.order) for h in helms]), ended)


def _held(state: Tensor, new: Tensor, ended: Float[Tensor, " rows"]) -> Tensor:
    """The new state, but rows that ended stay where they are."""
    gone = ended.isfinite()
    return torch.where(gone[:, None], state, new) if gone.any() else new


def _step(dynamics: Dynamics, helm: Helm, state: Tensor, time: float, step: float) -> tuple[Tensor, Helm]:
    """One step of all rows; rows in which something happens take it in as many parts as they need."""
    now = torch.full_like(helm.rudder, time)
    taken, new, crossed = _smooth_step(dynamics, helm, state, now, torch.full_like(now, step))
    helm = helm.advanced(taken, now + taken, crossed, dynamics.blade)
    left = step - taken
    for _ in range(50):  # a row can meet a crossing, an arrival and a few timed stages within one step, not fifty
        busy = torch.nonzero(left > 1e-9)[:, 0]
        if not len(busy):
            break
        part, part_helm = dynamics.take(busy), helm.take(busy)
        at = time + step - left[busy]
        took, moved, hit = _smooth_step(part, part_helm, new[busy], at, left[busy])
        new = new.index_copy(0, busy, moved)
        helm = helm.put(busy, part_helm.advanced(took, at + took, hit, part.blade))
        left = left.index_copy(0, busy, left[busy] - took)
    return new, helm


def _smooth_step(
    dynamics: Dynamics, helm: Helm, state: Tensor, time: Float[Tensor, " rows"], limit: Float[Tensor, " rows"]
) -> tuple[Float[Tensor, " rows"], Tensor, Bool[Tensor, " rows"]]:
    """The longest step within the limit in which nothing happens: its length, the state then, rows that crossed."""
    tau = torch.minimum(limit, helm.smooth_time(time).clamp(min=0.0))
    new = _runge_kutta(dynamics, helm, state, time, tau)
    before, after = helm.beyond(state[:, 5]), helm.beyond(new[:, 5])
    crossed = after >= 0
    rows = torch.nonzero(crossed)[:, 0]
    if len(rows):
        shorter = _crossing(before[rows], after[rows], state[rows], new[rows], tau[rows], helm.take(rows))
        part, part_helm = dynamics.take(rows), helm.take(rows)
        again = _runge_kutta(part, part_helm, state[rows], time[rows], shorter)
        shorter = _corrected(shorter, before[rows], again, tau[rows], part_helm)
        tau = tau.index_copy(0, rows, shorter)
        new = new.index_copy(0, rows, _runge_kutta(part, part_helm, state[rows], time[rows], shorter))
    return tau, new, crossed


def _crossing(before: Tensor, after: Tensor, state: Tensor, new: Tensor, tau: Tensor, helm: Helm) -> Tensor:
    """Time in the step at which the heading meets its limit, by bisection of the cubic Hermite polynomial."""
    direction = helm.now(helm.direction)
    slope0, slope1 = direction * state[:, 2] * tau, direction * new[:, 2] * tau
    low, high = torch.zeros_like(tau), torch.ones_like(tau)
    with torch.no_grad():
        for _ in range(40):
            s = 0.5 * (low + high)
            h = before * (1 + 2 * s) * (1 - s) ** 2 + after * s * s * (3 - 2 * s)
            h = h + slope0 * s * (1 - s) ** 2 - slope1 * s * s * (1 - s)
            past = h >= 0
            low, high = torch.where(past, low, s), torch.where(past, s, high)
    return torch.where(before >= 0, torch.zeros_like(tau), high * tau)


def _corrected(found: Tensor, before: Tensor, state: Tensor, tau: Tensor, helm: Helm) -> Tensor:
    """One Newton step towards the crossing; it also carries the gradient of the crossing's time, ``-dpsi / r``."""
    closing = (helm.now(helm.direction) * state[:, 2]).detach()
    sure = (before < 0) & (closing * tau > 1e-9)
    step = torch.where(sure, helm.beyond(state[:, 5]) / torch.where(sure, closing, 1.0), 0.0)
    return torch.minimum((found - step).clamp(min=0.0), tau)


def _runge_kutta(
    dynamics: Dynamics, helm: Helm, state: Tensor, time: Float[Tensor, " rows"], tau: Float[Tensor, " rows"]
) -> Tensor:
    """Classical fourth-order step with the rudder blade's exact angle at the start, middle and end."""
    h, half, noon = tau[:, None], 0.5 * tau, time + 0.5 * tau
    middle, end = helm.blade_after(half, dynamics.blade), helm.blade_after(tau, dynamics.blade)
    k1 = dynamics(state, helm.blade[:, -1], time)
    k2 = dynamics(state + 0.5 * h * k1, middle, noon)
    k3 = dynamics(state + 0.5 * h * k2, middle, noon)
    k4 = dynamics(state + h * k3, end, time + tau)
    return state + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def roll_out(dynamics: Dynamics, manoeuvres: Sequence[Manoeuvre], *, step: float | None = None) -> list[Recording]:
    """Run several manoeuvres of one ship or network as one batch and return them as recordings.

    Manoeuvres that start at the same speed share a batch; each is as long as the manoeuvre says.

    Args:
        dynamics: The ship or network.
        manoeuvres: What is to be done.
        step: Largest step [s]; by default 1/20 of L/U0.

    Returns:
        One recording a manoeuvre, in their order.
    """
    by_speed: dict[float | None, list[int]] = {}
    for index, manoeuvre in enumerate(manoeuvres):
        by_speed.setdefault(manoeuvre.speed, []).append(index)
    done: dict[int, Recording] = {}
    for indices in by_speed.values():
        group = [manoeuvres[i] for i in indices]
        problems = [Problem(dynamics, m).on_approach() for m in group]
        moving, start, _ = problems[0]
        times = max((p[2] for p in problems), key=len)
        with torch.no_grad():
            runs = rollout(moving, group, start.repeat(len(group), 1), start.new_tensor(times), step=step)
        for row, (index, problem) in enumerate(zip(indices, problems, strict=True)):
            done[index] = _recording(runs, row, moving, manoeuvres[index], problem[2])
    return [done[i] for i in range(len(manoeuvres))]


def _recording(runs: Rollout, row: int, dynamics: Dynamics, manoeuvre: Manoeuvre, times: np.ndarray) -> Recording:
    """One row of a batch as a recording, cut where it left the physical range."""
    ended = float(runs.ended[row])
    count = max(int(np.sum(times < ended - 1e-9)), 2)
    status = OK if ended > times[-1] + 1e-9 else left_range(ended)
    states, shown, blades, orders = (x[:count, row] for x in (runs.states, runs.rudders, runs.blades, runs.orders))
    return to_recording(dynamics, manoeuvre, times[:count], states, shown, orders, status, blades=blades)
