"""What a second person needs to make a result again: resolved config, seed, versions."""

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig

from manoeuvre_nn import __version__
from manoeuvre_nn.commands.shelves import plain
from manoeuvre_nn.core.data_files import FORMAT, OVERRIDES, load_yaml, overrides_of, without_format
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file

CONFIG, SCORES = "config.yaml", "scores.json"
LIBRARIES: tuple[str, ...] = (
    "torch", "lightning", "hydra-core", "torchdiffeq", "tensorboard", "numpy", "scipy", "statsmodels", "pandas",
    "matplotlib",
)  # fmt: skip
NOT_COMPARED = ("name", "trainer.progress", "trainer.resume", "trainer.max_epochs", "logger")
"""Settings, and groups, in which a resumed run may differ from what it resumes."""


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    ours = {"manoeuvre-nn": __version__, "python": platform.python_version(), "platform": platform.platform()}
    return ours | {library: version(library) for library in LIBRARIES}


def shown(out: Path) -> Path:
    """A path as one would type it here."""
    return out.relative_to(Path.cwd()) if out.is_relative_to(Path.cwd()) else out


def write_provenance(cfg: DictConfig, out: Path) -> None:
    """Write the resolved config and the versions into the output folder, before anything is computed."""
    told = {"format": FORMAT, **plain(cfg), "versions": versions()}
    text = yaml.safe_dump(told, sort_keys=False, allow_unicode=True)
    write_file(out / CONFIG, text)  # two processes may share the folder: neither reads half a file


def check_same_run(cfg: DictConfig, out: Path) -> None:
    """Refuse to go on in a folder that holds a run with other settings.

    Args:
        cfg: The config.
        out: Output folder.

    Raises:
        InputError: If a setting differs; the message names it.
    """
    if not (out / CONFIG).is_file():
        return
    try:
        before = flat(without_format(load_yaml(out / CONFIG), str(out / CONFIG)))
    except (InputError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{out / CONFIG} is damaged: remove the folder or choose another out=") from error
    before = {k: v for k, v in before.items() if not k.startswith("versions.")}
    # The round trip through yaml makes both sides the same kind of number.
    now = flat(yaml.safe_load(yaml.safe_dump(plain(cfg))))
    for key in sorted(set(before) | set(now)):
        compared = not f"{key}.".startswith(tuple(f"{name}." for name in NOT_COMPARED))
        if compared and before.get(key) != now.get(key):
            raise InputError(
                f"{out} holds a run with {key}={before.get(key)}, this one has {key}={now.get(key)}: "
                "choose another out= or remove the folder"
            )


def hyperparameters(config: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """What loggers, TensorBoard in its table of hparams, tell of a run: what was chosen and typed.

    A column for every setting would hide the few in which the runs of a sweep differ.

    Args:
        config: The resolved config.
        out: Output folder, where hydra has written what was typed.

    Returns:
        Name -> text or number.
    """
    typed = [k for k in overrides_of(out / OVERRIDES) if "." in k and not k.startswith(("trainer.", "scoring."))]

    def told(name: str) -> bool:
        return "." not in name or name.endswith("_target_") or any(f"{name}.".startswith(f"{t}.") for t in typed)

    settings = {k: v for k, v in config.items() if k not in {"name", "format", "logger"}}
    chosen = {k: v for k, v in flat(settings).items() if told(k)}
    return {
        k.removesuffix("._target_"): str(v).rsplit(".", 1)[-1] if k.endswith("_target_") else v
        for k, v in chosen.items()
        if isinstance(v, str | int | float | bool)
    }


def flat(nested: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings as ``a.b.c`` -> value, behind a prefix; lists are values."""
    result: dict[str, Any] = {}
    for key, value in nested.items():
        if isinstance(value, dict) and value:
            result |= flat(value, f"{prefix}{key}.")
        else:
            result[f"{prefix}{key}"] = value
    return result
