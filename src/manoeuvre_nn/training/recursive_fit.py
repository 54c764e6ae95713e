"""A fit of a recursive network in closed loop: backpropagation through time on windows that grow to whole runs."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any

import lightning as L
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.limits import as_seed
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.scoring.error_measures import run_measures
from manoeuvre_nn.training.data import Batch, ManoeuvreData
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.recursive_windows import GrowingWindows, RecursiveFitSettings

DONE = "all stages done"
UPDATES_PER_EPOCH = 20
"""Updates whose windows are drawn from one seed, that of the run and the epoch."""


@dataclass(frozen=True)
class FitPlan:
    """Length of a training without a trainer.

    Attributes:
        updates: Number of updates, to which the stages are stretched; None is as many as they have.
        every: Updates between tests of the generalization.
        seed: Of the windows that are drawn.
    """

    updates: int | None = None
    every: int = 100
    seed: int = 0


def fit_recursive(
    model: RecursiveShip,
    training: Sequence[Recording],
    validation: Sequence[Recording] = (),
    *,
    settings: RecursiveFitSettings | None = None,
    plan: FitPlan | None = None,
    say: Callable[[Mapping[str, float]], None] | None = None,
) -> list[dict[str, float]]:
    """Train a recursive network without a trainer: for studies of many of them.

    The network keeps the weights of the best generalization.

    Args:
        model: Ship and network; the network is trained in place.
        training: Runs to train on.
        validation: Runs that the generalization is tested on beside these.
        settings: How it is trained; by default as in ``conf/fit/recursive.yaml``.
        plan: How long.
        say: Called with every row of the history as it comes.

    Returns:
        A row a test: ``update``, ``loss``, ``cpu_s``, and what :func:`generalization` gives.
    """
    plan, chosen = plan or FitPlan(), settings or RecursiveFitSettings()
    windows, total = GrowingWindows(model, training, chosen), plan.updates or chosen.updates
    optimizer, history, losses, began = windows.optimizer(), [], [], process_time()
    best, kept = np.inf, copy.deepcopy(model.network.state_dict())
    for number in range(total):
        if number % UPDATES_PER_EPOCH == 0:
            draw = torch.Generator().manual_seed(_seed(plan.seed, number // UPDATES_PER_EPOCH))
        losses.append(windows.update(optimizer, number, total, draw)[0])
        optimizer.step()
        if (number + 1) % plan.every and number + 1 < total:
            continue
        found = generalization(model, [*training, *validation])
        loss, losses = float(torch.stack(losses).mean()), []
        history.append({"update": float(number + 1), "loss": loss, "cpu_s": process_time() - began, **found})
        if 1 - found["average_angle"] < best:
            best, kept = 1 - found["average_angle"], copy.deepcopy(model.network.state_dict())
        if say is not None:
            say(history[-1])
    model.network.load_state_dict(kept)
    return history


def generalization(model: RecursiveShip, runs: Sequence[Recording]) -> dict[str, float]:
    """Error measures over u, x, y, phi, psi and runs that are driven by their recorded controls.

    Args:
        model: Ship and network.
        runs: The runs.

    Returns:
        ``absolute`` (a mean of m/s, m and deg, as in the source), ``average_angle`` and ``correlation`` [-].

    Source:
        Hess & Faller 2000, "Training procedure" and Fig. 7.
    """
    measured = [run_measures(p, r).mean() for p, r in zip(replay(model, runs), runs, strict=True)]
    return {name: float(np.mean([m[name] for m in measured])) for name in ("absolute", "average_angle", "correlation")}


def _seed(seed: int, epoch: int) -> int:
    """Seed of an epoch's windows: it depends on nothing else, so that a resumed run draws the same."""
    return as_seed(seed * 1_000_003 + epoch)


class RecursiveFit(Fit):
    """Backpropagation through time with Adam; an epoch is some updates.

    See :class:`.GrowingWindows` for what it is trained on.

    Source:
        Hess & Faller 2000, "Training procedure": gradient descent, 100 000 epochs, stopped at the best generalization,
        which is tested every 10 epochs on training and validation runs together. Here Adam and growing windows.
    """

    made_for = RecursiveNetwork
    errors_of = ("u", "v", "r")
    dynamics: RecursiveShip  # type: ignore[assignment]

    def __init__(
        self,
        dynamics: RecursiveShip,
        settings: RecursiveFitSettings | None = None,
        *,
        iterations_per_epoch: int = 20,
        seed: int = 0,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: Ship and network.
            settings: How it is trained.
            iterations_per_epoch: Updates in an epoch.
            seed: Of the windows that are drawn.
        """
        super().__init__(dynamics, iterations_per_epoch)
        self.settings, self.seed = settings or RecursiveFitSettings(), seed

    @property
    def network(self) -> RecursiveNetwork:
        """The network."""
        return self.dynamics.network

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam."""
        return self.windows.optimizer()

    def setup(self, stage: str) -> None:
        """Bring the recordings into dimensionless steps, and scale the network to them."""
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        assert isinstance(data, ManoeuvreData)
        self.windows = GrowingWindows(self.dynamics, data.recordings, self.settings)

    def on_train_start(self) -> None:
        """Bring the steps to the device and floating type that is trained on."""
        super().on_train_start()
        self.windows.material = self.windows.prepared()

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Some updates.

        Args:
            batch: Not used: nothing is learnt from tuples.
            batch_idx: 0.
        """
        optimizer: Any = self.optimizers()
        inner, count = optimizer.optimizer, self.iterations_per_epoch
        draw = torch.Generator().manual_seed(_seed(self.seed, self.current_epoch))
        losses = []
        for k in range(count):
            loss, stage, rate = self.windows.update(inner, self.current_epoch * count + k, self.settings.updates, draw)
            # Lightning counts one step an epoch; its wrapper would cost more than the step itself.
            (optimizer if k == count - 1 else inner).step()
            losses.append(loss)
        if (self.current_epoch + 1) * count >= self.settings.updates:
            self.stopped = DONE
        self.log("train/rate", rate)
        self.log("train/steps", float(stage.steps or int(self.windows.material.counts.max())))
        self.finish(batch, torch.stack(losses).mean())

    @torch.no_grad()
    def relative_rmse(self, inputs: Float[Tensor, "n 4"], targets: Float[Tensor, "n 3"]) -> Float[Tensor, " 3"]:
        """Root mean square error of u, v and r a step ahead over their standard deviation.

        Args:
            inputs: Not used: the network does not learn forces.
            targets: Not used.

        Returns:
            For u, v, r [-].
        """
        self.windows.material = self.windows.prepared()  # the network may have moved to another device
        errors = self.windows.step_errors()
        return inputs.new_tensor([errors[name] for name in self.errors_of])

    def generalization_error(self, data: L.LightningDataModule) -> float | None:
        """One less the average angle measure, over u, x, y, phi, psi, training and held-out runs.

        The runs are driven by their recorded controls.

        Args:
            data: What is trained on, and what is held out.

        Returns:
            The error [-], 0 for a perfect prediction; None where the network is chosen by held-out runs alone.

        Source:
            Hess & Faller 2000, "Training procedure".
        """
        if self.settings.choose_by == "held_out":
            return None
        assert isinstance(data, ManoeuvreData)
        return 1 - generalization(self.dynamics, [*data.recordings, *data.held_out.references])["average_angle"]
