"""The table at the end of a sweep; apart from the jobs, so that hydra need not load torch to call it."""

from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from manoeuvre_nn.commands import guard
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.report.sweep import sweep_rows, write_sweep


class SweepTable(Callback):
    """Hydra's callback: one table over all jobs when a sweep ends; until then its folder is the sweep's alone."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Say where the sweep goes and how to continue it."""
        folder = config.hydra.sweep.dir
        with guard.one_line():  # hydra makes a warning of what goes wrong here, unless it ends the command
            guard.until_the_end.enter_context(locked(Path(folder)))
        print(f"sweep into {folder}; to continue it later, add hydra.sweep.dir={folder}", flush=True)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Let go of a job's config: hydra would keep those of all jobs until the sweep ends, .2 MB each."""
        job_return.cfg = job_return.hydra_cfg = None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Write the tables, figures and page of the sweep, and print the table."""
        folder = Path(config.hydra.sweep.dir)
        with guard.one_line(), guard.until_the_end:
            Terminal().print(write_sweep(folder))
            guard.failed_jobs += [str(r["job"]) for r in sweep_rows(folder) if str(r["status"]).startswith("failed")]
            print(f"table: {folder / 'sweep.csv'}, {folder / 'sweep.md'}   page: {folder / 'sweep.html'}")
