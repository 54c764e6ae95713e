"""A fit of an ensemble: a member an epoch, each solved to its end by variable projection."""

from typing import Any, Literal

import torch
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.optimizer.damping import Damping
from manoeuvre_nn.optimizer.restarts import Stops, minimise
from manoeuvre_nn.optimizer.semilinear import SemiLinear
from manoeuvre_nn.training.data import Batch
from manoeuvre_nn.training.fits import Fit

ALL_TRAINED = "all members trained"


class EnsembleFit(Fit):
    """Levenberg-Marquardt on the nodes' weights, all linear weights solved exactly at every step.

    A member is trained in one epoch, so that a kill costs one member at most, and a judgement is one of the ensemble so
    far. Members do not see each other.

    Source:
        Golub & Pereyra 1973; Kaufman 1975; Nielsen 1999 for the damping.
    """

    def __init__(
        self,
        dynamics: IdentifiedShip,
        *,
        epochs: int = 150,
        restarts: int = 1,
        damping: Literal["trainlm", "nielsen"] = "nielsen",
        goal: float = 0.0,
        min_fall: float = 1e-4,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: Known part, network and scaling.
            epochs: Levenberg-Marquardt steps of a member at most.
            restarts: Starts of a member, of which the one with the least error is kept.
            damping: ``nielsen`` or ``trainlm``.
            goal: Mean square error of the scaled forces at which a member is done.
            min_fall: Fall of the error over the error at which a member is done [-].

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

    @torch.no_grad()
    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Train the next member.

        Args:
            batch: All tuples.
            batch_idx: 0.
        """
        network, k = self.network, self.current_epoch
        x, y = self.scaled(batch[0], batch[1])
        design = vars(network.design(x))
        problem = SemiLinear(design.pop("features"), y, network.sees, **design)
        start = torch.cat([self._start(k, trial) for trial in range(self.restarts)])
        found = minimise(problem, start, damping=self.damping, stops=self.stops, at_once=1)
        best = found.weights[found.best : found.best + 1]
        network.input_weights[k] = problem.full(best)[0]
        network.output_weights[k] = problem.output_weights(best)[0]
        network.trained.fill_(k + 1)
        if len(batch[2]):
            held_x, held_y = self.scaled(batch[2], batch[3])
            self.log("train/validation_mse", (network(held_x) - held_y).square().mean())
        self.log("train/steps", float(found.epochs[found.best]))
        if k + 1 == network.members:
            self.stopped = ALL_TRAINED
        self.finish(batch, found.mse[found.best])

    def _start(self, member: int, trial: int) -> Tensor:
        """First free weights of a trial; the first trial's are those that the network was drawn with."""
        first: Any = self.network.input_weights[member] if trial == 0 else self.network.drawn(member, trial)
        return first[self.network.sees][None]
