"""A job alone or in a sweep: a sweep survives a failing job and can be continued."""

import traceback
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig
from rich.console import Console

from manoeuvre_nn.entry import guard
from manoeuvre_nn.entry.config import register_resolvers
from manoeuvre_nn.entry.job import train

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
        with guard.one_line():  # here, not outside: hydra would put a line of its own before ours
            train(cfg, out, conf)
        return
    (out / ERROR).unlink(missing_ok=True)
    console = Console(quiet=True)
    try:
        outcome = train(cfg, out, conf, console)
        told = (
            "done before"
            if outcome is None
            else f"mean dev {outcome.mean_dev:.3g} L in {outcome.trained.seconds:.0f} s"
        )
    except Exception as error:  # whatever it is, the other jobs go on
        out.mkdir(parents=True, exist_ok=True)
        line = guard.explain(error) or f"{type(error).__name__}: {error}"
        (out / ERROR).write_text(f"{line}\n\n{traceback.format_exc()}")
        told = f"failed: {line}"
    job = HydraConfig.get().job
    print(f"#{job.num}  {job.override_dirname}: {told}", flush=True)
