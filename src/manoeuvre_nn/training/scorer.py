"""The callback that scores what a network has learnt; checkpoints and early stopping ask it what is best."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import lightning as L
import numpy as np
from pydantic import BaseModel, ConfigDict

from manoeuvre_nn.core.data_files import read_as
from manoeuvre_nn.core.errors import InputError


class _StoredHistory(BaseModel):
    """What a checkpoint keeps of the scores."""

    model_config = ConfigDict(strict=True)
    history: list[dict[str, float]]


class Scorer(ABC, L.Callback):
    """Every k-th epoch, and after the last, score the network.

    Attributes:
        every: Epochs between scores.
        history: Epoch, training error and scores of every scored epoch.
    """

    monitor: ClassVar[str]
    """Score that decides which epoch is best: the smaller the better."""
    in_words: ClassVar[str]
    """That score in a few words, with its unit as a template of the number: ``held-out dev {:.3g} L``."""
    scored_on: ClassVar[str]
    """What is scored, as it stands in "the best of 8 scores on ..."."""
    for_others: ClassVar[str]
    """And in "a fair figure ... is a little worse"."""

    def __init__(self, every: int) -> None:
        """Set up.

        Args:
            every: Epochs between scores.

        Raises:
            InputError: If it is not positive.
        """
        if every < 1:
            raise InputError(f"scoring.every={every}: expected at least 1 epoch")
        self.every = every
        self.history: list[dict[str, float]] = []

    @abstractmethod
    def score(self, trainer: L.Trainer, pl_module: L.LightningModule) -> Mapping[str, float]:
        """Score the network as it is now.

        Args:
            trainer: The trainer.
            pl_module: The fit.

        Returns:
            Scores by name, :attr:`monitor` among them.
        """

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Score, if it is the turn of this epoch or it is the last one."""
        last = trainer.should_stop or trainer.current_epoch + 1 == trainer.max_epochs
        if (trainer.current_epoch + 1) % self.every and not last:
            return
        values = dict(self.score(trainer, pl_module))
        pl_module.log_dict(values, on_epoch=True)
        mse = float(trainer.callback_metrics.get("train/mse", np.nan))
        self.history.append({"epoch": float(trainer.current_epoch + 1), "train/mse": mse, **values})

    def scored(self, epoch: int) -> bool:
        """Whether an epoch, counted from 1, is the one that was scored last."""
        return bool(self.history) and self.history[-1]["epoch"] == epoch

    def error_of(self, row: Mapping[str, float]) -> float:
        """The error of a scored epoch by which a network is chosen."""
        return row[self.monitor]

    @property
    def best(self) -> dict[str, float]:
        """The scored epoch with the smallest error; the first of equals."""
        return min(self.history, key=self.error_of)

    def how_chosen(self) -> str:
        """How the best was chosen: a choice by a score makes that score a little too good."""
        return (
            f"The network is that of epoch {self.best['epoch']:.0f}, the best of {len(self.history)} scores on "
            f"{self.scored_on} (trainer.keep=last takes the last one); a fair figure {self.for_others} is a little "
            "worse."
        )

    def state_dict(self) -> dict[str, Any]:
        """The history, so that a resumed run goes on with it."""
        return {"history": self.history}

    def check_history(self, state_dict: Mapping[str, Any], path: Path) -> None:
        """Refuse a history of a checkpoint that is none; ``path`` is for the message."""
        damaged = f"checkpoint {path} is damaged: {self.state_key}"
        rows = read_as(_StoredHistory, state_dict, damaged).history
        if not all(self.monitor in row and row.get("epoch", 0.0) >= 1 for row in rows):
            raise InputError(f"{damaged}: a score lacks its epoch or {self.monitor}")

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the history up again."""
        self.history = list(state_dict["history"])
