"""Many manoeuvres at once: a fixed-step solution in which every run is a row of one tensor.

Steps are those of :func:`.runge_kutta_step`. No library has this loop: rows reverse their rudders at their own times,
so a common step would either miss the crossings or be cut by every row. Here every row has a clock of its own: all rows
step at once, each as far as its next step's end or the next thing that happens to it, so that an event costs one more
pass and not a batch of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model, runge_kutta_step
from manoeuvre_nn.dynamics.helm import Helm, helm_of
from manoeuvre_nn.dynamics.limits import inside_physical_range
from manoeuvre_nn.dynamics.simulate import Solution, on_approach, sample_times, sides_of, to_recordings
from manoeuvre_nn.dynamics.vessel import Vessel, as_vessel

STEPS_PER_LENGTH = 20
"""Default steps in the time L/U0: 1 s for a 150-m ship at 15 kn."""


@dataclass(frozen=True)
class _Batch:
    """Where every row stands.

    Attributes:
        state: u, v, r, x, y, psi and the model's own.
        helm: Its helm.
        time: Its clock [s].
        steps: Steps that it has finished.
        tries: How often the heading's crossing within the present step was looked for; the second time is exact.
        attempt: Where the crossing is then taken to be, as a time from now [s]; ``inf`` if none is looked for.
        sampled: State at its last sample.
        ended: Time at which it left the physical range [s]; ``inf`` if it did not.
        sides: How starboard and port rudders and shafts differ, see :func:`.sides_of`.
    """

    state: Float[Tensor, "rows n"]
    helm: Helm
    time: Float[Tensor, " rows"]
    steps: Int[Tensor, " rows"]
    tries: Int[Tensor, " rows"]
    attempt: Float[Tensor, " rows"]
    sampled: Float[Tensor, "rows n"]
    ended: Float[Tensor, " rows"]
    sides: Mapping[str, Float[Tensor, " rows"]]


def rollout(
    ship: Model | Vessel,
    manoeuvres: Sequence[Manoeuvre],
    start: Float[Tensor, "rows n"],
    times: Float[Tensor, " times"],
    *,
    step: float | None = None,
    samples: Sequence[int] | None = None,
) -> Solution:
    """Run a batch of manoeuvres in closed loop with fixed Runge-Kutta steps.

    Rudder kinks and ends of stages are known times and cut a row's step; heading crossings are found on the cubic
    through heading and yaw rate at both ends of a step, and the step is taken again up to there. Gradients pass
    through, the crossings' times included.

    Args:
        ship: One model or vessel for all rows; what a model does in a row may be that row's own.
        manoeuvres: One for each row.
        start: Whole initial states, as ``Model.start`` makes them.
        times: Sample times [s], evenly spaced from 0.
        step: Largest step [s]; by default 1/20 of L/U0.
        samples: How many samples each row is asked for, after which it rests; by default all.

    Returns:
        The runs; a row that left the physical range rests in its last good state from then on.
    """
    vessel = as_vessel(ship)
    particulars = vessel.model.particulars
    interval = float(times[1] - times[0])
    parts = ceil(interval / (step or particulars.time_unit / STEPS_PER_LENGTH) - 1e-9)
    within = interval / parts * torch.arange(parts).to(times)
    ends = torch.cat([(times[:-1, None] + within).flatten(), times[-1:]])
    amidships = start.new_zeros(len(manoeuvres))
    helm = helm_of(manoeuvres, amidships + particulars.rudder_rate, start[:, 5], vessel.gear.at_rest(amidships))
    start = start.mT.contiguous().mT  # variables first in memory, as rate_of_state has them
    none, never = amidships.long(), torch.full_like(amidships, torch.inf)
    sides = sides_of(manoeuvres, vessel, amidships)
    batch = _Batch(start, helm, amidships, none, none, never, start, never, sides)
    past, final = [batch], none.new_tensor([len(m.stages) - 1 if m.ends else len(m.stages) for m in manoeuvres])
    asked = none.new_tensor([parts * (count - 1) for count in samples or [len(times)] * len(manoeuvres)])
    while bool((batch.steps < len(ends) - 1).any()):
        batch = _over(
            _sampled(_pass(vessel, batch, ends), batch, parts, particulars, len(ends) - 1), final, asked, len(ends) - 1
        )
        past.append(replace(batch, sampled=start))  # what is not read off need not be kept
    return _read_off(past, times, parts)


def _read_off(past: Sequence[_Batch], times: Float[Tensor, " times"], parts: int) -> Solution:
    """Every row at its samples, from all passes: a sample is where a row first had finished the steps up to it."""
    steps = torch.stack([b.steps for b in past], dim=-1)
    rows, samples = len(steps), parts * torch.arange(len(times), device=steps.device)
    at = torch.searchsorted(steps, samples.expand(rows, -1).contiguous()).T
    place = (rows * at + torch.arange(rows, device=at.device)).flatten()

    def pick(values: Sequence[Tensor]) -> Tensor:
        return torch.cat(tuple(values)).index_select(0, place).unflatten(0, at.shape)

    helms = [b.helm for b in past]
    shown, blades, orders = (pick(v) for v in zip(*((h.rudder, h.blade[:, -1], h.order) for h in helms), strict=True))
    sides = {name: split.expand_as(blades) for name, split in past[-1].sides.items()}
    inputs = Inputs(blades, time=times[:, None].expand_as(blades), **sides)
    return Solution(times, pick([b.state for b in past]), shown, orders, inputs, past[-1].ended)


def _sampled(batch: _Batch, before: _Batch, parts: int, ship: Particulars, last: int) -> _Batch:
    """The batch with rows ended that are outside the physical range at a sample: they rest at the sample before."""
    sample = (batch.steps > before.steps) & (batch.steps % parts == 0)
    lost = sample & ~inside_physical_range(batch.state, ship)
    if lost.any():
        ended, steps = torch.where(lost, batch.time, batch.ended), batch.steps.masked_fill(lost, last)
        batch = replace(batch, ended=ended, steps=steps, state=torch.where(lost[:, None], batch.sampled, batch.state))
    if sample.all():
        return replace(batch, sampled=batch.state)
    return replace(batch, sampled=torch.where(sample[:, None], batch.state, batch.sampled))


def _over(batch: _Batch, final: Int[Tensor, " rows"], asked: Int[Tensor, " rows"], last: int) -> _Batch:
    """The batch with rows ended whose trial is over, its final stage having begun or all steps made: they rest."""
    over = (batch.helm.stage >= final) | (batch.steps >= asked)
    return replace(batch, steps=batch.steps.masked_fill(over, last)) if over.any() else batch


def _pass(vessel: Vessel, b: _Batch, ends: Float[Tensor, " steps"]) -> _Batch:
    """Every row goes on to the end of its step or to what happens before; rows that look for a crossing stay."""
    last = len(ends) - 1
    due = ends.index_select(0, (b.steps + 1).clamp(max=last))
    # A row that has ended is stepped on with the others, for nothing: by a usual step its numbers stay those of a ship.
    left = torch.minimum(due - b.time, ends[1])
    smooth = torch.minimum(left, b.helm.smooth_time(b.time).clamp(min=0.0))
    tau = torch.fmin(smooth, b.attempt)
    state, shown, blade = _step(vessel, b, tau)
    time, tries, attempt = b.time + tau, b.tries, b.attempt
    crossed, beyond = tries == 2, b.helm.beyond(state[:, 5])
    looking = ~crossed & ((beyond >= 0) | (tries == 1))
    moved, search = ~looking, bool((looking | crossed).any())
    if search:
        attempt = torch.where(looking, _looked_for(b, looking, state, smooth, beyond), torch.inf)
        tries = torch.where(looking, tries + 1, 0)
        state, blade = torch.where(moved[:, None], state, b.state), torch.where(moved[:, None], blade, b.helm.blade)
        time, shown = torch.where(moved, time, b.time), torch.where(moved, shown, b.helm.rudder)
    arrived = moved & (due - time <= 1e-9)
    time, steps = torch.where(arrived, due, time), (b.steps + arrived).clamp(max=last)
    helm = b.helm.advanced(shown, blade, time, moved, crossed)
    return _Batch(state, helm, time, steps, tries, attempt, b.sampled, b.ended, b.sides)


def _looked_for(b: _Batch, looking: Bool[Tensor, " rows"], new: Tensor, smooth: Tensor, beyond: Tensor) -> Tensor:
    """Times from now at which the headings meet their limits: first on a cubic, then corrected."""
    before = b.helm.beyond(b.state[:, 5])
    found = _corrected(b, before, new, smooth, beyond)
    rows = torch.nonzero(looking & (b.tries == 0))[:, 0]
    if len(rows):
        tau, direction = smooth[rows], b.helm.direction[rows]
        slopes = direction * b.state[rows, 2] * tau, direction * new[rows, 2] * tau
        found = found.index_copy(0, rows, _crossing(before[rows], beyond[rows], *slopes) * tau)
    return found


def _crossing(before: Tensor, after: Tensor, slope0: Tensor, slope1: Tensor) -> Tensor:
    """Where in the step the cubic Hermite polynomial first is past 0: on finer and finer grids, then straight."""
    low, width = torch.zeros_like(before)[:, None], 1.0
    bend0, bend1 = slope0 - (after - before), (after - before) - slope1
    with torch.no_grad():
        grid = torch.linspace(0, 1, 65).to(before)
        for _ in range(2):
            s = low + width * grid
            h = before[:, None] * (1 - s) + after[:, None] * s
            h = h + s * (1 - s) * ((1 - s) * bend0[:, None] + s * bend1[:, None])
            first = (h >= 0).int().argmax(dim=1, keepdim=True).clamp(min=1)
            low, width = s.gather(1, first - 1), width / 64
        under, over = h.gather(1, first - 1), h.gather(1, first)
        share = torch.nan_to_num(under / (under - over), nan=1.0).clamp(0.0, 1.0)
        return torch.where(before >= 0, 0.0, (low + width * share)[:, 0])


def _corrected(b: _Batch, before: Tensor, new: Tensor, smooth: Tensor, beyond: Tensor) -> Tensor:
    """One Newton step towards the crossing; it also carries the gradient of the crossing's time, ``-dpsi / r``."""
    closing = (b.helm.direction * new[:, 2]).detach()
    sure = (before < 0) & (closing * smooth > 1e-9) & beyond.isfinite()
    step = torch.where(sure, beyond, 0.0) / torch.where(sure, closing, 1.0)
    return torch.fmin((b.attempt - step).clamp(min=0.0), smooth)


def _step(vessel: Vessel, b: _Batch, tau: Float[Tensor, " rows"]) -> tuple[Tensor, Tensor, Tensor]:
    """A Runge-Kutta step with the rudder's exact angles: state, indicated angle, angles behind it."""
    helm, time, half = b.helm, b.time, 0.5 * tau
    shown, blade = helm.after(tau, vessel)
    now = Inputs(helm.blade[:, -1], time=time, **b.sides)
    midway = Inputs(helm.after(half, vessel)[1][:, -1], time=time + half, **b.sides)
    then = Inputs(blade[:, -1], time=time + tau, **b.sides)
    return runge_kutta_step(vessel.model, b.state, (now, midway, then), tau[:, None]), shown, blade


def roll_out(
    ship: Model | Vessel, manoeuvres: Sequence[Manoeuvre], *, step: float | None = None, interval: float | None = None
) -> list[Recording]:
    """Run several manoeuvres of one ship or network as one batch and return them as recordings.

    Manoeuvres that start at the same speed share a batch; each is as long as the manoeuvre says.

    Args:
        ship: The model or vessel.
        manoeuvres: What is to be done.
        step: Largest step [s]; by default 1/20 of L/U0.
        interval: Time between samples [s]; by default the ship's. No step is longer.

    Returns:
        One recording a manoeuvre, in their order.
    """
    own = as_vessel(ship).model.steered(manoeuvres, interval)
    if own is not None:
        return own
    by_speed: dict[float | None, list[int]] = {}
    for index, manoeuvre in enumerate(manoeuvres):
        by_speed.setdefault(manoeuvre.speed, []).append(index)
    done: dict[int, Recording] = {}
    for indices in by_speed.values():
        group = [manoeuvres[i] for i in indices]
        vessel, start = on_approach(ship, group[0])
        clocks = [sample_times(vessel.model.particulars, m, interval) for m in group]
        with torch.no_grad():
            vessel.model(
                start, Inputs(start[5], time=start[5])
            )  # what an effect keeps from its first use must not be an inference tensor
        with torch.inference_mode():
            amidships = Inputs(vessel.gear.at_rest(start.new_zeros(len(group)))[..., -1])
            starts = vessel.model.start(start[:6].repeat(len(group), 1), amidships)
            times = start.new_tensor(max(clocks, key=len))
            runs = rollout(vessel, group, starts, times, step=step, samples=[len(clock) for clock in clocks])
        exact = replace(runs, times=torch.as_tensor(max(clocks, key=len)))
        done |= zip(indices, to_recordings(vessel, group, exact, [float(clock[-1]) for clock in clocks]), strict=True)
    return [done[i] for i in range(len(manoeuvres))]
