"""A ship that moves by a recursive network: steps of constant length in L/U, from control histories alone."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.particulars import Particulars, WindAreas
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.core.wind import COEFFICIENTS, usual_kind
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.closed_loop_gradient import closed_loop
from manoeuvre_nn.dynamics.course import Course
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.recursion import MIN_SPEED, RecordedSteps, Recursion, Unrolled, track_of
from manoeuvre_nn.dynamics.recursive_runs import driven, steered
from manoeuvre_nn.network.force_modules import BasicForces, ForceConstants
from manoeuvre_nn.network.recursive import ForceSettings, RecursiveNetwork

Step = Callable[[Recursion, Float[Tensor, "rows _"], Float[Tensor, " rows"]], Recursion]
"""Where rows stand, controls and ``U0^2 / (g L)`` -> where they stand a step later."""


class RecursiveShip(Model):
    """A ship that is known by her particulars and shaft speed, and a recursive network for her motion.

    Velocities are non-dimensional by L and by the speed U0 at which a run begins. A step takes ``dt = step L/U`` with U
    of the last outputs; angles and track follow by the trapezoidal rule.

    Attributes:
        network: The network.
        forces: Its force modules.

    Source:
        Hess & Faller 2000, Fig. 1, eqs 2, 21 and 22; there angles follow by the rectangular rule, and rates are about
        axes that heel with the ship. Here u, v, r are about upright axes, as everywhere in the package.
    """

    def __init__(self, ship: Ship, network: RecursiveNetwork, step: Step | None = None) -> None:
        """Join ship and network.

        Args:
            ship: The ship.
            network: The network.
            step: What takes steps in the network's place: something that was written from it.
        """
        super().__init__()
        self._ship, self.network = [ship], network  # in a list, so that its coefficients are no part of the model
        self._step = step
        names = network.settings.velocities
        constants = force_constants(ship.particulars, network.forces)
        self.forces = BasicForces(constants, rolls="p" in names, pitches="q" in names, wind=network.settings.wind)
        self.angles_count = sum(name in "pqr" for name in names)

    @property
    def hull(self) -> Ship:
        """The ship."""
        return self._ship[0]

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
        return RecursiveShip(self.hull.on_approach(speed), self.network, self._step)

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
        if self._step is not None:
            return self._step(now, controls, froude)
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
        """Many steps in closed loop; gradients pass to the network's weights.

        Args:
            start: Where every row stands.
            controls: Time of every row in L/U0 -> controls then.
            speed: Approach speeds U0 [m/s].
            steps: How many.

        Returns:
            All steps; tracks begin at the origin.
        """
        made = closed_loop(self, start, controls, speed, steps)
        velocities, angles, time = (values.transpose(0, 1) for values in made)
        return Unrolled(velocities, angles, time, track_of(velocities, angles[..., -1], time))

    def joined(self, passed: Sequence[Recursion]) -> Unrolled:
        """Steps that follow each other, as one."""
        velocities, angles, time = (
            torch.stack(values, dim=1)
            for values in ([p.velocities for p in passed], [p.angles for p in passed], [p.time for p in passed])
        )
        return Unrolled(velocities, angles, time, track_of(velocities, angles[..., -1], time))

    def driven(self, recordings: Sequence[Recording], start: float) -> list[Recording]:
        """Runs by recorded controls, see :func:`.recursive_runs.driven`."""
        return driven(self, recordings, start)

    def steered(self, manoeuvres: Sequence[Manoeuvre], interval: float | None) -> list[Recording]:
        """Runs by a helmsman, see :func:`.recursive_runs.steered`."""
        return steered(self, manoeuvres, interval)

    def recorded(self, course: Course) -> RecordedSteps:
        """Recorded runs as this network would have seen them, step by step."""
        time = course.steps(self.network.settings.step)
        everyone = torch.arange(len(course.speed), device=time.device)
        motion = course.motion.rows(everyone).at(time)
        count, angles = len(self.network.settings.velocities), self.angles_count
        velocities, turned = motion[..., :count], motion[..., count : count + angles]
        controls = course.controls.rows(everyone).at(time)
        forces = self.forces(velocities, turned, controls, self.froude(course.speed)[:, None])
        return RecordedSteps(time, velocities, turned, forces)


def joined_model(
    ship: Ship | Particulars, known: Ship, network: Network, scaling: Scaling
) -> IdentifiedShip | RecursiveShip:
    """A network on a ship: one that predicts velocities goes from step to step, one that gives forces is integrated.

    Args:
        ship: The ship, or its particulars where no more is known.
        known: Known part of its forces.
        network: The network.
        scaling: Of a network that gives forces.

    Returns:
        The model.
    """
    if isinstance(network, RecursiveNetwork):
        return RecursiveShip(ship if isinstance(ship, Ship) else known, network)
    return IdentifiedShip(known, network, scaling)


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
