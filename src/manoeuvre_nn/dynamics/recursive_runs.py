"""Runs of a recursive network: driven by recorded controls, or steered by a helmsman."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from torch import Tensor, nn

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import RPM
from manoeuvre_nn.dynamics.course import course_of
from manoeuvre_nn.dynamics.helm import Helm, helm_of
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range, left_range
from manoeuvre_nn.dynamics.recursion import Recursion, Unrolled
from manoeuvre_nn.dynamics.vessel import Vessel

if TYPE_CHECKING:
    from manoeuvre_nn.dynamics.recursive import RecursiveShip

ANGLES = {"p": "phi", "q": "theta", "r": "psi"}
"""Rate -> angle."""
SIDED = ("delta_starboard", "delta_port", "n_starboard", "n_port")
"""Channels of a ship with two rudders and two screws."""
STEPS_AT_ONCE = 16
"""Steps after which it is looked whether all runs are over."""


@torch.no_grad()
def driven(ship: "RecursiveShip", recordings: Sequence[Recording], start: float) -> list[Recording]:
    """Runs from the recorded start by the recorded controls alone.

    Args:
        ship: The ship.
        recordings: What was recorded.
        start: Time after the first sample at which the network takes over [s]; its past is filled with that moment.

    Returns:
        One prediction a recording, at the ship's usual interval.

    Raises:
        InputError: If a recording is shorter than ``start``.
    """
    interval, settings = ship.particulars.sample_interval, ship.network.settings
    for record in recordings:
        if record.duration <= start + 2 * interval:
            raise InputError(f"recording {record.name} lasts {record.duration:g} s; nothing is left after {start:g} s")
    cut = [r.between(r.time[0] + start, r.time[-1]) for r in recordings]
    course = course_of(cut, ship.hull, settings.velocities, step=settings.step, wind=settings.wind)
    course = course.to(next(ship.network.parameters()))
    rows = torch.arange(len(cut), device=course.speed.device)
    begin = ship.recorded(course).start(rows, 0 * rows, settings.past)
    made = ship.unroll(begin, course.controls.rows(rows).at, course.speed, int(course.count(settings.step)))
    while bool((made.time[:, -1] < course.duration).any()):  # faster than the recording said, it needs more steps
        made = ship.unroll(begin, course.controls.rows(rows).at, course.speed, made.time.shape[1] + STEPS_AT_ONCE)
    runs = []
    for k, (record, speed) in enumerate(zip(cut, course.speed.tolist(), strict=True)):
        times = np.arange(record.time[0], record.time[-1] + 1e-9, interval)
        run = _recording(ship, record.name, _row(made, k), speed, times - times[0])
        moved = {name: run[name] + record[name][0] for name in ("x", "y")}
        names = [name for name in ("delta", "delta_order", "n", *SIDED) if name in record.channels]
        kept = {name: np.interp(times, record.time, record[name])[: len(run)] for name in names}
        run = replace(run, time=times[: len(run)], channels={**run.channels, **moved, **kept}, meta=record.meta)
        runs.append(run if run.status == OK else replace(run, status=left_range(float(run.time[-1]))))
    return runs


@torch.no_grad()
def steered(ship: "RecursiveShip", manoeuvres: Sequence[Manoeuvre], interval: float | None) -> list[Recording]:
    """Runs from a steady approach, the helmsman ordering by the heading that the network predicts.

    Within a step the heading is taken to change evenly. Of wind there is none.

    Args:
        ship: The ship.
        manoeuvres: What the helmsmen do; rows of one batch, whatever their speeds.
        interval: Time between samples [s]; None takes the ship's usual one.

    Returns:
        One recording a manoeuvre.
    """
    own = {None, ship.particulars.speed}
    hulls = [ship.hull if m.speed in own else ship.hull.on_approach(m.speed or 0.0) for m in manoeuvres]
    for manoeuvre, hull in zip(manoeuvres, hulls, strict=True):
        manoeuvre.check(hull.particulars)
    watch = _Watch.begin(ship, manoeuvres, hulls)
    unit, froude, folded = watch.unit, ship.froude(watch.speed), ship.network.folded()
    passed = [_approach(ship, watch.controls(), watch.speed)]
    while not watch.over():
        now = passed[-1]
        passed.append(ship.advance(now, watch.controls(), froude, folded))
        watch.go_on(passed[-1].time * unit, now.angles[:, -1], passed[-1].angles[:, -1])
    made, step = ship.joined(passed), interval or ship.particulars.sample_interval
    runs = []
    for k, (manoeuvre, hull) in enumerate(zip(manoeuvres, hulls, strict=True)):
        times = np.arange(0.0, float(watch.end[k]) + 1e-9, step)
        run = _recording(ship, manoeuvre.name, _row(made, k), float(watch.speed[k]), times)
        channels = {**run.channels, **watch.recorded(k, run.time)}
        meta = {"ship": hull.particulars.name, "time_unit": hull.particulars.time_unit}
        runs.append(replace(run, channels=channels, meta={**meta, "kind": manoeuvre.kind, "manoeuvre": manoeuvre}))
    return runs


@dataclass
class _Watch:
    """The helmsmen of a batch, and when they ordered what.

    Attributes:
        ship: The ship.
        hulls: The same on the approach of every row.
        split: Half of what starboard has more than port: rudder [rad], shaft over the nominal shaft speed [-].
        helm: Where every helmsman stands.
        time: Time of every row [s].
        end: When every run is over [s]; sooner where the trial's last stage ends it.
        final: Stage whose beginning ends the trial.
        orders: Times and orders of every row.
    """

    ship: "RecursiveShip"
    hulls: Sequence[Ship]
    split: Float[Tensor, "rows 2"]
    helm: Helm
    time: Float[Tensor, " rows"]
    end: Float[Tensor, " rows"]
    final: Tensor
    orders: list[list[tuple[float, float]]]

    @classmethod
    def begin(cls, ship: "RecursiveShip", manoeuvres: Sequence[Manoeuvre], hulls: Sequence[Ship]) -> "_Watch":
        """At the start, rudder amidships."""
        like = next(ship.network.parameters())
        end = like.new_tensor([m.duration_for(h.particulars) for m, h in zip(manoeuvres, hulls, strict=True)])
        rest = torch.zeros_like(end)
        helm = helm_of(manoeuvres, rest + ship.particulars.rudder_rate, rest, Vessel(ship).gear.at_rest(rest))
        final = [len(m.stages) - 1 if m.ends else len(m.stages) for m in manoeuvres]
        orders = [[(0.0, float(order))] for order in helm.order]
        split = like.new_tensor([[m.rudder_split, m.shaft_split] for m in manoeuvres])
        return cls(ship, hulls, split, helm, rest, end, helm.stage.new_tensor(final), orders)

    @cached_property
    def speed(self) -> Float[Tensor, " rows"]:
        """Approach speeds [m/s]."""
        return self.time.new_tensor([hull.particulars.speed for hull in self.hulls])

    @cached_property
    def turns(self) -> Float[Tensor, " rows"]:
        """Shaft speeds on the approach [1/s]."""
        return self.time.new_tensor([hull.shaft_rpm * RPM for hull in self.hulls])

    @cached_property
    def unit(self) -> Float[Tensor, " rows"]:
        """L/U0 [s]."""
        return self.ship.particulars.length / self.speed

    def over(self) -> bool:
        """Whether all runs are."""
        return bool((self.time >= self.end).all())

    def controls(self) -> Float[Tensor, "rows _"]:
        """Rudder angles and shaft speeds of both sides now, and still air where wind is among the inputs."""
        blade, (rudder, shaft) = self.helm.blade[:, -1], self.split.unbind(-1)
        n = self.turns * self.unit
        made = torch.stack([blade + rudder, blade - rudder, n * (1 + shaft), n * (1 - shaft)], dim=-1)
        return nn.functional.pad(made, (0, 2)) if self.ship.network.settings.wind else made

    def go_on(
        self, until: Float[Tensor, " rows"], before: Float[Tensor, " rows"], after: Float[Tensor, " rows"]
    ) -> None:
        """Steer to the end of a step in which the heading changes evenly from one value to another.

        Stages that end on the way end where the heading reaches their limit, or when their time is up.
        """
        everywhere, vessel = torch.ones_like(until, dtype=torch.bool), Vessel(self.ship)
        rate = (after - before) / (until - self.time)
        while bool((left := until - self.time).gt(1e-9).any()):
            beyond = self.helm.beyond(before)
            towards = self.helm.direction * rate
            crossing = torch.where(beyond >= 0, 0.0, torch.where(towards > 0, -beyond / towards, torch.inf))
            due = (self.helm.began + self.helm.now[2] - self.time).clamp(min=0)
            tau = torch.minimum(left, torch.minimum(due, crossing)).clamp(min=0)
            shown, blade = self.helm.after(tau, vessel)
            time, stage = self.time + tau, self.helm.stage
            crossed = (crossing <= tau) & (left > 1e-9)
            self.helm = self.helm.advanced(shown, blade, time, everywhere, crossed)
            self.time, before = torch.where(left > 1e-9, time, until), before + tau * rate
            self._note(stage)

    def _note(self, stage: Tensor) -> None:
        """Write down orders that are new, and the ends of trials."""
        for k in (self.helm.stage != stage).nonzero().flatten().tolist():
            self.orders[k].append((float(self.time[k]), float(self.helm.order[k])))
            if self.helm.stage[k] >= self.final[k]:
                self.end[k] = torch.minimum(self.end[k], self.time[k])

    def recorded(self, row: int, times: Float[np.ndarray, " n"]) -> dict[str, np.ndarray]:
        """Rudder and shaft of a row at some times; by sides for a ship that has two."""
        order, shown = self._rudder(row, times)
        turns = np.full(len(times), float(self.turns[row]))
        made = {"delta": shown, "delta_order": order, "n": turns}
        if self.hulls[row].sides != 2:
            return made
        rudder, shaft = self.split[row].tolist()
        by_sides = shown + rudder, shown - rudder, turns * (1 + shaft), turns * (1 - shaft)
        return made | dict(zip(SIDED, by_sides, strict=True))

    def _rudder(self, row: int, times: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Order and angle of a row's rudder at some times, exactly: it goes evenly towards each order, then rests."""
        rate = self.ship.particulars.rudder_rate
        at, orders = (np.array(column) for column in zip(*self.orders[row], strict=True))
        order = orders[np.searchsorted(at, times + 1e-9, side="right") - 1]
        knots, angles, angle = [0.0], [0.0], 0.0
        for began, wanted, ends in zip(at, orders, [*at[1:], np.inf], strict=True):
            reached = min(began + abs(wanted - angle) / rate, ends)
            knots += [began, reached]
            angles += [angle, angle + np.sign(wanted - angle) * rate * (reached - began)]
            angle = angles[-1]
        return order, np.interp(times, knots, angles)


def _approach(ship: "RecursiveShip", controls: Float[Tensor, "rows _"], speed: Float[Tensor, " rows"]) -> Recursion:
    """Straight ahead at the approach speed, for long."""
    settings, count = ship.network.settings, len(speed)
    velocities, angles = speed.new_zeros(count, settings.freedom), speed.new_zeros(count, ship.angles_count)
    velocities[:, 0] = 1.0
    forces = ship.forces(velocities, angles, controls, ship.froude(speed))
    return Recursion(velocities, velocities, angles, speed.new_zeros(count), (forces,) * settings.past)


def _row(made: Unrolled, row: int) -> dict[str, np.ndarray]:
    """One run as arrays."""
    return {name: values[row].double().cpu().numpy() for name, values in made._asdict().items()}


def _recording(
    ship: "RecursiveShip", name: str, run: dict[str, np.ndarray], speed: float, times: Float[np.ndarray, " n"]
) -> Recording:
    """A run at even times in SI, cut where it leaves the physical range, which its status says."""
    length, names = ship.particulars.length, ship.network.settings.velocities
    units = np.array([length / speed if k in "pqr" else 1 / speed for k in names])
    angles = [ANGLES[k] for k in names if k in ANGLES]
    columns = np.concatenate([run["velocities"] / units, run["angles"], run["track"] * length], axis=1)
    seconds = run["time"] * length / speed
    needed = int(np.searchsorted(seconds, times[-1])) + 1  # a curve through later steps would be another one
    curve = CubicSpline(seconds[:needed], columns[:needed])
    channels = dict(zip((*names, *angles, "x", "y"), curve(times).T, strict=True))
    slopes = dict(zip(names, curve(times, 1)[:, : len(names)].T, strict=True))
    channels |= {f"{k}dot": slope for k, slope in slopes.items() if f"{k}dot" in {*ACCELERATION, "pdot"}}
    inside = _inside(channels, ship.particulars)
    count = max(int(np.argmin(inside)) if not inside.all() else len(times), 2)
    status = OK if inside.all() else left_range(float(times[count - 1]))
    meta: dict[str, Any] = {}
    return Recording(name, times[:count], {k: c[:count] for k, c in channels.items()}, status, meta)


def _inside(channels: dict[str, np.ndarray], ship: Particulars) -> np.ndarray:
    """Samples within the physical range."""
    state = torch.as_tensor(np.stack([channels[k] for k in ("u", "v", "r")], axis=-1))
    return inside_physical_range(state, ship).numpy()
