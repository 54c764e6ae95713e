"""The accurate solution of one manoeuvre: torchdiffeq between events, heading crossings located."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torchdiffeq import odeint, odeint_event

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import RPM
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.helm import Helm, helm_of
from manoeuvre_nn.dynamics.limits import MAX_PRIME_VELOCITIES, OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.vessel import Vessel, as_vessel

ROWS_AT_ONCE = 16
"""Rows that are turned into recordings at once: enough to share the overhead, few enough to stay in the cache."""
MAX_SAMPLES = 1e8
"""Samples of a run; their times alone take a gigabyte."""


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

    Raises:
        InputError: If there is none between the first and the last, or more of them than any trial needs.
    """
    manoeuvre.check(ship)
    duration, step = manoeuvre.duration_for(ship), interval or ship.sample_interval
    if not 1 <= duration / step < MAX_SAMPLES:
        raise InputError(
            f"manoeuvre {manoeuvre.name}: {duration:.3g} s at {1 / step:.3g} samples a second are "
            f"{duration / step:.3g} samples; expected 1 to {MAX_SAMPLES:.0e}: mind its times, and rate_hz"
        )
    return np.arange(0.0, duration + 1e-9, step)


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
    own = as_vessel(ship).model.steered([manoeuvre], interval)
    if own is not None:
        return own[0]
    vessel, state = on_approach(ship, manoeuvre)
    times = sample_times(vessel.model.particulars, manoeuvre, interval)
    options = {"rtol": rtol, "atol": atol, "method": "dopri5"}
    with torch.no_grad():
        states, shown, blades, orders = _integrate(vessel, manoeuvre, state[None], times, options)
    outside = np.flatnonzero(~inside_physical_range(states[:, 0], vessel.model.particulars).cpu().numpy())
    count = int(outside[0]) if len(outside) else len(states)
    lost = count < len(states) or not (len(states) == len(times) or manoeuvre.ends)
    ended = states.new_tensor([times[count] if lost and count < len(times) else inf])
    clock, end = torch.as_tensor(times[: len(states)]), float(times[-1] if lost else times[len(states) - 1])
    sides = {name: split.expand_as(blades) for name, split in sides_of([manoeuvre], vessel, state).items()}
    inputs = Inputs(blades, time=clock[:, None].to(blades), **sides)
    (made,) = to_recordings(vessel, [manoeuvre], Solution(clock, states, shown, orders, inputs, ended), [end])
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
        orders = solution.orders[: int(np.searchsorted(times, end + 1e-9)), row]
        end = min(end, manoeuvres[row].end(times[: len(orders)], orders.double().cpu().numpy()))
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
    names = ("u", "v", "r", "x", "y", "psi", *vessel.model.own_names)
    made = {name: states[..., k] for k, name in enumerate(names)}
    with torch.no_grad():
        rates = vessel.model(states, inputs)
        made |= {"delta": shown, "delta_order": orders}
        made |= dict(zip(ACCELERATION, rates[..., :3].unbind(-1), strict=True))
        made |= {"pdot": rates[..., 7]} if "p" in names else {}
        made |= _by_sides(vessel, shown, inputs) if vessel.model.hull.sides == 2 else {}
        if vessel.effects:  # else perfect sensors would write what stands there already
            made |= vessel.sensors.record(vessel.situation(states, inputs), rates, shown)
    return {name: values.double().cpu().contiguous().numpy() for name, values in made.items()}


def _by_sides(vessel: Vessel, shown: Tensor, inputs: Inputs) -> dict[str, Tensor]:
    """Angles of both rudders [rad] and speeds of both shafts [1/s], as their indicators show them."""
    rudder, shaft = (torch.zeros_like(shown) if s is None else s for s in (inputs.delta_split, inputs.shaft_split))
    mean = torch.ones_like(shown) if inputs.shaft is None else inputs.shaft
    turns = vessel.model.hull.shaft_rpm * RPM
    made = {"delta_starboard": shown + rudder, "delta_port": shown - rudder, "n": turns * mean}
    return made | {"n_starboard": turns * (mean + shaft), "n_port": turns * (mean - shaft)}


def sides_of(
    manoeuvres: Sequence[Manoeuvre], vessel: Vessel, like: Float[Tensor, "..."]
) -> dict[str, Float[Tensor, " rows"]]:
    """How starboard and port rudders and shafts differ.

    Args:
        manoeuvres: One for each row.
        vessel: The ship.
        like: A tensor of the wanted kind.

    Returns:
        Name of an input of :class:`.Inputs` -> its value in every row; empty where the sides are alike.

    Raises:
        InputError: If they are to differ on a ship that has one of each.
    """
    splits = {"delta_split": [m.rudder_split for m in manoeuvres], "shaft_split": [m.shaft_split for m in manoeuvres]}
    wanted = {name: like.new_tensor(values) for name, values in splits.items() if any(values)}
    if wanted and vessel.model.hull.sides != 2:
        ship = vessel.model.particulars.name
        raise InputError(
            f"the {ship} has one rudder and one screw: leave manoeuvre.rudder_split_deg and shaft_split out"
        )
    return wanted


def _integrate(
    vessel: Vessel, manoeuvre: Manoeuvre, state: Float[Tensor, "1 n"], times: np.ndarray, options: dict
) -> tuple[Tensor, ...]:
    """Walk from event to event of the helm; states, indicated angles, blade angles and orders at the sample times."""
    ship, rest = vessel.model.particulars, state.new_zeros(1)
    helm = helm_of([manoeuvre], rest + ship.rudder_rate, state[:, 5], vessel.gear.at_rest(rest))
    sides = sides_of([manoeuvre], vessel, state)
    found, count, now = [(state[None], helm.rudder[None], helm.blade[:, -1:], helm.order[None])], 1, 0.0
    everywhere = torch.ones_like(rest, dtype=torch.bool)
    chunk = 3.0 * ship.time_unit  # headings are watched in short stretches, so that little is computed in vain
    last = len(manoeuvre.stages) - 1 if manoeuvre.ends else len(manoeuvre.stages)
    while count < len(times) and inside_physical_range(state, ship) and int(helm.stage) < last:
        limit = min(now + chunk, float(times[-1])) if bool(helm.now[1].isfinite()) else float(times[-1])
        end = min(now + float(helm.smooth_time(rest + now)), limit)
        samples = times[count:]
        samples = samples[samples <= end + 1e-9]
        grid = np.unique(np.concatenate([[now], samples, [end]]))
        grid = grid[np.concatenate([[True], np.diff(grid) > 1e-9])]
        steered = _steered(vessel, helm)
        rate = _rate(vessel.model, steered, now, sides)
        path = odeint(rate, state, torch.as_tensor(grid), **options)
        passed, state = helm.beyond(path[1:, 0, 5]) >= 0, path[-1]
        if passed.any():
            first = int(passed.int().argmax())
            end, state = _locate(rate, helm, path[first], (grid[first], grid[first + 1]), options)
            samples = samples[samples <= end]
        shown, behind = steered(torch.as_tensor(samples - now).to(rest))
        at, orders = np.searchsorted(grid, samples - 1e-9), helm.order.expand(len(samples), 1)
        found.append((path[at], shown[:, None], behind[:, -1:], orders))
        count += len(samples)
        shown, behind = helm.after(rest + (end - now), vessel)
        helm, now = helm.advanced(shown, behind, rest + end, everywhere, everywhere & passed.any()), end
    return tuple(torch.cat(parts) for parts in zip(*found, strict=True))


def _steered(vessel: Vessel, helm: Helm) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    """Time from now -> indicated angle and the angles behind it, while the indicator moves evenly or rests."""
    # It goes on so beyond the end of that, where the solver looks too: a kink there would cost accuracy.
    error = helm.order - helm.rudder
    speed = torch.where(error.abs() > 1e-12, torch.sign(error) * helm.rate, 0.0)

    def steered(elapsed: Tensor) -> tuple[Tensor, Tensor]:
        shown = helm.rudder + speed * elapsed
        return shown, vessel.gear.after(helm.blade, helm.order, shown, elapsed)

    return steered


def _rate(
    model: Model, steered: Callable, start: float, sides: Mapping[str, Tensor]
) -> Callable[[Tensor, Tensor], Tensor]:
    """Rate of the state while the helm does one thing from a time on [s]."""
    ship = model.particulars
    steepest = 1e4 * ship.top_speed / ship.time_unit
    max_u, max_v, max_r = MAX_PRIME_VELOCITIES
    far = 2 * ship.top_speed * model.hull.inertia.new_tensor([max_u, max_v, max_r / ship.length])

    def rate(t: Tensor, y: Tensor) -> Tensor:
        # A run that breaks down rests far outside the range: else its steps shrink without end before it is looked at.
        if not bool((y[:, :3].abs() <= far).all()):
            return torch.zeros_like(y)
        time = t.expand(len(y))
        blade = steered(time - start)[1][:, -1]
        # Rates beyond all sense, or not numbers, throw it out there at once: the solver gives up on them.
        return torch.nan_to_num(model(y, Inputs(blade, time=time, **sides)), nan=steepest).clamp(-steepest, steepest)

    return rate


def _locate(
    rate: Callable, helm: Helm, state: Float[Tensor, "1 n"], between: tuple[float, float], options: dict
) -> tuple[float, Tensor]:
    """Time and state of the heading's crossing between two times; at once if the limit is already passed."""
    start, end = between
    if bool(helm.beyond(state[:, 5]) >= 0):
        return start, state

    def event(t: Tensor, y: Tensor) -> Tensor:
        return torch.stack([helm.beyond(y[:, 5])[0], t - end - 1.0])  # the second element bounds the search

    begin = torch.tensor(start, dtype=torch.float64)
    time, path = odeint_event(rate, state, begin, event_fn=event, **options)
    return float(time), path[-1]
