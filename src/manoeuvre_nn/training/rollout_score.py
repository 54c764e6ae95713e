"""The Lightning callback that scores held-out manoeuvres while a network learns."""

import copy
from collections.abc import Callable, Mapping
from typing import Any

import lightning as L
import numpy as np
import torch
from lightning.pytorch.loggers import TensorBoardLogger

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.scoring.held_out import HeldOut, Solver
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.training.fits import Fit

MONITOR = "score/dev_L"
"""What checkpoints and early stopping look at: mean over the held-out manoeuvres of the largest deviation over L."""

GENERALIZATION = "score/generalization"
"""What they look at instead where a fit states it: an error over training and held-out runs."""

Draw = Callable[[Recording, Recording], Mapping[str, Any]]
"""Reference and prediction -> name -> matplotlib figure."""


class RolloutScore(L.Callback):
    """Every k-th epoch, sail the held-out manoeuvres with the network in the loop and score them.

    Attributes:
        scores: The last scores.
        history: Epoch, training error, relRMSE of g and scores of every scored epoch.
    """

    def __init__(self, held_out: HeldOut, *, every: int = 1, solver: Solver = "torchdiffeq", figures_every: int = 0,
                 draw: Draw | None = None) -> None:  # fmt: skip
        """Set up.

        Args:
            held_out: Held-out manoeuvres.
            every: Epochs between scores.
            solver: ``torchdiffeq`` to a tolerance, or ``rollout``, all manoeuvres as one fixed-step batch.
            figures_every: Scores between figures in TensorBoard; 0 draws none.
            draw: Makes the figures of one manoeuvre.

        Raises:
            InputError: If ``every`` is not positive or the solver is unknown.
        """
        check_choice("scoring.solver", solver, ["torchdiffeq", "rollout"])
        if every < 1:
            raise InputError(f"scoring.every={every}: expected at least 1 epoch")
        self.held_out, self.every, self.solver = held_out, every, solver
        self.figures_every, self.draw = figures_every, draw
        self.scores: list[Score] = []
        self.history: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Score, if it is the turn of this epoch or it is the last one."""
        last = trainer.should_stop or trainer.current_epoch + 1 == trainer.max_epochs
        if (trainer.current_epoch + 1) % self.every and not last:
            return
        assert isinstance(pl_module, Fit)
        predictions = self.held_out.predict(for_solvers(pl_module.dynamics), self.solver)
        self.scores = self.held_out.score(predictions)
        values = scalars(self.scores)
        pl_module.log_dict(values, on_epoch=True)
        inputs, targets = trainer.datamodule.train_dataloader().dataset[0][:2]  # type: ignore[attr-defined]
        errors = pl_module.relative_rmse(inputs.to(pl_module.device), targets.to(pl_module.device))
        relative = {f"train/relrmse_{name}": float(e) for name, e in zip(pl_module.errors_of, errors, strict=True)}
        pl_module.log_dict(relative, on_epoch=True)
        chosen_by = pl_module.generalization_error(trainer.datamodule)  # type: ignore[attr-defined]
        if chosen_by is not None:
            values[GENERALIZATION] = chosen_by
            pl_module.log(GENERALIZATION, chosen_by, on_epoch=True)
        mse = float(trainer.callback_metrics.get("train/mse", np.nan))
        self.history.append({"epoch": float(trainer.current_epoch + 1), "train/mse": mse, **relative, **values})
        if self.draw and self.figures_every and len(self.history) % self.figures_every == 0:
            self._show(trainer, predictions)

    def _show(self, trainer: L.Trainer, predictions: list[Recording]) -> None:
        """Figures of every manoeuvre to TensorBoard."""
        if not isinstance(trainer.logger, TensorBoardLogger) or self.draw is None:
            return
        for reference, prediction in zip(self.held_out.references, predictions, strict=True):
            for name, figure in self.draw(reference, prediction).items():
                trainer.logger.experiment.add_figure(f"{reference.name}/{name}", figure, trainer.current_epoch + 1)

    def scored(self, epoch: int) -> bool:
        """Whether an epoch, counted from 1, is the one that was scored last."""
        return bool(self.history) and self.history[-1]["epoch"] == epoch

    @property
    def best(self) -> dict[str, float]:
        """The scored epoch with the smallest error; the first of equals."""
        return min(self.history, key=error_of)

    def state_dict(self) -> dict[str, Any]:
        """The history, so that a resumed run goes on with it."""
        return {"history": self.history}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the history up again."""
        self.history = list(state_dict["history"])


def error_of(row: Mapping[str, float]) -> float:
    """The error of a scored epoch by which a network is chosen."""
    return row.get(GENERALIZATION, row[MONITOR])


def for_solvers(dynamics: Model) -> Model:
    """A model as solvers want it: in double precision on the CPU, where a tolerance of 1e-6 means something."""
    parameter = next(dynamics.parameters())
    if parameter.dtype == torch.float64 and parameter.device.type == "cpu":
        return dynamics
    return copy.deepcopy(dynamics).double().cpu()


def scalars(scores: list[Score]) -> dict[str, float]:
    """Scores as TensorBoard scalars.

    Args:
        scores: One a manoeuvre.

    Returns:
        ``score/dev_L`` (mean), ``score/left_range`` (number of runs that left the physical range) and, by manoeuvre,
        dev/L, the nRMSE of u, v, r, psi and the errors of the criteria.
    """
    values = {
        MONITOR: float(np.mean([s.dev_L for s in scores])),
        "score/left_range": float(sum(s.status != OK for s in scores)),
    }
    for s in scores:
        values[f"{s.manoeuvre}/dev_L"] = s.dev_L
        values |= {f"{s.manoeuvre}/nrmse_{k}": v for k, v in s.nrmse.items()}
        values |= {f"{s.manoeuvre}/error_{k}": v for k, v in s.errors.items()}
    return values
