"""The Lightning callback that scores held-out manoeuvres while a network learns."""

import copy
from collections.abc import Callable, Mapping
from typing import Any

import lightning as L
import numpy as np
import torch

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.limits import Count, CountOrNone
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.scoring.held_out import HeldOut, Solver
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.training.dashboard import show_figures
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.scorer import Scorer

MONITOR = "score/dev_L"
"""What checkpoints and early stopping look at: mean over the held-out manoeuvres of the largest deviation over L."""

GENERALIZATION = "score/generalization"
"""What they look at instead where a fit states it: an error over training and held-out runs."""

Draw = Callable[[Recording, Recording], Mapping[str, Any]]
"""Reference and prediction -> name -> matplotlib figure."""


class RolloutScore(Scorer):
    """Every k-th epoch, sail the held-out manoeuvres with the network in the loop and score them.

    Attributes:
        scores: The last scores.
        history: Epoch, training error, relRMSE of g and scores of every scored epoch.
    """

    monitor = MONITOR
    in_words = "held-out dev {:.3g} L"
    scored_on = "these very manoeuvres"
    for_others = "for new manoeuvres"

    def __init__(self, held_out: HeldOut, *, every: Count = 1, solver: Solver = "torchdiffeq",
                 figures_every: CountOrNone = 0, draw: Draw | None = None) -> None:  # fmt: skip
        """Set up.

        Args:
            held_out: Held-out manoeuvres.
            every: Epochs between scores.
            solver: ``torchdiffeq`` to a tolerance, or ``rollout``, all manoeuvres as one fixed-step batch.
            figures_every: Scores between figures in TensorBoard; 0 draws none.
            draw: Makes the figures of one manoeuvre.
        """
        check_choice("scoring.solver", solver, ["torchdiffeq", "rollout"])
        super().__init__(every)
        self.held_out, self.solver = held_out, solver
        self.figures_every, self.draw = figures_every, draw
        self.scores: list[Score] = []

    def score(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, float]:
        """dev/L and the other scores of the held-out manoeuvres, relRMSE of g, and the error that the fit states."""
        assert isinstance(pl_module, Fit)
        predictions = self.held_out.predict(for_solvers(pl_module.dynamics), self.solver)
        self.scores = self.held_out.score(predictions)
        inputs, targets = trainer.datamodule.train_dataloader().dataset[0][:2]  # type: ignore[attr-defined]
        errors = pl_module.relative_rmse(inputs.to(pl_module.device), targets.to(pl_module.device))
        relative = {f"train/relrmse_{name}": float(e) for name, e in zip(pl_module.errors_of, errors, strict=True)}
        values = {**relative, **scalars(self.scores)}
        chosen_by = pl_module.generalization_error(trainer.datamodule)  # type: ignore[attr-defined]
        if chosen_by is not None:
            values[GENERALIZATION] = chosen_by
        if self.draw and self.figures_every and (len(self.history) + 1) % self.figures_every == 0:
            self._show(trainer, predictions)
        return values

    def _show(self, trainer: L.Trainer, predictions: list[Recording]) -> None:
        """Figures of every manoeuvre to the loggers."""
        for reference, prediction in zip(self.held_out.references, predictions, strict=True):
            drawn = self.draw(reference, prediction) if self.draw else {}
            show_figures(trainer, {f"{reference.name}/{name}": figure for name, figure in drawn.items()})

    def error_of(self, row: Mapping[str, float]) -> float:
        """The error that the fit states, or dev/L."""
        return row[GENERALIZATION] if GENERALIZATION in row else super().error_of(row)

    def how_chosen(self) -> str:
        """By the held-out manoeuvres, or by what the fit states."""
        if GENERALIZATION not in self.best:
            return super().how_chosen()
        return (
            f"The network is that of epoch {self.best['epoch']:.0f}, the best of {len(self.history)} by the error "
            "over training and held-out runs together (trainer.keep=last takes the last one); a fair figure for new "
            "manoeuvres is a little worse."
        )


def for_solvers(dynamics: Model) -> Model:
    """A model as solvers want it: in double precision on the CPU, where a tolerance of 1e-6 means something."""
    parameter = next(dynamics.parameters())
    if parameter.dtype == torch.float64 and parameter.device.type == "cpu":
        return dynamics
    return copy.deepcopy(dynamics).double().cpu()


def scalars(scores: list[Score]) -> dict[str, float]:
    """Scores by name, as they are logged.

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
