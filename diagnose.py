"""Find out what a calm-water model leaves out of recorded manoeuvres: ``python diagnose.py --help``."""

from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from manoeuvre_nn.entry.guard import guarded, inside

CONF = Path(__file__).parent / "conf"


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="diagnose")
def main(cfg: DictConfig) -> None:
    """Diagnose a folder of cases, or a person's own recordings.

    Args:
        cfg: The composed config.
    """
    from manoeuvre_nn.entry.diagnosis_job import diagnose_all  # torch takes seconds: --help need not wait for it

    inside(diagnose_all, cfg, Path(HydraConfig.get().runtime.output_dir), CONF)


if __name__ == "__main__":
    guarded(main)
