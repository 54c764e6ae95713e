"""Jobs alone and in a sweep: a sweep survives a failing job, can be continued, and ends in one table."""

import traceback
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig
from rich.console import Console

from manoeuvre_nn.entry import guard
from manoeuvre_nn.entry.config import register_resolvers
from manoeuvre_nn.entry.job import train
from manoeuvre_nn.report.sweep import sweep_rows, write_sweep

ERROR = "error.txt"


def run_job(cfg: DictConfig, out: Path, conf: Path) -> None:
    """Run one job; in a sweep its failure is written down and does not stop the others.

    Args:
        cfg: The config.
        out: Output folder.
        conf: The folder ``conf``.
    """
    register_resolvers()  # jobs of a sweep run in processes of their own
    if HydraConfig.get().mode != RunMode.MULTIRUN:
        train(cfg, out, conf)
        return
    (out / ERROR).unlink(missing_ok=True)
    console = Console(quiet=True)
    try:
        outcome = train(cfg, out, conf, console)
        told = "done before" if outcome is None else f"mean dev {outcome.mean_dev:.3g} L in {outcome.seconds:.0f} s"
    except Exception as error:  # whatever it is, the other jobs go on
        out.mkdir(parents=True, exist_ok=True)
        line = guard.explain(error) or f"{type(error).__name__}: {error}"
        (out / ERROR).write_text(f"{line}\n\n{traceback.format_exc()}")
        told = f"failed: {line}"
    job = HydraConfig.get().job
    print(f"#{job.num}  {job.override_dirname}: {told}", flush=True)


class SweepTable(Callback):
    """Hydra's callback: one table over all jobs when a sweep ends."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Say where the sweep goes and how to continue it.

        Args:
            config: The config, hydra's part included.
            kwargs: Hydra's further arguments.
        """
        folder = config.hydra.sweep.dir
        print(f"sweep into {folder}; to continue it later, add hydra.sweep.dir={folder}", flush=True)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Write ``sweep.csv``, ``sweep.md`` and ``sweep.png``, and print the table.

        Args:
            config: The config, hydra's part included.
            kwargs: Hydra's further arguments.
        """
        folder = Path(config.hydra.sweep.dir)
        Console().print(write_sweep(folder))
        guard.failed_jobs += [str(r["job"]) for r in sweep_rows(folder) if str(r["status"]).startswith("failed")]
        print(f"table: {folder / 'sweep.csv'}, {folder / 'sweep.md'}   figure: {folder / 'sweep.png'}")
