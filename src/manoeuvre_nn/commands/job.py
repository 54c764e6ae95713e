"""What several commands make of a config: ship, known part, network, data and the method that joins them."""

import inspect
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from omegaconf import DictConfig, OmegaConf

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.groups import option, options
from manoeuvre_nn.commands.provenance import CONFIG, SCORES
from manoeuvre_nn.commands.settings import check_settings
from manoeuvre_nn.commands.shelves import (
    TARGET,
    build,
    check_arguments,
    gathered,
    kinds,
    made_by,
    on_shelf,
    plain,
    without_targets,
)
from manoeuvre_nn.core.data_files import check_plain, load_json, load_yaml, without_format
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.response import Response
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.recursive import RecursiveShip, joined_model
from manoeuvre_nn.training import session
from manoeuvre_nn.training.checkpoint import load_weights, read_checkpoint
from manoeuvre_nn.training.data import DEFAULT_SCORE, SUBSTITUTES, ManoeuvreData, RecordedData
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.response_data import ResponseData
from manoeuvre_nn.training.rollout_score import RolloutScore
from manoeuvre_nn.training.scalings import KINDS, make_scaling
from manoeuvre_nn.training.settings import check_simulable

PARTS = ("ship", "linear", "network", "fit", "manoeuvre")
"""What a config must say for its model to be made again."""
NOTHING_HELD_OUT = [{"straight": {"duration": 60}}]
"""What stands for ``score`` where data must have held-out manoeuvres but nothing is chosen by them."""
OF_FILES = (TARGET, "folder", "files", "mapping")
"""Settings of ``data=recording`` that say which files are read, and how."""
MAX_NETWORK_SIZE = 100_000
"""Largest number among the sizes of a network."""
DTYPES = {"float64": torch.float64, "float32": torch.float32}


Data = TypeVar("Data", bound=ManoeuvreData | ResponseData)
"""What is learnt from."""


@dataclass(frozen=True)
class Job(Generic[Data]):
    """Everything that is checked before computing starts.

    Attributes:
        data: Data module, not yet set up.
        network: The network with its first weights.
        scaling: Kind of scaling.
        dtype: Floating type.
        session: How long to train and what to keep.
    """

    data: Data
    network: Network
    scaling: str
    dtype: torch.dtype
    session: session.Session


def prepare(
    cfg: DictConfig, runs: Sequence[Recording] = (), ship: Ship | Particulars | None = None
) -> Job[ManoeuvreData]:
    """Build and check everything that needs no computing.

    Args:
        cfg: The config.
        runs: Recordings that are at hand; without them the config says what is simulated or read.
        ship: The ship; None takes the config's.

    Returns:
        The job.
    """
    ship, known = known_part(cfg, ship)
    network, scaling, dtype = blank_network(cfg)
    check_pair(cfg, type(network))
    check_arguments(RolloutScore, cfg.scoring, "scoring", ["held_out"])
    common: dict[str, Any] = {"ship": ship, "known": known, "seed": cfg.seed, "dtype": dtype}
    data = _given(cfg, common, runs) if runs else _data(cfg, common)
    _blank_fit(cfg, ship, known, deepcopy(network), dtype)  # so that its settings are refused before any computing
    return Job(data, network, scaling, dtype, session_of(cfg))


def session_of(cfg: DictConfig) -> session.Session:
    """How long to train, what to keep and where to log it, as ``cfg.trainer`` and ``cfg.logger`` say it."""
    lasting = {k: v for k, v in cfg.trainer.items() if k != "threads"}
    chosen = cfg.get("logger") or {}
    lasting["loggers"] = [build(said, "logger", f"logger.{name}") for name, said in chosen.items()]
    check_arguments(session.Session, lasting, "trainer")
    return session.Session(**lasting)


def check_pair(cfg: DictConfig, network: type[Network]) -> None:
    """Refuse a method for another kind of network, and say what goes with either."""
    chosen = made_by(cfg.fit, "fit")
    if chosen is None or chosen.trains(network):
        return
    own = cfg.get("config_dir")
    suiting = {
        "fit": [name for name, fit in kinds("fit", own).items() if fit.trains(network)],
        "network": [name for name, kind in kinds("network", own).items() if chosen.trains(kind)],
    }
    advice = ", or ".join(f"{group}={' or '.join(names)}" for group, names in suiting.items() if names)
    raise InputError(
        f"network._target_={cfg.network[TARGET]} is a {network.__name__}, which fit._target_={cfg.fit[TARGET]} does "
        f"not train: write {advice}"
    )


def known_part(cfg: DictConfig, ship: Ship | Particulars | None = None) -> tuple[Ship | Particulars, Ship]:
    """The ship (None takes the config's) at its approach speed, and the part of its forces that is taken as known."""
    ship = ship_on_approach(cfg) if ship is None else ship
    return ship, build(cfg.linear, "linear", ship=ship)


def ship_on_approach(cfg: DictConfig) -> Ship | Particulars:
    """The ship at its approach speed: coefficients, the known part and g are then in units of this speed."""
    ship, speed = build(cfg.ship, "ship"), configs.approach_speed(cfg.manoeuvre)
    return ship.on_approach(speed) if speed is not None and isinstance(ship, Ship) else ship


def blank_network(
    cfg: DictConfig, scalings: Sequence[str] = KINDS, sizes: Mapping[str, int] | None = None
) -> tuple[Network, str, torch.dtype]:
    """The network with its first weights.

    Args:
        cfg: The config.
        scalings: Kinds of scaling that the task has.
        sizes: Numbers of ``inputs`` and ``outputs`` that the network must have; None for those of a ship's forces.

    Returns:
        Network, kind of scaling, floating type.

    Raises:
        InputError: If the first or the second is not said how, or the network has a size of its own.
    """
    settings = plain(cfg.network, "network")
    _check_sizes(settings, "network")
    for key in ("scaling", "dtype"):
        if key not in settings:
            raise InputError(f"network.{key} must be given: see the files of conf/network")
    scaling, name = str(settings.pop("scaling")), str(settings.pop("dtype"))
    check_choice("network.dtype", name, list(DTYPES))
    dtype = DTYPES[name]
    target, wanted = settings.get(TARGET), sizes or {}
    if not set(wanted) <= set(inspect.signature(on_shelf(target, "network")).parameters):
        sized = ", ".join(name for name in options("network", cfg.get("config_dir")) if _takes(name, wanted))
        raise InputError(f"network._target_={target} has the inputs of a ship's forces: write network= one of {sized}")
    check_choice("network.scaling", scaling, list(scalings))
    network = build(settings, "network", seed=cfg.seed, dtype=dtype, **wanted)
    if network.scalings and sizes is None:
        check_choice("network.scaling", scaling, list(network.scalings))
    return network, scaling, dtype


def _takes(name: str, wanted: Mapping[str, int]) -> bool:
    """Whether an option of conf/network can be given these sizes."""
    made = on_shelf(option("network", name).get(TARGET), "network")
    return set(wanted) <= set(inspect.signature(made).parameters)


def _data(cfg: DictConfig, common: dict[str, Any]) -> ManoeuvreData:
    """The data module, its files read or its manoeuvres checked."""
    names, manoeuvres = configs.as_list(cfg.score), configs.training_manoeuvres(cfg.manoeuvre)
    if "files" in cfg.data:
        return _recorded(cfg, common, None if cfg.score is None else [] if names == ["default"] else names)
    check_simulable(common["ship"])
    effects = configs.chosen_effects(cfg.get("effect"), common["ship"])
    if names == ["default"]:
        seen = {m.name for m in manoeuvres}
        names = [SUBSTITUTES[name] if name in seen else name for name in DEFAULT_SCORE]
    score = configs.named_manoeuvres(names, configs.approach_speed(cfg.manoeuvre), cfg.get("config_dir"))
    score = configs.with_sides(score, cfg.manoeuvre)
    return build(cfg.data, "data", **common, manoeuvres=manoeuvres, score=score, effects=effects)


def _recorded(cfg: DictConfig, common: dict[str, Any], names: list[str] | None) -> RecordedData:
    """The data module for measured files; their mapping is a yaml of its own, by path or by name in conf/recording."""
    if cfg.get("effect"):
        acting = ",".join(cfg.effect)
        raise InputError(f"effect=[{acting}] acts on simulated ships, data=recording are measured: leave effect= out")
    settings = plain(cfg.data)
    columns = configs.read_mapping(settings.pop("mapping"), cfg.get("config_dir"))
    settings["files"] = configs.names(settings["files"])
    settings["folder"] = str(settings["folder"])
    return build(settings, "data", **common, mapping=columns, score=names)


def _given(cfg: DictConfig, common: dict[str, Any], runs: Sequence[Recording]) -> RecordedData:
    """The data module for recordings that are at hand; what of them is used is said as for files."""
    named = [key for key in ("files", "mapping") if cfg.data.get(key)]
    if named:
        raise InputError(f"data.{named[0]} names files, and recordings are given: leave it out")
    kept = {k: v for k, v in plain(cfg.data).items() if k not in OF_FILES}
    return RecordedData(runs=runs, **gathered(RecordedData, {**kept, **common}, "data"))


def make_fit(cfg: DictConfig, job: Job[ManoeuvreData]) -> Fit:
    """Join known part, network and scaling of a job whose data are set up, and give them to the chosen method."""
    scaling = make_scaling(job.scaling, job.data.known, job.data.tuples)
    return fit_of(cfg, joined_model(job.data.reference, job.data.known, job.network, scaling).to(job.dtype))


def _blank_fit(cfg: DictConfig, ship: Ship | Particulars, known: Ship, network: Network, dtype: torch.dtype) -> Fit:
    """The chosen method with a model that has seen no data."""
    blank = Scaling(torch.zeros(4), torch.ones(4), torch.ones(3))
    return fit_of(cfg, joined_model(ship, known, network, blank).to(dtype))


def fit_of(cfg: DictConfig, dynamics: IdentifiedShip | RecursiveShip | Response) -> Fit:
    """Give a model to the chosen method: a Lightning module."""
    settings = plain(cfg.fit)
    settings.pop("scaling", None)  # which network.scaling refers to
    if "seed" in settings:
        settings["seed"] = cfg.seed
    return build(settings, "fit", dynamics=dynamics)


def _check_sizes(value: Any, where: str) -> None:
    """Refuse a network that no memory could hold."""
    if isinstance(value, Mapping | list):
        for name, inner in value.items() if isinstance(value, Mapping) else [("", one) for one in value]:
            _check_sizes(inner, f"{where}.{name}" if name else where)
    elif isinstance(value, int | float) and MAX_NETWORK_SIZE < abs(value):
        raise InputError(f"{where}={value:.3g}: expected {MAX_NETWORK_SIZE} at most")


def config_beside(checkpoint: Path, parts: Sequence[str] = PARTS) -> DictConfig:
    """The config that a training wrote beside its checkpoint, as data: what it names is checked when it is built.

    Args:
        checkpoint: ``OUT/checkpoints/best.ckpt`` or ``last.ckpt``.
        parts: What the config must hold.

    Returns:
        ``OUT/config.yaml``.

    Raises:
        InputError: If it is missing or foreign, or holds more than plain values.
    """
    path = checkpoint.resolve().parents[1] / CONFIG
    if not path.is_file():
        raise InputError(
            f"model={checkpoint}: there is no {path}, which says what network it is: give it in its run's folder"
        )
    content = load_yaml(path)
    if not isinstance(content, dict) or not all(isinstance(content.get(part), dict) for part in parts):
        raise InputError(f"model={checkpoint}: {path} is no config of manoeuvre train")
    content = {str(k): v for k, v in without_format(content, str(path)).items() if k not in {"hydra", "plugins"}}
    check_plain(without_targets(content), str(path))
    _check_sizes(content.get("network"), f"model={checkpoint}: {path}: network")
    check_settings(content, f"model={checkpoint}: {path}: ")
    return OmegaConf.create(content)


@contextmanager
def made_again(checkpoint: Path) -> Generator[None]:
    """Refuse a config from outside whose values make no model, in one line whatever they end in."""
    try:
        yield
    except (InputError, ImportError):
        raise
    except Exception as error:
        said = next(iter(str(error).splitlines()), "")
        raise InputError(
            f"model={checkpoint}: the {CONFIG} of its run describes no model ({type(error).__name__}: {said[:120]})"
        ) from error


def verdict_beside(checkpoint: Path) -> tuple[str, str]:
    """The verdict of a checkpoint's own training.

    Args:
        checkpoint: ``OUT/checkpoints/best.ckpt`` or ``last.ckpt``.

    Returns:
        Word and sentence in ``OUT/scores.json``; empty where it says none.
    """
    try:
        said = load_json(checkpoint.resolve().parents[1] / SCORES)["verdict"]
        return str(said["word"]), str(said.get("sentence", ""))
    except (OSError, InputError, KeyError, TypeError, IndexError):
        return "", ""


def caveat_of(checkpoint: Path) -> str:
    """What the held-out runs of a checkpoint's own training say against its model.

    Args:
        checkpoint: ``OUT/checkpoints/best.ckpt`` or ``last.ckpt``.

    Returns:
        A clause by the verdict in ``OUT/scores.json``; empty where that calls the model usable, or says nothing.
    """
    told = {"doubtful": "is doubtful", "do not use": "is not to be used"}.get(verdict_beside(checkpoint)[0])
    by = f"by the held-out runs of its own training ({SCORES} beside it)"
    return f"the model {told} {by}: what is found may be its own error" if told else ""


def check_model(path: Path) -> None:
    """Refuse what cannot be the checkpoint of a model.

    Args:
        path: What was given.

    Raises:
        InputError: If it is no checkpoint.
    """
    if not path.is_file():
        raise InputError(f"model={path} is no file: write the path of a checkpoint such as OUT/checkpoints/best.ckpt")
    read_checkpoint(path)


def load_model(path: Path) -> IdentifiedShip | RecursiveShip:
    """A model from the checkpoint of a training.

    Args:
        path: ``OUT/checkpoints/best.ckpt`` or ``last.ckpt``; the run's ``OUT/config.yaml`` says what the network is.

    Returns:
        Known part and network in double precision; a checkpoint or config that cannot be used is refused.
    """
    check_model(path)
    cfg = config_beside(path)
    with made_again(path):
        ship, known = known_part(cfg)
        network, _, dtype = blank_network(cfg)
        fit = _blank_fit(cfg, ship, known, network, dtype)
    load_weights(fit, path)
    return fit.dynamics.double()


def with_rate(model: IdentifiedShip | RecursiveShip, wanted_for: str) -> IdentifiedShip:
    """A model whose state has a rate.

    Args:
        model: A model.
        wanted_for: What needs it, for the message.

    Returns:
        The model.

    Raises:
        InputError: If it goes by steps of its own.
    """
    if isinstance(model, RecursiveShip):
        raise InputError(
            f"{wanted_for} needs a model whose state has a rate; a recursive network has none: train another network"
        )
    return model
