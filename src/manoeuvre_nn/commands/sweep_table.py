"""The table at the end of a sweep; apart from the jobs, so that hydra need not load torch to call it."""

import logging
from contextlib import ExitStack
from math import prod
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.provenance import shown
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.waiting import loading, waiting
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.report.sweep import ERROR, SCORES, job_folders, sweep_rows, write_sweep

_shown = ExitStack()
"""What is shown until the sweep ends; not the callback's own, for that is sent to every job."""


class SweepTable(Callback):
    """Hydra's callback: one table over all jobs when a sweep ends; until then its folder is the sweep's alone."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Say where the sweep goes and how to continue it."""
        folder = shown(Path(config.hydra.sweep.dir))
        with guard.one_line():  # hydra makes a warning of what goes wrong here, unless it ends the command
            guard.until_the_end.enter_context(locked(folder))
        logging.getLogger("optuna").setLevel(logging.WARNING)  # a search would write a line of its own for each trial
        console = Terminal()
        console.print(f"sweep into {folder}; to continue it later, add out={folder}", soft_wrap=True)
        count = jobs_of(config)
        loading.close()
        guard.until_the_end.enter_context(_shown)
        _shown.enter_context(waiting(console, "sweep", poll=lambda: how_far(folder, count)))

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Let go of a job's config: hydra would keep those of all jobs until the sweep ends, .2 MB each."""
        job_return.cfg = job_return.hydra_cfg = None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Write the tables, figures and page of the sweep, and print the table."""
        folder = shown(Path(config.hydra.sweep.dir))
        _shown.close()
        with guard.one_line(), guard.until_the_end:
            Terminal().print(write_sweep(folder))
            guard.failed_jobs += [str(r["job"]) for r in sweep_rows(folder) if str(r["status"]).startswith("failed")]
            where = f"table: {folder / 'sweep.csv'}, {folder / 'sweep.md'}   page: {folder / 'sweep.html'}"
            Terminal().print(where, soft_wrap=True, highlight=False)


def jobs_of(config: DictConfig) -> int:
    """How many jobs a sweep has: the product of the choices, or the trials of a search."""
    trials = config.hydra.sweeper.get("n_trials")
    words = OverridesParser.create().parse_overrides(list(config.hydra.overrides.task))
    swept = [word for word in words if word.is_sweep_override()]
    return int(trials or prod(sum(1 for _ in word.sweep_string_iterator()) for word in swept))


def how_far(folder: Path, count: int) -> tuple[str, float]:
    """What is done of a sweep of so many jobs, and which share of them."""
    done = sum(any((job / name).is_file() for name in (SCORES, ERROR)) for job in job_folders(folder))
    return f"sweep, {done} of {count} jobs done", min(done / count, 1.0)
