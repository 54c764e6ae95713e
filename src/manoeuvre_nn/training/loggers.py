"""Where a training may be logged beside TensorBoard, and the settings by which loggers are chosen (``logger=``)."""

import csv
import os
import re
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import CSVLogger, MLFlowLogger

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import as_file_name
from manoeuvre_nn.core.writing import FolderInUse, locked, write_file
from manoeuvre_nn.training.dashboard import Dashboard, RunLogger

DASHBOARD, CSV, MLRUNS = "tensorboard", "csv", "mlruns"
"""Folders of the loggers: two of the run, and MLflow's own, which all runs share."""
RUN_ID = "mlflow_run.txt"
"""File of a run's folder with the number of its run in MLflow, in which a resumed run goes on."""
STORE, FILES_ALLOWED = "MLFLOW_TRACKING_URI", "MLFLOW_ALLOW_FILE_STORE"
"""MLflow's variables: a store of one's own, such as a server; and that a folder may be a store."""
PAUSE_S = 0.1
"""How often is looked whether another run has opened the store [s]."""


class LogTo(ABC):
    """Settings of a logger, which is opened when the training begins."""

    @abstractmethod
    def open(self, out: Path) -> RunLogger:
        """Open the log of the run in a folder; a run that is resumed goes on with its log."""


@dataclass(frozen=True)
class ToTensorBoard(LogTo):
    """TensorBoard's files, in the run's folder."""

    def open(self, out: Path) -> RunLogger:
        """Open them."""
        return Dashboard(out, DASHBOARD)


@dataclass(frozen=True)
class ToCsv(LogTo):
    """``csv/metrics.csv``, a row a step, and ``csv/hparams.yaml``, in the run's folder."""

    def open(self, out: Path) -> RunLogger:
        """Open them."""
        return _CsvLog(out)


@dataclass(frozen=True)
class ToMLflow(LogTo):
    """A run of MLflow's, in the folder ``mlruns`` here or where MLflow's own variable says.

    Attributes:
        experiment: Name of the experiment that the run belongs to.
    """

    experiment: str = "manoeuvre-nn"

    def __post_init__(self) -> None:
        """Look for the package.

        Raises:
            InputError: If it is not installed.
        """
        if find_spec("mlflow") is None:
            raise InputError("logger=mlflow needs MLflow, which is not installed: pip install 'manoeuvre-nn[mlflow]'")

    def open(self, out: Path) -> RunLogger:
        """Open it."""
        return _MLflowLog(out, self.experiment)


class _CsvLog(RunLogger, CSVLogger):
    """Lightning's, which would remove the file of a run that is resumed."""

    def __init__(self, out: Path) -> None:
        """Open the files in a run's folder."""
        before = _rows(out / CSV / "metrics.csv")
        super().__init__(out, name="", version=CSV, flush_logs_every_n_steps=1)
        if before:
            self.experiment.metrics += before
            self.save()

    def shown_by(self, folder: Path) -> str:
        """Where the file is."""
        return f"numbers over epochs: {folder / CSV / 'metrics.csv'}"


def _rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a file; none if it is missing."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


class _MLflowLog(RunLogger, MLFlowLogger):
    """Lightning's, with figures, and resumed in the same run."""

    def __init__(self, out: Path, experiment: str) -> None:
        """Open the run of a folder; a number of a run that is not there any more is given up."""
        store, server = Path(MLRUNS).resolve(), os.environ.get(STORE)
        if server is None:
            os.environ.setdefault(FILES_ALLOWED, "true")
        address, before = server or store.as_uri(), _number(out)
        super().__init__(experiment_name=experiment, run_name=out.name, tracking_uri=address, run_id=before)
        while not self._initialized:
            try:
                with locked(store if server is None else out):  # two that begin at once would both make the experiment
                    self._open(out)
            except FolderInUse:
                time.sleep(PAUSE_S)

    def _open(self, out: Path) -> None:
        """Find the run again, or begin one."""
        from mlflow.exceptions import MlflowException

        try:
            write_file(out / RUN_ID, str(self.run_id))
        except MlflowException as error:
            if self._run_id is None:
                raise InputError(f"logger=mlflow: {error}: see MLflow's variable {STORE}") from error
            self._run_id = None

    def shown_by(self, folder: Path) -> str:
        """The command that shows the store in a folder, or the address of another."""
        command = f"{FILES_ALLOWED}=true mlflow ui --backend-store-uri {MLRUNS}"
        return f"dashboard: {os.environ.get(STORE) or command}"

    def add_picture(self, name: str, path: Path, epoch: int) -> None:
        """Keep a figure that is written already."""
        self.experiment.log_artifact(self.run_id, str(path), "figures")

    def add_figure(self, name: str, figure: Any, epoch: int) -> None:
        """Keep a figure."""
        self.experiment.log_figure(self.run_id, figure, f"figures/epoch_{epoch}_{as_file_name(name)}.png")


def _number(out: Path) -> str | None:
    """The number of a folder's run; None if it has none yet."""
    path = out / RUN_ID
    said = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    return said if re.fullmatch("[0-9a-f]{32}", said) else None
