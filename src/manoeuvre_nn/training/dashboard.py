"""What TensorBoard shows of a training: held-out manoeuvres first, then their tracks, then the training itself.

TensorBoard puts cards into groups by what stands before the first stroke of their names, and sorts the groups.
"""

import re
from abc import ABC
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.loggers import Logger, TensorBoardLogger
from matplotlib.image import imread
from torch.utils.tensorboard.summary import hparams

HELD_OUT, TRACKS, TRAINING, DETAILS, FIGURES = "1 held-out", "2 tracks", "3 training", "4 {}", "5 figures"
"""Groups of cards in the order in which they are shown."""
MAIN = ("dev_L", "rms")
"""Errors of each manoeuvre, or of each set of records, that stand in the first group."""

CURVES = {
    "Held-out": {kind: f"{HELD_OUT}/{kind}.*" for kind in MAIN},
    "Training": {"mse": f"{TRAINING}/(validation_)?mse.*", "relrmse": f"{TRAINING}/relrmse.*"},
}
"""A page on which curves of a kind, those of all manoeuvres, share a chart: what their places match."""


class RunLogger(Logger, ABC):
    """One of Lightning's loggers, with what a run tells beside numbers over epochs; here of one that shows numbers."""

    def add_picture(self, name: str, path: Path, epoch: int) -> None:
        """Show a figure that is written already.

        Args:
            name: ``zz20/track``, ``training/forces``.
            path: The file, a PNG.
            epoch: Epochs done.
        """

    def add_figure(self, name: str, figure: Any, epoch: int) -> None:
        """Show a figure; ``name`` and ``epoch`` as in :meth:`add_picture`."""

    def shown_by(self, folder: Path) -> str:
        """What shows the log of a run.

        Args:
            folder: The run's folder as it is told.

        Returns:
            Words for the last line of a command.
        """
        return f"log: {folder}"

    def end(self, settings: Mapping[str, Any], scores: Mapping[str, float], epoch: int) -> None:
        """Write the last scores and the settings, and close the log.

        Args:
            settings: Settings that make a difference.
            scores: Scores of the network that is kept, by the names under which they were logged.
            epoch: Epochs done.
        """
        self.log_metrics(dict(scores), epoch)
        self.log_hyperparams(dict(settings))
        self.finalize("success")


class Dashboard(RunLogger, TensorBoardLogger):
    """TensorBoard's log of a training in a folder."""

    def __init__(self, out: Path, folder: str) -> None:
        """Open it.

        Args:
            out: Output folder.
            folder: Its part for TensorBoard's files.
        """
        super().__init__(out, name="", version=folder, default_hp_metric=False)

    def shown_by(self, folder: Path) -> str:
        """The command that shows it, beside the runs around it."""
        return f"dashboard: tensorboard --logdir {folder.parent}"

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Numbers over epochs by their places on the dashboard; Lightning's count of epochs is none."""
        shown = {place_of(name): value for name, value in metrics.items() if name != "epoch"}
        if shown:
            super().log_metrics(shown, step)

    def add_picture(self, name: str, path: Path, epoch: int) -> None:
        """Show a figure that is written already at its place."""
        self.experiment.add_image(image_place_of(name), imread(path), epoch, dataformats="HWC")

    def add_figure(self, name: str, figure: Any, epoch: int) -> None:
        """Show a figure at its place."""
        self.experiment.add_figure(image_place_of(name), figure, epoch)

    def end(self, settings: Mapping[str, Any], scores: Mapping[str, float], epoch: int) -> None:
        """Write the last scores, the table of settings beside them, and the page of curves; close the log."""
        self.log_metrics(scores, epoch)
        shown = {place_of(name): float(value) for name, value in scores.items()}
        writer = self.experiment._get_file_writer()
        for part in hparams(dict(settings), shown):
            writer.add_summary(part)
        self.experiment.add_custom_scalars(charts_of(shown))
        self.finalize("success")


def show_figures(trainer: L.Trainer, figures: Mapping[str, Any]) -> None:
    """Show figures (name -> figure) of the epoch that is just done wherever a training is logged."""
    for logger in trainer.loggers:
        if isinstance(logger, RunLogger):
            for name, figure in figures.items():
                logger.add_figure(name, figure, trainer.current_epoch + 1)


def charts_of(places: Iterable[str]) -> dict[str, dict[str, list[Any]]]:
    """The page of curves of a run: the mean squared error, and the kinds of its scores.

    Args:
        places: Where its last scores are shown.

    Returns:
        Heading -> chart -> its kind and what it shows, as TensorBoard wants it.
    """
    known = [f"{TRAINING}/mse", *places]
    found = {
        heading: {kind: ["Multiline", [such]] for kind, such in kinds.items() if any(re.match(such, p) for p in known)}
        for heading, kinds in CURVES.items()
    }
    return {heading: kinds for heading, kinds in found.items() if kinds}


def place_of(name: str) -> str:
    """Where a number is shown.

    Args:
        name: Of the number, as it was logged: ``zz20/dev_L``, ``score/dev_L``, ``train/mse``.

    Returns:
        Group and name of its card: ``1 held-out/dev_L zz20``, ``1 held-out/dev_L``, ``3 training/mse``.
    """
    of, _, what = name.rpartition("/")
    if of == "score":
        return f"{HELD_OUT}/{what}"
    if of in {"", "train"}:
        return f"{TRAINING}/{what}"
    if of == "noise":
        return f"{TRAINING}/noise {what}"
    return f"{HELD_OUT}/{what} {of}" if what in MAIN else f"{DETAILS.format(of)}/{what}"


def image_place_of(name: str) -> str:
    """Where a figure is shown: tracks before all others.

    Args:
        name: ``zz20/track``, ``training/forces``.

    Returns:
        Group and name of its card.
    """
    of, _, what = name.rpartition("/")
    return f"{TRACKS}/{of}" if what == "track" else f"{FIGURES}/{of} {what}".replace("/ ", "/")
