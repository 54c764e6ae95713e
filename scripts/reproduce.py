"""Do a paper again, every table and figure beside ours: ``python scripts/reproduce.py --help``."""

import os
from pathlib import Path

import hydra
from omegaconf import DictConfig

from manoeuvre_nn.entry.guard import guarded

CONF = Path(__file__).resolve().parents[1] / "conf"


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="reproduce")
def main(cfg: DictConfig) -> None:
    """Do the chapters of a paper.

    Args:
        cfg: The composed config.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: the processes share out the cores
    from manoeuvre_nn.entry.reproduction_job import run_reproduction  # torch takes seconds: --help need not wait for it

    run_reproduction(cfg, CONF)


if __name__ == "__main__":
    guarded(main)
