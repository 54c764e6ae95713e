"""One training: Lightning's trainer with our callbacks, resumed where it was left, ended with the network to keep."""

import logging
import signal
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import Any, Literal

import lightning as L
import torch
from lightning.pytorch.callbacks import Checkpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO
from rich.console import Console

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Count
from manoeuvre_nn.core.terminal import Say, Terminal
from manoeuvre_nn.core.waiting import PAUSE_S, waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.training.checkpoint import check_weights, load_weights, read_training
from manoeuvre_nn.training.dashboard import RunLogger
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.loggers import LogTo, ToTensorBoard
from manoeuvre_nn.training.scorer import Scorer

CHECKPOINTS = "checkpoints"
GPUS = ("gpu", "cuda")
"""Words for a graphics processor: of any make, or NVIDIA's."""
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
        loggers: Where it is logged.
    """

    max_epochs: Count
    patience: Count | None = None
    keep: Literal["best", "last"] = "best"
    resume: str = "auto"
    accelerator: str = "cpu"
    progress: bool = True
    loggers: Sequence[LogTo] = (ToTensorBoard(),)

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InputError: If one is out of range.
        """
        check_choice("trainer.keep", self.keep, ["best", "last"])
        check_choice("trainer.accelerator", self.accelerator, ["cpu", *GPUS, "auto"])
        if self.accelerator in GPUS and not _has_gpu(self.accelerator):
            raise InputError(
                f"trainer.accelerator={self.accelerator}: torch finds none here: write trainer.accelerator=cpu"
            )
        if self.resume not in {"auto", "never"} and not Path(self.resume).is_file():
            raise InputError(
                f"trainer.resume={self.resume}: expected auto, never, or the path of a .ckpt file that exists"
            )
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
        history: Scored epochs, see :class:`~manoeuvre_nn.training.scorer.Scorer`.
        chosen: How the network was chosen, in words.
        loggers: Where it was logged; the last scores go there too.
    """

    fit: Fit
    epochs: int
    seconds: float
    stopped: str
    history: Sequence[Mapping[str, float]]
    chosen: str
    loggers: Sequence[RunLogger]


def _has_gpu(kind: str) -> bool:
    """Whether there is what ``gpu`` or ``cuda`` stands for."""
    return torch.cuda.is_available() or (kind == "gpu" and torch.backends.mps.is_available())


@contextmanager
def _quiet() -> Generator[None]:
    """Lightning talks of GPUs, workers and folders that mean nothing here; its errors still come through."""
    names = ("lightning.pytorch", "lightning.fabric", "lightning.pytorch.utilities.rank_zero")
    levels = {log: log.level for log in map(logging.getLogger, names)}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="lightning.*")
        try:
            for log in levels:
                log.setLevel(logging.ERROR)
            yield
        finally:
            for log, level in levels.items():
                log.setLevel(level)


@_quiet()
def run(
    fit: Fit, data: L.LightningDataModule, scorer: Scorer, session: Session, out: Path, console: Console
) -> Trained:
    """Train.

    Args:
        fit: The fit with its first weights.
        data: What to train on, set up.
        scorer: The callback that scores what the network has not been trained on.
        session: How long, and what to keep.
        out: Output folder: checkpoints and TensorBoard's files go there.
        console: Where to show progress.

    Returns:
        What came of it.
    """
    keeper, graceful = _BestAndLast(scorer, out / CHECKPOINTS, session.patience), _GracefulStop(console)
    checkpoint = _resume_from(session, out, console)
    if checkpoint is not None:
        load_weights(fit, checkpoint)  # refuses another network's in one line; Lightning then restores everything
        _check_callbacks(fit, scorer, keeper, checkpoint)
    callbacks: list[L.Callback] = [scorer, graceful, keeper]
    if session.progress:
        callbacks.append(_RunProgress(scorer, console))
    loggers = [chosen.open(out) for chosen in session.loggers]
    if fit.on_processor and session.accelerator in GPUS:
        console.print(f"trainer.accelerator={session.accelerator}: this fit is computed on the processor")
    trainer = L.Trainer(
        accelerator="cpu" if fit.on_processor else session.accelerator,
        devices=1,
        max_epochs=session.max_epochs,
        callbacks=callbacks,
        plugins=[_WholeFiles()],
        logger=loggers,
        log_every_n_steps=1,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
    )
    began = perf_counter()
    try:
        with _going_on(trainer, checkpoint):
            trainer.fit(fit, datamodule=data, ckpt_path=checkpoint, weights_only=True)
    except SystemExit as end:  # which Lightning makes of ctrl-C, with another exit code
        raise (end.__context__ if isinstance(end.__context__, KeyboardInterrupt) else end) from None
    seconds = perf_counter() - began
    stopped = _why(fit, trainer, graceful.interrupted)
    if session.keep == "best" and keeper.best:
        fit.load_state_dict(keeper.best)
        if not (out / CHECKPOINTS / "best.ckpt").exists():  # resumed from another folder and nothing better since
            trainer.save_checkpoint(out / CHECKPOINTS / "best.ckpt")
    chosen = _choice(session, scorer)
    return Trained(fit, trainer.current_epoch, seconds, stopped, scorer.history, chosen, loggers)


def _resume_from(session: Session, out: Path, console: Console) -> Path | None:
    """The checkpoint to go on from, checked before Lightning sees it."""
    if session.resume == "never":
        return None
    path = out / CHECKPOINTS / "last.ckpt" if session.resume == "auto" else Path(session.resume)
    if session.resume == "auto" and not path.exists():
        return None
    epoch = read_training(path)["epoch"]
    console.print(f"going on from {path} after epoch {epoch + 1}", soft_wrap=True)
    return path


def _check_callbacks(fit: Fit, scorer: Scorer, keeper: "_BestAndLast", path: Path) -> None:
    """Refuse scores and best weights of a checkpoint that are not of this training; both are taken up by Lightning."""
    stored = read_training(path)["callbacks"]
    missing = [one.state_key for one in (scorer, keeper) if one.state_key not in stored]
    if missing:
        raise InputError(f"checkpoint {path} is damaged: callbacks has no {missing[0]}")
    scorer.check_history(stored[scorer.state_key], path)
    best, own = stored[keeper.state_key].get("best"), fit.state_dict()
    same = isinstance(best, dict) and (not best or set(best) == set(own))
    if not same or any(not isinstance(w, torch.Tensor) or w.shape != own[name].shape for name, w in best.items()):
        raise InputError(f"checkpoint {path} is damaged: its best weights are of another network, or none")
    check_weights(fit, best, path)


@contextmanager
def _going_on(trainer: L.Trainer, path: Path | None) -> Generator[None]:
    """Refuse a checkpoint that training breaks on before its first epoch is done, whatever it ends in."""
    try:
        yield
    except (OSError, MemoryError):
        raise
    except Exception as error:
        if path is None or trainer.current_epoch > read_training(path)["epoch"] + 1:
            raise
        said = " ".join(f"{'' if isinstance(error, InputError) else type(error).__name__} {error}".split())
        raise InputError(
            f"checkpoint {path} cannot be gone on from ({said[:120]}): write trainer.resume=never"
        ) from error


def _why(fit: Fit, trainer: L.Trainer, interrupted: bool) -> str:
    """Why training ended."""
    if interrupted:
        return CTRL_C
    if fit.stopped:
        return fit.stopped
    return ALL_EPOCHS if trainer.current_epoch >= (trainer.max_epochs or 0) else "no better held-out score"


def _choice(session: Session, scorer: Scorer) -> str:
    """How the network was chosen."""
    if session.keep == "last" or not scorer.history:
        return "The network is the last one of the training."
    return scorer.how_chosen()


class _BestAndLast(Checkpoint):
    """Stores ``last.ckpt`` after every epoch, ``best.ckpt`` after every score that is the best so far.

    Ends the fit when some scores in a row were no better. Lightning's own ModelCheckpoint renews ``last.ckpt`` only
    together with the best one, and its EarlyStopping wants a score in every epoch. The best weights are in
    ``last.ckpt`` too, so that a run may be resumed in another folder.

    Attributes:
        best: Weights at the best score; empty before the first.
    """

    def __init__(self, scorer: Scorer, folder: Path, patience: int | None = None) -> None:
        """Set up.

        Args:
            scorer: Says what is best; it must come first among the callbacks.
            folder: Where the files go.
            patience: How many scores in a row may bring nothing; None is any number.
        """
        self.scorer, self.folder, self.patience = scorer, folder, patience
        self.best: dict[str, torch.Tensor] = {}

    @property
    def state_key(self) -> str:
        """Its name in checkpoints, which those of earlier versions know it by."""
        return "BestAndLast"

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """End a fit that was resumed after it had gained nothing."""
        trainer.should_stop = trainer.should_stop or self._gains_nothing()

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Store, and end a fit that gains nothing."""
        if self.scorer.scored(trainer.current_epoch + 1):
            if self.scorer.best is self.scorer.history[-1]:
                self.best = {name: value.detach().clone() for name, value in pl_module.state_dict().items()}
                trainer.save_checkpoint(self.folder / "best.ckpt")
            trainer.should_stop = trainer.should_stop or self._gains_nothing()
        trainer.save_checkpoint(self.folder / "last.ckpt")

    def _gains_nothing(self) -> bool:
        """Whether as many scores in a row as are waited for were no better."""
        scores, count = [self.scorer.error_of(row) for row in self.scorer.history], self.patience
        return count is not None and len(scores) > count and min(scores[-count:]) >= min(scores[:-count])

    def state_dict(self) -> dict[str, Any]:
        """The best weights."""
        return {"best": self.best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the best weights up again."""
        self.best = dict(state_dict["best"])


class _WholeFiles(TorchCheckpointIO):
    """Writes a checkpoint as every file is written: a kill or a full disk leaves the one before."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        """Write a checkpoint; Lightning's options of storages elsewhere have no meaning here."""
        content = BytesIO()
        torch.save(checkpoint, content)
        write_file(Path(path), content.getvalue())


class _RunProgress(L.Callback):
    """What is trained, and how long it will take at most."""

    def __init__(self, scorer: Scorer, console: Console | None = None, seconds: float = PAUSE_S) -> None:
        """Set up the display; without a terminal there are some seconds between lines."""
        self.scorer, self._shown = scorer, waiting(console or Terminal(), seconds=seconds)
        self._say: Say | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Begin."""
        self._say = self._shown.__enter__()
        self._show(trainer, pl_module, trainer.current_epoch)

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """An epoch is done."""
        self._show(trainer, pl_module, trainer.current_epoch + 1)

    def _show(self, trainer: L.Trainer, pl_module: L.LightningModule, done: int) -> None:
        """Epochs that are done, the training error and the last score."""
        assert isinstance(pl_module, Fit) and self._say is not None
        metrics, count = trainer.callback_metrics, pl_module.epochs_of(trainer.max_epochs or done)
        note = f", mse {float(metrics['train/mse']):.2e}" if "train/mse" in metrics else ""
        if self.scorer.monitor in metrics:
            note += ", " + self.scorer.in_words.format(float(metrics[self.scorer.monitor]))
        self._say(f"training, {pl_module.epoch_is} {done}/{count}{note}", done / count)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """End."""
        self._close()

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        """End, so that the terminal is left in order."""
        self._close()

    def _close(self) -> None:
        if self._say is not None:
            self._shown.__exit__(None, None, None)
            self._say = None


class _GracefulStop(L.Callback):
    """The first ctrl-C ends the fit after the present epoch, with checkpoint and report; a second one at once."""

    def __init__(self, console: Console | None = None) -> None:
        """Say where to tell what happens."""
        self.console = console or Terminal()
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
            self.console.print("ctrl-C: stopping after this epoch, then scoring; once more to abort")

        try:
            self._before = signal.signal(signal.SIGINT, handle)
        except ValueError:
            self._before = None

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Give the signal back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
