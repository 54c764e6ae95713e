"""Which manoeuvre to sail next for this ship and model: ``python scripts/excite.py --help``."""

from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from manoeuvre_nn.entry.config import register_resolvers
from manoeuvre_nn.entry.guard import guarded, inside

CONF = Path(__file__).resolve().parents[1] / "conf"


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="excite")
def main(cfg: DictConfig) -> None:
    """Advise a manoeuvre.

    Args:
        cfg: The composed config.
    """
    from manoeuvre_nn.entry.excitation_job import excite  # torch takes seconds: --help need not wait for it

    inside(excite, cfg, Path(HydraConfig.get().runtime.output_dir), CONF)


if __name__ == "__main__":
    register_resolvers()
    guarded(main)
