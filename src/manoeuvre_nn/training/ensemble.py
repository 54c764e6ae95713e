"""A fit of an ensemble: a member an epoch, each solved to its end by variable projection."""

from dataclasses import replace
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import NotNegative
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.numerics.damping import Damping, Stops
from manoeuvre_nn.numerics.restarts import Solutions, minimise
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.training.data import Batch
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.rollout_refinement import Refinement
from manoeuvre_nn.training.rollout_refinement import refine as refined
from manoeuvre_nn.training.scalings import make_scaling

ALL_TRAINED = "all members trained"
STEP_TRIALS = (3, 5, 8, 12, 20, 40, 80)
"""Numbers of steps that are tried where the data carry noise; fewer leave the nodes much as they were drawn."""
VALIDATION_BLOCKS, VALIDATION_MEMBERS = 12, 4
"""Stretches of time, one of which at a time is predicted from the others; members that predict it."""
DEFAULT_STOPS = Stops(epochs=150, min_fall=1e-4)
"""When a member is done, as in ``conf/fit/ensemble.yaml``."""
MAX_WORSE_TRIALS = 3
"""Numbers of steps that are tried after the best one so far, before it is taken."""


class EnsembleFit(Fit):
    """Levenberg-Marquardt on the nodes' weights, all linear weights solved exactly at every step.

    A member is trained in one epoch, so that a kill costs one member at most, and a score is one of the ensemble so
    far. Members do not see each other.

    Where accelerations are exact a member is trained to its end. Where they carry noise that would be to learn the
    noise: as many steps are taken as let a few members, trained on eleven twelfths of the time, best predict the g of
    the twelfth.

    Source:
        Golub & Pereyra 1973; Kaufman 1975; Nielsen 1999 for the damping; Stone 1974 for cross-validation.
    """

    made_for = HullRudder
    epoch_is = "member"
    steps: Tensor

    def __init__(
        self,
        dynamics: IdentifiedShip,
        *,
        epochs: int = 150,
        restarts: int = 1,
        damping: Literal["trainlm", "nielsen"] = "nielsen",
        goal: NotNegative = 0.0,
        min_fall: NotNegative = 1e-4,
        refine: Refinement | None = None,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: Known part, network and scaling.
            epochs: Levenberg-Marquardt steps of a member at most.
            restarts: Starts of a member, of which the one with the least error is kept.
            damping: ``nielsen`` or ``trainlm``.
            goal: Mean square error of the scaled forces at which a member is done.
            min_fall: Fall of the error over the error at which a member is done [-].
            refine: Closed-loop refinement of every member; None is none.

        Raises:
            InputError: If the network is no :class:`.HullRudder` or a number is out of range.
        """
        super().__init__(dynamics, iterations_per_epoch=1)
        if epochs < 1 or restarts < 1:
            raise InputError(f"fit.epochs={epochs}, fit.restarts={restarts}: expected at least 1 of each")
        self.restarts, self.damping = restarts, Damping(damping)
        self.stops = Stops(epochs=epochs, goal=goal, min_fall=min_fall)
        self.refinement = refine or Refinement()
        self.register_buffer("steps", torch.tensor(-1))

    def epochs_of(self, most: int) -> int:
        """One a member."""
        return min(most, self.network.members)

    @property
    def network(self) -> HullRudder:
        """The ensemble."""
        assert isinstance(self.dynamics.network, HullRudder)
        return self.dynamics.network

    def configure_optimizers(self) -> None:
        """None: every member has an optimizer of its own, see :func:`~manoeuvre_nn.numerics.restarts.minimise`."""

    def scaled(self, inputs: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Prime tuples as every member sees them."""
        return self.dynamics.scaling.inputs(inputs), self.dynamics.scaling.outputs(targets)

    @torch.no_grad()
    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Train the next member."""
        network, k = self.network, self.current_epoch
        x, y = self.scaled(batch[0], batch[1])
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        if self.steps < 0:
            enough = self.stops.epochs if data.exact else steps_that_predict(network, x, y, self.stops, self.damping)
            self.steps.fill_(enough)
        stops = replace(self.stops, epochs=int(self.steps))
        found = _train_member(network, k, x, y, stops=stops, damping=self.damping, restarts=self.restarts)
        if self.refinement.steps:
            network.output_weights[k] = refined(self.dynamics, k, data.recordings, x, self.refinement)[0]
        if len(batch[2]):
            held_x, held_y = self.scaled(batch[2], batch[3])
            self.log("train/validation_mse", (network(held_x) - held_y).square().mean())
        self.log("train/steps", float(found.epochs[found.best]))
        if k + 1 == network.members:
            self.stopped = ALL_TRAINED
        # Without the ridge, and after a refinement.
        own = network.with_weights(network.input_weights[k : k + 1], network.output_weights[k : k + 1])
        self.finish(batch, (own(x) - y).square().mean())


@torch.no_grad()
def steps_that_predict(
    network: HullRudder, x: Float[Tensor, "n 4"], y: Float[Tensor, "n 3"], stops: Stops, damping: Damping | None = None
) -> int:
    """Number of steps after which stretches of time that were not trained on are predicted best.

    Args:
        network: The ensemble.
        x: Scaled inputs, in the order of time.
        y: Scaled targets.
        stops: When a member is done.
        damping: Rule of mu; by default Nielsen's.

    Returns:
        One of :data:`STEP_TRIALS`, or the largest number allowed.
    """
    first = torch.cat([_start(network, k) for k in range(min(VALIDATION_MEMBERS, network.members))])
    blocks = torch.arange(len(x)).tensor_split(VALIDATION_BLOCKS)
    rests = [torch.cat([*blocks[:k], *blocks[k + 1 :]]) for k in range(VALIDATION_BLOCKS)]
    problems = [network.least_squares(x[rest], y[rest]) for rest in rests]
    weights, taken, errors = [first] * VALIDATION_BLOCKS, 0, list[float]()
    tried = [*(s for s in STEP_TRIALS if s < stops.epochs), stops.epochs]
    for steps in tried:
        if steps > taken:
            more, taken = replace(stops, epochs=steps - taken), steps
            weights = [
                minimise(problem, start, damping=damping, stops=more, at_once=1).weights
                for problem, start in zip(problems, weights, strict=True)
            ]
        total = 0.0
        for problem, found, block in zip(problems, weights, blocks, strict=True):
            members = network.with_weights(problem.full(found), problem.output_weights(found))
            total += float((members(x[block]) - y[block]).square().sum())
        errors.append(total)
        if len(errors) - errors.index(min(errors)) > MAX_WORSE_TRIALS:
            break
    return tried[errors.index(min(errors))]


def steps_in_noise(model: IdentifiedShip, tuples: Tuples, stops: Stops = DEFAULT_STOPS) -> int:
    """Steps in which members are trained where tuples carry noise, see :func:`steps_that_predict`."""
    assert isinstance(model.network, HullRudder)
    x, y = model.scaling.inputs(tuples.inputs), model.scaling.outputs(tuples.targets)
    return steps_that_predict(model.network, x, y, stops)


@torch.no_grad()
def _train_member(
    network: HullRudder,
    member: int,
    x: Float[Tensor, "n 4"],
    y: Float[Tensor, "n 3"],
    *,
    stops: Stops,
    damping: Damping | None = None,
    restarts: int = 1,
) -> Solutions:
    """Solve for a member's weights and put them into the ensemble; it answers from then on."""
    problem = network.least_squares(x, y)
    start = torch.cat([_start(network, member, trial) for trial in range(restarts)])
    found = minimise(problem, start, damping=damping, stops=stops, at_once=1)
    best = found.weights[found.best : found.best + 1]
    network.input_weights[member] = problem.full(best)[0]
    network.output_weights[member] = problem.output_weights(best)[0]
    network.trained.fill_(member + 1)
    return found


def train_ensemble(
    known: Ship, network: HullRudder, tuples: Tuples, stops: Stops = DEFAULT_STOPS, *, exact: bool = True
) -> IdentifiedShip:
    """Train a whole ensemble without a trainer: for studies of many of them.

    Args:
        known: Known part that the tuples were formed with.
        network: The ensemble.
        tuples: Samples.
        stops: When a member is done.
        exact: Whether the samples carry no noise; else as many steps are taken as predict.

    Returns:
        The model.
    """
    model = IdentifiedShip(known, network, make_scaling(network.scalings[0], known, tuples))
    x, y = model.scaling.inputs(tuples.inputs), model.scaling.outputs(tuples.targets)
    if not exact:
        stops = replace(stops, epochs=steps_in_noise(model, tuples, stops))
    for member in range(network.members):
        _train_member(network, member, x, y, stops=stops)
    return model


def _start(network: HullRudder, member: int, trial: int = 0) -> Float[Tensor, "1 p"]:
    """First free weights of a trial."""
    return network.drawn(member, trial)[network.sees][None]
