"""The runs of Hess & Faller 2000 sailed by two ships that roll: circles and overshoots, in calm water and in wind."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import pi

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.four_degrees import FourDegreeShip
from manoeuvre_nn.ship.naval_vessel import naval_vessel

APPROACH = 60.0
"""Time from COMEX to EXECUTE [s]."""
STRAIGHT = 1.0
"""What is kept of the approach before EXECUTE, in L/U0."""
SIDES = ("starboard", "port")
INTERVAL, STEP = 1.0, 0.5
"""Time between samples, and of a Runge-Kutta step [s]."""
ANGLES_DEG = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
OVERSHOOT_ANGLES_DEG = (10.0, 20.0)
OVERSHOOT_SPEEDS_KN = (6.6, 15.7)
SPEEDS = 5
"""Approach speeds of the circles that are used for training and validation, evenly spaced."""


@dataclass(frozen=True)
class Counts:
    """How many runs a set has.

    Attributes:
        training: Runs whose errors move the weights.
        validation: Runs that only help to choose when training stops.
        unseen: Runs that are never used for anything but the last score.
    """

    training: int
    validation: int
    unseen: int

    @property
    def own(self) -> int:
        """Runs that the paper's tables are about."""
        return self.training + self.validation


@dataclass(frozen=True)
class RunSet:
    """Runs of one ship and one kind of trial.

    Attributes:
        ship: The ship.
        training: Runs whose errors move the weights.
        validation: Runs that only help to choose when training stops.
        unseen: Runs that are never used for anything but the last score.
    """

    ship: FourDegreeShip
    training: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    unseen: tuple[Recording, ...]

    @property
    def own(self) -> tuple[Recording, ...]:
        """Training and validation runs: what the paper's tables are about."""
        return self.training + self.validation


@dataclass(frozen=True)
class TrueWinds:
    """Winds that a set of runs is sailed in.

    Attributes:
        low: Least speed [m/s].
        high: Largest speed [m/s].
        off_deg: How far from the line of the approach the wind comes at most, from ahead or astern [deg].
        windage: Areas above the water over those usual for her size [-].
    """

    low: float
    high: float
    off_deg: float
    windage: float = 1.0

    def draw(self, draw: np.random.Generator) -> tuple[float, float]:
        """Speed [m/s], and where it comes from [deg]."""
        speed, off = draw.uniform(self.low, self.high), self.off_deg * draw.uniform(-1.0, 1.0)
        return float(speed), float(draw.choice([0.0, 180.0]) + off) % 360.0


@dataclass(frozen=True)
class PlannedRun:
    """A run before it is sailed.

    Attributes:
        manoeuvre: What is ordered, at which speed.
        wind_speed: True wind [m/s]; 0 is calm.
        wind_from_deg: Where it comes from [deg].
        heading: Of the approach [rad].
    """

    manoeuvre: Manoeuvre
    wind_speed: float = 0.0
    wind_from_deg: float = 0.0
    heading: float = 0.0


SHIPS: dict[int, Callable[[], FourDegreeShip]] = {
    1: lambda: container(screws=2, gm=1.0),
    2: lambda: naval_vessel(scale=2.5),
}
"""The paper does not name its ships. Ship 1: 175 m, heels some degrees in a turn with a metacentric height of 1 m; ship
2: a naval hull of 129 m."""
CIRCLE_SPEEDS_KN = {1: (10.0, 22.5), 2: (10.0, 30.0)}
CIRCLES = {1: Counts(12, 3, 6), 2: Counts(20, 5, 6)}
OVERSHOOTS = Counts(8, 2, 30)
WINDS = {
    "along": TrueWinds(3.0, 12.0, 0.0),
    "open ocean": TrueWinds(3.0, 12.0, 10.0),
    "strong": TrueWinds(6.0, 15.0, 10.0, 1.5),
}
"""Winds of the windy overshoots; the paper's course is parallel or antiparallel to a wind of which it says no more."""


@dataclass(frozen=True)
class PlannedSet:
    """A set of runs before it is sailed.

    Attributes:
        ship: The ship.
        runs: Own runs, then unseen ones.
        validation: Which of them are for validation.
        counts: How many there are of each.
    """

    ship: FourDegreeShip
    runs: Sequence[PlannedRun]
    validation: frozenset[int]
    counts: Counts

    def sailed(self) -> RunSet:
        """The runs."""
        runs, own = sail(self.ship, self.runs), range(self.counts.own)
        training = tuple(runs[k] for k in own if k not in self.validation)
        validation = tuple(runs[k] for k in own if k in self.validation)
        return RunSet(self.ship, training, validation, tuple(runs[len(own) :]))


@cache
def circles(ship: int, seed: int = 0, counts: Counts | None = None) -> RunSet:
    """Tactical circles in calm water, see :func:`plan_circles`."""
    return plan_circles(ship, seed, counts).sailed()


@cache
def overshoots(wind: str = "", seed: int = 0, counts: Counts | None = None) -> RunSet:
    """Horizontal overshoots of ship 2, see :func:`plan_overshoots`."""
    return plan_overshoots(wind, seed, counts).sailed()


def plan_circles(ship: int, seed: int = 0, counts: Counts | None = None) -> PlannedSet:
    """Tactical circles in calm water.

    Own runs: rudder angles of 10 to 35 deg at five speeds, as evenly as a draught board; a fifth of them to port.
    Validation runs have angles between the least and the largest. Unseen runs have any angle and speed in the range.

    Args:
        ship: 1 or 2.
        seed: Of what is drawn.
        counts: How many; by default the paper's 12 + 3 or 20 + 5, and 6 unseen.

    Returns:
        The plan.
    """
    counts = counts or CIRCLES[ship]
    draw = np.random.default_rng([seed, ship])
    low, high = CIRCLE_SPEEDS_KN[ship]
    speeds = np.linspace(low, high, SPEEDS).tolist()
    board = [(a, s, (i + j) % 2) for i, a in enumerate(ANGLES_DEG) for j, s in enumerate(speeds)]
    chosen = [(a, s) for a, s, odd in board if not odd] + [(a, s) for a, s, odd in board if odd]
    pairs = [chosen[k] for k in draw.permutation(counts.own)]
    to_port = _some(draw, counts.own, max(counts.own // 5, 1))
    inner = [k for k, (angle, _) in enumerate(pairs) if ANGLES_DEG[0] < angle < ANGLES_DEG[-1]]
    validation = frozenset(draw.permutation(inner)[: counts.validation].tolist())
    drawn = [(draw.uniform(ANGLES_DEG[0], ANGLES_DEG[-1]), draw.uniform(low, high)) for _ in range(counts.unseen)]
    to_port |= {counts.own + k for k in _some(draw, counts.unseen, counts.unseen // 3)}
    plans = [
        PlannedRun(replace(tactical_circle(round(a, 1), SIDES[k in to_port], APPROACH), speed=s * KNOT))
        for k, (a, s) in enumerate([*pairs, *drawn])
    ]
    return PlannedSet(SHIPS[ship](), plans, validation, counts)


def plan_overshoots(wind: str = "", seed: int = 0, counts: Counts | None = None) -> PlannedSet:
    """Horizontal overshoots of ship 2: 10 and 20 deg in turn, some to port first.

    Two runs in turn share a wind; they are sailed on opposite courses, north and south.

    Args:
        wind: Key of ``WINDS``; empty for calm water.
        seed: Of what is drawn; with and without wind the same manoeuvres follow.
        counts: How many; by default the paper's 8 + 2, and 30 unseen.

    Returns:
        The plan. Windy runs hold the wind as recorded: wind_speed, wind_from.
    """
    counts = counts or OVERSHOOTS
    draw = np.random.default_rng([seed, 3])
    low, high = OVERSHOOT_SPEEDS_KN
    speeds = draw.permutation(np.linspace(low, high, counts.own)).tolist()
    speeds += draw.uniform(low, high, counts.unseen).tolist()
    to_port = _some(draw, counts.own, round(0.3 * counts.own))
    to_port |= {counts.own + k for k in _some(draw, counts.unseen, round(0.3 * counts.unseen))}
    # One of 10 and one of 20 deg, and so on.
    first = 2 * draw.permutation(max(counts.own // 2, 1))
    validation = frozenset(int(first[k % len(first)]) + k % 2 for k in range(counts.validation))
    plans, air = [], (0.0, 0.0)
    for k, speed in enumerate(speeds):
        manoeuvre = overshoot(OVERSHOOT_ANGLES_DEG[k % 2], SIDES[k in to_port], APPROACH)
        if wind and k % 2 == 0:
            air = WINDS[wind].draw(draw)
        plans.append(PlannedRun(replace(manoeuvre, speed=speed * KNOT), *air, heading=pi * (k % 2)))
    hull = SHIPS[2]()
    usual, windage = hull.particulars.above_water, WINDS[wind].windage if wind else 1.0
    areas = replace(usual, frontal=windage * usual.frontal, lateral=windage * usual.lateral)
    hull.particulars = replace(hull.particulars, wind_areas=areas)
    return PlannedSet(hull, plans, validation, counts)


def _some(draw: np.random.Generator, count: int, wanted: int) -> set[int]:
    """Some of so many numbers."""
    return set(draw.permutation(count)[:wanted].tolist())


class OwnShaftSpeeds(Model):
    """A ship in calm water of which every row turns its own shaft speed: runs of all speeds are one batch."""

    def __init__(self, ship: FourDegreeShip, ratio: Float[Tensor, " rows"]) -> None:
        """Give each row its shaft speed.

        Args:
            ship: The ship.
            ratio: Shaft speed of each row over the ship's own [-].
        """
        super().__init__()
        self.calm, self.ratio = CalmWater(ship), ratio

    @property
    def hull(self) -> FourDegreeShip:
        """The ship."""
        assert isinstance(self.calm.ship, FourDegreeShip)
        return self.calm.ship

    @property
    def own_names(self) -> tuple[str, ...]:
        """Those of the ship."""
        return self.calm.own_names

    def forward(self, state: Float[Tensor, "*times rows n"], inputs: Inputs) -> Float[Tensor, "*times rows n"]:
        """Rate of the state."""
        return self.calm(state, replace(inputs, shaft=self.ratio))

    def on_approach(self, speed: float) -> "OwnShaftSpeeds":
        """Not defined: every row has its own speed.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("every row has its own approach speed")


def sail(ship: FourDegreeShip, plans: Sequence[PlannedRun]) -> list[Recording]:
    """Sail runs as one batch, recorded once a second, the approach cut to L/U0 before EXECUTE as in the paper.

    Args:
        ship: The ship.
        plans: What is to be sailed; all in calm water or all in wind.

    Returns:
        One recording a plan, named ``01_circle20_port_16.2kn``; time begins at 0, the position where the ship then is.
    """
    manoeuvres = [plan.manoeuvre for plan in plans]
    hulls = [ship.on_approach(m.speed or ship.particulars.speed) for m in manoeuvres]
    speeds = ship.inertia.new_tensor([hull.particulars.speed for hull in hulls])
    ratio = speeds.new_tensor([hull.shaft / ship.shaft for hull in hulls])
    model = OwnShaftSpeeds(ship, ratio)
    air = [_wind(ship, plans)] if plans[0].wind_speed else []
    vessel = Vessel(model, air)
    start = nn.functional.pad(speeds[:, None], (0, 7))
    start[:, 5] = start.new_tensor([plan.heading for plan in plans])
    last = max(m.duration_for(h.particulars) for m, h in zip(manoeuvres, hulls, strict=True))
    with torch.no_grad():
        made = rollout(vessel, manoeuvres, start, torch.arange(0.0, last, INTERVAL).to(start), step=STEP)
        rates = vessel.model(made.states, made.inputs)
    turns = ratio * ship.shaft_rpm * RPM
    named = dict(zip(("u", "v", "r", "x", "y", "psi", *model.own_names), made.states.unbind(-1), strict=True))
    named |= {f"{name}dot": rates[..., k] for name, k in {"u": 0, "v": 1, "r": 2, "p": 7}.items()}
    named |= {"delta_order": made.orders}
    named |= {name: made.shown for name in ("delta", "delta_starboard", "delta_port")}
    named |= {name: turns.expand_as(made.shown) for name in ("n", "n_starboard", "n_port")}
    channels = {name: values.numpy() for name, values in named.items()}
    runs = []
    for k, (plan, hull) in enumerate(zip(plans, hulls, strict=True)):
        own = {name: values[:, k].copy() for name, values in channels.items()}
        runs.append(_cut(own, plan, k + 1, hull.particulars))
    return runs


def _wind(ship: FourDegreeShip, plans: Sequence[PlannedRun]) -> Effect:
    """A steady wind that is every row's own."""
    wind = SteadyWind(ship)
    names, values = [p.name for p in wind.declared], wind.values.repeat(len(plans), 1)
    for name, of_plan in {"speed": "wind_speed", "from_deg": "wind_from_deg"}.items():
        values[:, names.index(name)] = values.new_tensor([getattr(plan, of_plan) for plan in plans])
    return wind.at(values)


def _cut(channels: dict[str, np.ndarray], plan: PlannedRun, number: int, ship: Particulars) -> Recording:
    """A run from L/U0 before EXECUTE to its end, with the wind as recorded."""
    manoeuvre, time = plan.manoeuvre, INTERVAL * np.arange(len(channels["u"]))
    if plan.wind_speed:
        steady = np.ones(len(time))
        channels |= {"wind_speed": plan.wind_speed * steady, "wind_from": plan.wind_from_deg * DEGREE * steady}
    meta = {"ship": ship.name, "time_unit": ship.time_unit, "kind": manoeuvre.kind, "manoeuvre": manoeuvre}
    name = f"{number:02d}_{manoeuvre.name}_{ship.speed / KNOT:.1f}kn"
    end = manoeuvre.end(time, channels["delta_order"])
    run = Recording(name, time, channels, meta=meta).between(max(APPROACH - STRAIGHT * ship.time_unit, 0.0), end)
    moved = {axis: run[axis] - run[axis][0] for axis in ("x", "y")}
    return replace(run, time=run.time - run.time[0], channels={**run.channels, **moved})
