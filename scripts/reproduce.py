"""Do a paper again, every table and figure beside ours: ``python scripts/reproduce.py --help``."""

import os
import sys
from pathlib import Path

from manoeuvre_nn.core.ending import listen

if __name__ == "__main__":
    listen()  # imports take seconds

import hydra  # noqa: E402
from omegaconf import DictConfig  # noqa: E402

from manoeuvre_nn.commands.guard import guarded  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
CONF = ROOT / "studies" / "reproduction"
sys.path.insert(0, str(ROOT))  # studies stand beside the package, not in it


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="reproduce")
def main(cfg: DictConfig) -> None:
    """Do the chapters of a paper.

    Args:
        cfg: The composed config.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: the processes share out the cores
    from studies.reproduction.job import run_reproduction  # torch takes seconds: --help need not wait for it

    run_reproduction(cfg)


if __name__ == "__main__":
    guarded(main)
