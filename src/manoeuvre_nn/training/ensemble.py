"""A fit of an ensemble: a member an epoch, each solved to its end by variable projection."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import torch
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.optimizer.damping import Damping
from manoeuvre_nn.optimizer.restarts import Stops, minimise
from manoeuvre_nn.optimizer.semilinear import SemiLinear
from manoeuvre_nn.training.closed_loop import Refinement, refine
from manoeuvre_nn.training.data import Batch
from manoeuvre_nn.training.fits import Fit

ALL_TRAINED = "all members trained"
STEPS = (0, 1, 2, 3, 5, 8, 12, 20, 40, 80)
"""Numbers of steps that are tried where the data carry noise."""
BLOCKS, JUDGES = 3, 4
"""Stretches of time, one of which at a time is predicted from the others; members that are asked."""


class EnsembleFit(Fit):
    """Levenberg-Marquardt on the nodes' weights, all linear weights solved exactly at every step.

    A member is trained in one epoch, so that a kill costs one member at most, and a judgement is one of the ensemble so
    far. Members do not see each other.

    Where accelerations are exact a member is trained to its end. Where they carry noise that would be to learn the
    noise: as many steps are taken as let a few members, trained on two thirds of the time, predict the g of the third
    best.

    Source:
        Golub & Pereyra 1973; Kaufman 1975; Nielsen 1999 for the damping; Stone 1974 for cross-validation.
    """

    steps: Tensor

    def __init__(
        self,
        dynamics: IdentifiedShip,
        *,
        epochs: int = 150,
        restarts: int = 1,
        damping: Literal["trainlm", "nielsen"] = "nielsen",
        goal: float = 0.0,
        min_fall: float = 1e-4,
        refine: Mapping[str, float] | None = None,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: Known part, network and scaling.
            epochs: Levenberg-Marquardt steps of a member at most.
            restarts: Starts of a member, of which the one with the least error is kept.
            damping: ``nielsen`` or ``trainlm``.
            goal: Mean square error of the scaled forces at which a member is done.
            min_fall: Fall of the error over the error at which a member is done [-].
            refine: Settings of a closed-loop :class:`.Refinement` of every member; None is none.

        Raises:
            InputError: If the network is no ensemble or a number is out of range.
        """
        super().__init__(dynamics, iterations_per_epoch=1)
        if not isinstance(dynamics.network, HullRudder):
            raise InputError("fit=ensemble trains network=hull_rudder or hull_rudder_shaft: choose one, or another fit")
        if epochs < 1 or restarts < 1:
            raise InputError(f"fit.epochs={epochs}, fit.restarts={restarts}: expected at least 1 of each")
        self.restarts, self.damping = restarts, Damping(damping)
        self.stops = Stops(epochs=epochs, goal=goal, min_fall=min_fall)
        self.refinement = Refinement(**(refine or {}))  # type: ignore[arg-type]
        self.register_buffer("steps", torch.tensor(-1))

    @property
    def network(self) -> HullRudder:
        """The ensemble."""
        assert isinstance(self.dynamics.network, HullRudder)
        return self.dynamics.network

    def configure_optimizers(self) -> None:
        """None: every member has an optimizer of its own, see :func:`~manoeuvre_nn.optimizer.restarts.minimise`."""

    def scaled(self, inputs: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Prime tuples as every member sees them.

        Args:
            inputs: u', v', r', delta, shape (n, 4).
            targets: g', shape (n, 3).

        Returns:
            Scaled inputs and targets.
        """
        return self.dynamics.scaling.inputs(inputs), self.dynamics.scaling.outputs(targets)

    def on_train_start(self) -> None:
        """Leave an ensemble that was resumed when it was complete as it is."""
        if int(self.network.trained) >= self.network.members:
            self.stopped, self.trainer.should_stop = ALL_TRAINED, True

    @torch.no_grad()
    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Train the next member.

        Args:
            batch: All tuples.
            batch_idx: 0.
        """
        network, k = self.network, self.current_epoch
        x, y = self.scaled(batch[0], batch[1])
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        if self.steps < 0:
            self.steps.fill_(self.stops.epochs if data.exact else self.steps_that_predict(x, y))
        problem = self.problem(x, y)
        start = torch.cat([self._start(k, trial) for trial in range(self.restarts)])
        stops = replace(self.stops, epochs=int(self.steps))
        found = minimise(problem, start, damping=self.damping, stops=stops, at_once=1)
        best = found.weights[found.best : found.best + 1]
        network.input_weights[k] = problem.full(best)[0]
        network.output_weights[k] = problem.output_weights(best)[0]
        network.trained.fill_(k + 1)
        if self.refinement.steps:
            network.output_weights[k] = refine(self.dynamics, k, data.recordings, x, self.refinement)[0]
        if len(batch[2]):
            held_x, held_y = self.scaled(batch[2], batch[3])
            self.log("train/validation_mse", (network(held_x) - held_y).square().mean())
        self.log("train/steps", float(found.epochs[found.best]))
        if k + 1 == network.members:
            self.stopped = ALL_TRAINED
        # Without the ridge, and after a refinement.
        own = network.with_weights(network.input_weights[k : k + 1], network.output_weights[k : k + 1])
        self.finish(batch, (own(x) - y).square().mean())

    def problem(self, x: Tensor, y: Tensor) -> SemiLinear:
        """What a member solves.

        Args:
            x: Scaled inputs (n, 4).
            y: Scaled targets (n, 3).

        Returns:
            The least-squares problem.
        """
        design = vars(self.network.design(x)).copy()
        return SemiLinear(design.pop("features"), y, self.network.sees, shrink=self.network.shrink, **design)

    def steps_that_predict(self, x: Tensor, y: Tensor) -> int:
        """Number of steps after which stretches of time that were not trained on are predicted best.

        Args:
            x: Scaled inputs (n, 4), in the order of time.
            y: Scaled targets (n, 3).

        Returns:
            One of :data:`STEPS`, or the largest number allowed.
        """
        tried = [*(s for s in STEPS if s < self.stops.epochs), self.stops.epochs]
        errors = x.new_zeros(len(tried))
        for block in torch.arange(len(x)).tensor_split(BLOCKS):
            rest = torch.ones(len(x), dtype=torch.bool)
            rest[block] = False
            errors += self._errors(self.problem(x[rest], y[rest]), x[block], y[block], tried)
        return tried[int(errors.argmin())]

    def _errors(self, problem: SemiLinear, x: Tensor, y: Tensor, tried: list[int]) -> Tensor:
        """Sums of squares of the median of a few members on tuples that they were not trained on, by steps taken."""
        weights = torch.cat([self._start(k, 0) for k in range(min(JUDGES, self.network.members))])
        sums, taken = [], 0
        for steps in tried:
            if steps > taken:
                stops = Stops(epochs=steps - taken, min_fall=self.stops.min_fall)
                weights = minimise(problem, weights, damping=self.damping, stops=stops, at_once=1).weights
                taken = steps
            judges = self.network.with_weights(problem.full(weights), problem.output_weights(weights))
            sums.append((judges(x) - y).square().sum())
        return torch.stack(sums)

    def _start(self, member: int, trial: int) -> Tensor:
        """First free weights of a trial; the first trial's are those that the network was drawn with."""
        first: Any = self.network.input_weights[member] if trial == 0 else self.network.drawn(member, trial)
        return first[self.network.sees][None]
