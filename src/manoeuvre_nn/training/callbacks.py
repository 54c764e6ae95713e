"""Lightning callbacks: the rollout score, progress in the terminal, a graceful ctrl-C."""

import copy
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic
from types import FrameType
from typing import Any

import lightning as L
import numpy as np
import torch
from lightning.pytorch.callbacks import Checkpoint
from lightning.pytorch.loggers import TensorBoardLogger
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.scoring.held_out import HeldOut, Solver
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.training.fits import Fit

MONITOR = "score/dev_L"
"""What checkpoints and early stopping look at: mean over the held-out manoeuvres of the largest deviation over L."""

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
        relative = {f"train/relrmse_g{k + 1}": float(e) for k, e in enumerate(errors)}
        pl_module.log_dict(relative, on_epoch=True)
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
        """The scored epoch with the smallest mean deviation; the first of equals."""
        return min(self.history, key=lambda row: row[MONITOR])

    def state_dict(self) -> dict[str, Any]:
        """The history, so that a resumed run goes on with it."""
        return {"history": self.history}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the history up again."""
        self.history = list(state_dict["history"])


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


class BestAndLast(Checkpoint):
    """Stores ``last.ckpt`` after every epoch, ``best.ckpt`` after every score that is the best so far.

    Ends the fit when some scores in a row were no better. Lightning's own ModelCheckpoint renews ``last.ckpt`` only
    together with the best one, and its EarlyStopping wants a score in every epoch. The best weights are in
    ``last.ckpt`` too, so that a run may be resumed in another folder.

    Attributes:
        best: Weights at the best score; empty before the first.
    """

    def __init__(self, scorer: RolloutScore, folder: Path, patience: int | None = None) -> None:
        """Set up.

        Args:
            scorer: Says what is best; it must come first among the callbacks.
            folder: Where the files go.
            patience: How many scores in a row may bring nothing; None is any number.
        """
        self.scorer, self.folder, self.patience = scorer, folder, patience
        self.best: dict[str, torch.Tensor] = {}

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Store, and end a fit that gains nothing."""
        if self.scorer.scored(trainer.current_epoch + 1):
            if self.scorer.best is self.scorer.history[-1]:
                self.best = {name: value.detach().clone() for name, value in pl_module.state_dict().items()}
                self._store(trainer, "best.ckpt")
            scores, count = [row[MONITOR] for row in self.scorer.history], self.patience
            if count is not None and len(scores) > count and min(scores[-count:]) >= min(scores[:-count]):
                trainer.should_stop = True
        self._store(trainer, "last.ckpt")

    def _store(self, trainer: L.Trainer, name: str) -> None:
        """Write beside the old file and take its place at once, so that a kill in between damages neither."""
        part = self.folder / f"{name}.part"
        trainer.save_checkpoint(part)
        part.replace(self.folder / name)

    def state_dict(self) -> dict[str, Any]:
        """The best weights."""
        return {"best": self.best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the best weights up again."""
        self.best = dict(state_dict["best"])


class RunProgress(L.Callback):
    """One bar for the whole fit where a person watches, a line now and then where nobody does."""

    def __init__(self, console: Console | None = None, seconds: float = 15.0) -> None:
        """Set up the display; without a terminal there are some seconds between lines."""
        self.console, self.seconds = console or Console(), seconds
        self._bar: Progress | None = None
        self._shown = 0.0

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Open the bar."""
        self._shown = monotonic()
        if not self.console.is_terminal:
            return
        epoch = TextColumn("epoch {task.completed}/{task.total}  {task.fields[note]}")
        columns = (
            TextColumn("training"),
            BarColumn(),
            epoch,
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        self._bar = Progress(*columns, console=self.console, transient=True)
        self._bar.start()
        self._bar.add_task("fit", total=trainer.max_epochs, completed=trainer.current_epoch, note="")

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Show the epoch, the training error and the last score."""
        metrics = trainer.callback_metrics
        note = f"mse {float(metrics['train/mse']):.2e}" if "train/mse" in metrics else ""
        if MONITOR in metrics:
            note += f"  held-out dev {float(metrics[MONITOR]):.3g} L"
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=trainer.current_epoch + 1, note=note)
        elif monotonic() - self._shown > self.seconds:
            self._shown = monotonic()
            self.console.print(f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}  {note}")

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Close the bar."""
        self._close()

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        """Close the bar, so that the terminal is left in order."""
        self._close()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


class GracefulStop(L.Callback):
    """The first ctrl-C ends the fit after the present epoch, with checkpoint and report; a second one at once."""

    def __init__(self, console: Console | None = None) -> None:
        """Say where to tell what happens."""
        self.console = console or Console()
        self.interrupted = False
        self._before: Any = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Take the signal over; not possible outside the main thread, where nobody presses keys.

        Not earlier: when a fit breaks, Lightning restores the handlers that it met before it began to train.

        Args:
            trainer: The trainer.
            pl_module: The fit.
        """

        def handle(number: int, frame: FrameType | None) -> None:
            self.interrupted = True
            trainer.should_stop = True
            signal.signal(signal.SIGINT, self._before)
            self.console.print("ctrl-C: stopping after this epoch; once more to abort")

        try:
            self._before = signal.signal(signal.SIGINT, handle)
        except ValueError:
            self._before = None

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Give the signal back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
