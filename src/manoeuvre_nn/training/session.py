"""One training: Lightning's trainer with our callbacks, resumed where it was left, ended with the network to keep."""

import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import lightning as L
from lightning.pytorch.loggers import TensorBoardLogger
from rich.console import Console

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.training.callbacks import BestAndLast, GracefulStop, RolloutScore, RunProgress
from manoeuvre_nn.training.checkpoint import load_weights, read_checkpoint
from manoeuvre_nn.training.data import ManoeuvreData
from manoeuvre_nn.training.fits import Fit

CHECKPOINTS, DASHBOARD = "checkpoints", "tensorboard"
CTRL_C, ALL_EPOCHS = "ctrl-C", "all epochs done"
"""Why a training ended that may be gone on with: interrupted, or more epochs wanted."""


@dataclass(frozen=True)
class Session:
    """How long to train and what to keep.

    Attributes:
        max_epochs: Epochs at most.
        patience: Scores in a row without a better one after which training ends; None never.
        keep: Network that is kept: ``best`` by the held-out score, or ``last``.
        resume: ``auto`` goes on from the folder's last checkpoint if there is one, ``never`` starts anew, else the path
            of a checkpoint.
        accelerator: ``cpu`` or ``gpu``.
        progress: Whether to show progress.
    """

    max_epochs: int
    patience: int | None = None
    keep: Literal["best", "last"] = "best"
    resume: str = "auto"
    accelerator: str = "cpu"
    progress: bool = True

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InputError: If one is out of range.
        """
        check_choice("trainer.keep", self.keep, ["best", "last"])
        check_choice("trainer.accelerator", self.accelerator, ["cpu", "gpu", "cuda", "auto"])
        for name, value in (("max_epochs", self.max_epochs), ("patience", self.patience)):
            if value is not None and value < 1:
                raise InputError(f"trainer.{name}={value}: expected at least 1")


@dataclass(frozen=True)
class Trained:
    """A training that has ended; the fit holds the weights that are kept.

    Attributes:
        fit: The fit.
        epochs: Epochs trained.
        seconds: Time that it took [s].
        stopped: Why it ended.
        history: Scored epochs, see :class:`~manoeuvre_nn.training.callbacks.RolloutScore`.
        chosen: How the network was chosen, in words.
        logger: TensorBoard's.
    """

    fit: Fit
    epochs: int
    seconds: float
    stopped: str
    history: Sequence[Mapping[str, float]]
    chosen: str
    logger: TensorBoardLogger

    def add_image(self, name: str, image: Any, epoch: int) -> None:
        """Show a picture, height x width x colour from 0 to 1."""
        self.logger.experiment.add_image(name, image, epoch, dataformats="HWC")

    def close(self, settings: Mapping[str, Any], scores: Mapping[str, float]) -> None:
        """Write the hparams table and end the log."""
        self.logger.log_hyperparams(dict(settings), dict(scores))
        self.logger.finalize("success")


def run(fit: Fit, data: ManoeuvreData, scorer: RolloutScore, session: Session, out: Path, console: Console) -> Trained:
    """Train.

    Args:
        fit: The fit with its first weights.
        data: What to train on, set up.
        scorer: The callback that scores held-out manoeuvres.
        session: How long, and what to keep.
        out: Output folder: checkpoints and TensorBoard's files go there.
        console: Where to show progress.

    Returns:
        What came of it.
    """
    _quiet()
    checkpoint = _resume_from(session, out, console)
    if checkpoint is not None:
        load_weights(fit, checkpoint)  # refuses another network's in one line; Lightning then restores everything
    keeper, graceful = BestAndLast(scorer, out / CHECKPOINTS, session.patience), GracefulStop(console)
    callbacks: list[L.Callback] = [scorer, graceful, keeper]
    if session.progress:
        callbacks.append(RunProgress(console))
    logger = TensorBoardLogger(out, name="", version=DASHBOARD, default_hp_metric=False)
    trainer = L.Trainer(
        accelerator=session.accelerator,
        devices=1,
        max_epochs=session.max_epochs,
        callbacks=callbacks,
        logger=logger,
        log_every_n_steps=1,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
    )
    began = perf_counter()
    trainer.fit(fit, datamodule=data, ckpt_path=checkpoint, weights_only=True)
    seconds = perf_counter() - began
    stopped = _why(fit, trainer, graceful.interrupted)
    if session.keep == "best" and keeper.best:
        fit.load_state_dict(keeper.best)
        if not (out / CHECKPOINTS / "best.ckpt").exists():  # resumed from another folder and nothing better since
            trainer.save_checkpoint(out / CHECKPOINTS / "best.ckpt")
    chosen = _choice(session, scorer)
    return Trained(fit, trainer.current_epoch, seconds, stopped, scorer.history, chosen, logger)


def _resume_from(session: Session, out: Path, console: Console) -> Path | None:
    """The checkpoint to go on from, checked before Lightning sees it."""
    if session.resume == "never":
        return None
    path = out / CHECKPOINTS / "last.ckpt" if session.resume == "auto" else Path(session.resume)
    if session.resume == "auto" and not path.exists():
        return None
    epoch = read_checkpoint(path)["epoch"]
    console.print(f"going on from {path} after epoch {epoch + 1}", soft_wrap=True)
    return path


def _why(fit: Fit, trainer: L.Trainer, interrupted: bool) -> str:
    """Why training ended."""
    if interrupted:
        return CTRL_C
    if fit.stopped:
        return fit.stopped
    return ALL_EPOCHS if trainer.current_epoch >= (trainer.max_epochs or 0) else "no better held-out score"


def _choice(session: Session, scorer: RolloutScore) -> str:
    """How the network was chosen: a choice by the held-out score makes that score a little too good."""
    if session.keep == "last" or not scorer.history:
        return "The network is the last one of the training."
    return (
        f"The network is that of epoch {scorer.best['epoch']:.0f}, the best of {len(scorer.history)} scores on these "
        "very manoeuvres (trainer.keep=last takes the last one); a fair figure for new manoeuvres is a little worse."
    )


def _quiet() -> None:
    """Lightning talks of GPUs, workers and folders that mean nothing here; its errors still come through."""
    for name in ("lightning.pytorch", "lightning.fabric", "lightning.pytorch.utilities.rank_zero"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module="lightning.*")
