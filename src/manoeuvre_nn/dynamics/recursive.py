"""A ship that moves by a recursive network: steps of constant length in L/U, from control histories alone."""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.ship import Particulars, Ship, WindAreas
from manoeuvre_nn.core.wind import COEFFICIENTS, usual_kind
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.course import Course
from manoeuvre_nn.network.force_modules import GRAVITY, BasicForces, ForceConstants
from manoeuvre_nn.network.recursive import ForceSettings, RecursiveNetwork

MIN_SPEED = 0.05
"""Speed over U0 below which steps grow no longer."""


class Recursion(NamedTuple):
    """Where every row stands: the network's last outputs and what is kept of the past.

    Attributes:
        velocities: Last outputs, over U0 and U0/L.
        before: Those of one step before.
        angles: phi, theta, psi [rad], as far as the network has their rates.
        time: In L/U0.
        forces: Those of past steps, the latest first.
    """

    velocities: Float[Tensor, "rows freedom"]
    before: Float[Tensor, "rows freedom"]
    angles: Float[Tensor, "rows angles"]
    time: Float[Tensor, " rows"]
    forces: tuple[Float[Tensor, "rows columns"], ...]


class Unrolled(NamedTuple):
    """Runs in closed loop, the start first.

    Attributes:
        velocities: Over U0 and U0/L.
        angles: phi, theta, psi [rad], as far as the network has their rates.
        time: In L/U0.
        track: x and y over L.
    """

    velocities: Float[Tensor, "rows steps freedom"]
    angles: Float[Tensor, "rows steps angles"]
    time: Float[Tensor, "rows steps"]
    track: Float[Tensor, "rows steps 2"]


class RecursiveShip(Model):
    """A hull for its particulars and a recursive network for its motion.

    Velocities are non-dimensional by L and by the speed U0 at which a run begins. A step takes ``dt = step L/U`` with U
    of the last outputs; angles and track follow by the trapezoidal rule.

    Attributes:
        known: The ship, for dimensions, shaft speed and stability.
        network: The network.
        forces: Its force modules.

    Source:
        Hess & Faller 2000, Fig. 1, eqs 2, 21 and 22; there angles follow by the rectangular rule, and rates are about
        axes that heel with the ship. Here u, v, r are about upright axes, as everywhere in the package.
    """

    def __init__(self, known: Ship, network: RecursiveNetwork) -> None:
        """Join ship and network."""
        super().__init__()
        self.known, self.network = known, network
        names = network.settings.velocities
        constants = force_constants(known.particulars, network.settings.forces)
        self.forces = BasicForces(constants, rolls="p" in names, pitches="q" in names, wind=network.settings.wind)
        self.angles_count = sum(name in "pqr" for name in names)

    @property
    def hull(self) -> Ship:
        """The known ship."""
        return self.known

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Refuse: a recursive network knows the next step, not the rate of a state.

        Args:
            state: Not used.
            inputs: Not used.

        Raises:
            InputError: Always.
        """
        raise InputError("a recursive network goes from step to step, its state has no rate: choose another network")

    def on_approach(self, speed: float) -> "RecursiveShip":
        """The same network behind a hull that comes in at another speed."""
        return RecursiveShip(self.known.on_approach(speed), self.network)

    def froude(self, speed: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """``U0^2 / (g L)`` of approach speeds [m/s]."""
        return speed.square() / (GRAVITY * self.particulars.length)

    def advance(
        self, now: Recursion, controls: Float[Tensor, "rows _"], froude: Float[Tensor, " rows"], folded: tuple
    ) -> Recursion:
        """One step.

        Args:
            now: Where every row stands.
            controls: Rudder angles, shaft speeds and wind now, as :class:`.Course` has them.
            froude: ``U0^2 / (g L)``.
            folded: The network's weights, by ``RecursiveNetwork.folded``.

        Returns:
            Where every row stands a step later.
        """
        last, count = now.velocities, self.angles_count
        forces = (self.forces(last, now.angles, controls, froude), *now.forces)
        seen = self.network.join(forces, (last, now.before))
        new = self.network.answer(seen, folded)
        step = self.network.settings.step / torch.linalg.vector_norm(last[:, :2], dim=-1).clamp(min=MIN_SPEED)
        angles = torch.addcmul(now.angles, last[:, -count:] + new[:, -count:], 0.5 * step[:, None])
        return Recursion(new, last, angles, now.time + step, forces[:-1])

    def unroll(
        self,
        start: Recursion,
        controls: Callable[[Float[Tensor, " rows"]], Float[Tensor, "rows _"]],
        speed: Float[Tensor, " rows"],
        steps: int,
    ) -> Unrolled:
        """Many steps in closed loop; gradients pass through.

        Args:
            start: Where every row stands.
            controls: Time of every row in L/U0 -> controls then.
            speed: Approach speeds U0 [m/s].
            steps: How many.

        Returns:
            All steps; tracks begin at the origin.
        """
        folded, froude = self.network.folded(), self.froude(speed)
        passed = [start]
        for _ in range(steps):
            passed.append(self.advance(passed[-1], controls(passed[-1].time), froude, folded))
        velocities, angles, time = (
            torch.stack(values, dim=1)
            for values in ([p.velocities for p in passed], [p.angles for p in passed], [p.time for p in passed])
        )
        return Unrolled(velocities, angles, time, track_of(velocities, angles[..., -1], time))

    def recorded(self, course: Course) -> "RecordedSteps":
        """Recorded runs as this network would have seen them, step by step."""
        time = course.steps(self.network.settings.step)
        everyone = torch.arange(len(course.speed), device=time.device)
        motion = course.motion.rows(everyone).at(time)
        count, angles = len(self.network.settings.velocities), self.angles_count
        velocities, turned = motion[..., :count], motion[..., count : count + angles]
        controls = course.controls.rows(everyone).at(time)
        forces = self.forces(velocities, turned, controls, self.froude(course.speed)[:, None])
        return RecordedSteps(time, velocities, turned, forces)


class RecordedSteps(NamedTuple):
    """Recorded runs at the steps of a network.

    Attributes:
        time: In L/U0; a run that is over goes on with its last sample.
        velocities: Over U0 and U0/L.
        angles: phi, theta, psi [rad].
        forces: By the force modules.
    """

    time: Float[Tensor, "rows steps"]
    velocities: Float[Tensor, "rows steps freedom"]
    angles: Float[Tensor, "rows steps angles"]
    forces: Float[Tensor, "rows steps columns"]

    def start(self, rows: Int[Tensor, " some"], steps: Int[Tensor, " some"], past: int) -> Recursion:
        """Where a network stands that takes over at a step; what was before the run is filled with its start.

        Args:
            rows: Runs.
            steps: Steps of these runs.
            past: Past values that are kept.

        Returns:
            As many rows.
        """
        before = [self.forces[rows, (steps - k).clamp(min=0)] for k in range(1, past + 1)]
        last = self.velocities[rows, (steps - 1).clamp(min=0)]
        at = rows, steps
        return Recursion(self.velocities[at], last, self.angles[at], self.time[at], tuple(before))


def track_of(
    velocities: Float[Tensor, "rows steps freedom"], psi: Float[Tensor, "rows steps"], time: Float[Tensor, "rows steps"]
) -> Float[Tensor, "rows steps 2"]:
    """Track from the origin by the trapezoidal rule; non-dimensional."""
    u, v, cos, sin = velocities[..., 0], velocities[..., 1], psi.cos(), psi.sin()
    over_ground = torch.stack([u * cos - v * sin, u * sin + v * cos], dim=-1)
    passed = 0.5 * (over_ground[:, 1:] + over_ground[:, :-1]) * time.diff(dim=1)[..., None]
    return torch.cat([torch.zeros_like(over_ground[:, :1]), passed.cumsum(1)], dim=1)


def force_constants(ship: Particulars, settings: ForceSettings) -> ForceConstants:
    """Constants of the force modules for a ship with two propellers and two rudders, or one that is halved.

    Args:
        ship: The ship.
        settings: What is no particular of it.

    Returns:
        Non-dimensional numbers; the longitudinal metacentric height is taken as L, the rudders stand at the after end.
    """
    wind, square = ship.above_water, ship.length**2
    areas = WindAreas(
        wind.frontal / square,
        wind.lateral / square,
        wind.lateral_centre / ship.length,
        wind.length_overall / ship.length,
    )
    return ForceConstants(
        thrust=(float(settings.thrust[0]), float(settings.thrust[1])),
        wake=settings.wake,
        deduction=settings.deduction,
        diameter=settings.diameter * ship.draught / ship.length,
        rudder_area=0.5 * ship.rudder_area_ratio * ship.draught / ship.length,
        rudder_aspect=settings.aspect,
        rudder_position=-0.5,
        volume=ship.mass / ship.rho / ship.length**3,
        gm=ship.heeling.gm / ship.length,
        wind_areas=areas,
        wind_coefficients=COEFFICIENTS[usual_kind(ship)],
        water=ship.rho,
    )
