"""Train a neural model of a ship's manoeuvring and score it in closed loop: ``python train.py --help``."""

from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from manoeuvre_nn.entry.config import register_resolvers
from manoeuvre_nn.entry.guard import guarded

CONF = Path(__file__).parent / "conf"


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="train")
def main(cfg: DictConfig) -> None:
    """Run one job, or one of a sweep's.

    Args:
        cfg: The composed config.
    """
    from manoeuvre_nn.entry.run import run_job  # torch and lightning take seconds: --help need not wait for them

    run_job(cfg, Path(HydraConfig.get().runtime.output_dir), CONF)


if __name__ == "__main__":
    register_resolvers()
    guarded(main)
