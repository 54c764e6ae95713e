"""The main job: from a config to a trained, scored and documented model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.entry import config as configs
from manoeuvre_nn.entry.provenance import check_same_run, finished, resolved, write_provenance
from manoeuvre_nn.entry.results import Outcome, draw, judge_finally, print_outcome, write_results
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.training import session
from manoeuvre_nn.training.callbacks import RolloutScore
from manoeuvre_nn.training.data import DEFAULT_SCORE, INSTEAD, ManoeuvreData, RecordedData
from manoeuvre_nn.training.ensemble import EnsembleFit
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.joint_fit import ClosedLoopFit
from manoeuvre_nn.training.scalings import KINDS, make_scaling
from manoeuvre_nn.training.settings import check_simulable

DTYPES = {"float64": torch.float64, "float32": torch.float32}


@dataclass(frozen=True)
class Job:
    """Everything that is checked before computing starts.

    Attributes:
        data: Data module, not yet set up.
        network: The network with its first weights.
        scaling: Kind of scaling.
        dtype: Floating type.
        session: How long to train and what to keep.
    """

    data: ManoeuvreData
    network: torch.nn.Module
    scaling: str
    dtype: torch.dtype
    session: session.Session


def train(cfg: DictConfig, out: Path, conf: Path, console: Console | None = None) -> Outcome | None:
    """Run the main job.

    Args:
        cfg: The config.
        out: Output folder.
        conf: The folder ``conf``.
        console: Where to print.

    Returns:
        What came out; None if the folder already held the finished run.
    """
    console = console or Console()
    use_threads(configs.whole_number("trainer.threads", cfg.trainer.threads, 1))
    cfg = configs.with_effects(cfg)
    job = prepare(cfg, conf)
    check_same_run(cfg, out)
    if finished(out, job.session.max_epochs):
        console.print(f"{out} holds this run already: nothing to do", soft_wrap=True)
        return None
    write_provenance(cfg, out)
    for line in job.data.remarks():
        console.print(f"note: {line}", highlight=False, soft_wrap=True)
    job.data.setup(stage=None)
    judge = RolloutScore(job.data.held_out, draw=draw, **cfg.scoring)
    trained = session.run(make_fit(cfg, job), job.data, judge, job.session, out, console)
    outcome = judge_finally(resolved(cfg), trained, job.data)
    write_results(outcome, out)
    print_outcome(outcome, out, console)
    return outcome


def prepare(cfg: DictConfig, conf: Path) -> Job:
    """Build and check everything that needs no computing.

    Args:
        cfg: The config.
        conf: The folder ``conf``.

    Returns:
        The job.
    """
    ship, known = known_part(cfg)
    _check_pair(cfg)
    network, scaling, dtype = blank_network(cfg)
    seed = configs.whole_number("seed", cfg.seed, 0)
    lasting = {k: v for k, v in cfg.trainer.items() if k != "threads"}
    for kind, given in ((session.Session, lasting), (RolloutScore, {"held_out": None, **cfg.scoring})):
        configs.check_arguments(kind, given)
    common = {"ship": ship, "known": known, "seed": seed, "dtype": dtype}
    return Job(_data(cfg, common, conf), network, scaling, dtype, session.Session(**lasting))


KINDS_OF_FIT = (
    (HullRudder, EnsembleFit, "an ensemble (hull_rudder)", "fit=ensemble, or network=cubic, wang or rajesh"),
    (
        Series,
        ClosedLoopFit,
        "a series (cubic, modulus, abkowitz)",
        "fit=closed_loop, or network=hull_rudder, wang or rajesh",
    ),
)
"""Network, the method that it alone has, what it is called, what to write."""


def _check_pair(cfg: DictConfig) -> None:
    """Refuse a method for another kind of network."""
    for network, fit, kind, wanted in KINDS_OF_FIT:
        ours = _named(cfg.network, network)
        if ours == _named(cfg.fit, fit):
            continue
        given = f"fit._target_={cfg.fit['_target_']}"
        if ours:
            raise InputError(f"network is {kind}, which {given} does not train: write {wanted}")
        wanted = "fit=levenberg_marquardt or backprop for network=wang and rajesh, fit=ensemble for hull_rudder, fit="
        raise InputError(
            f"network._target_={cfg.network['_target_']}, which {given} does not train: write {wanted}closed_loop for "
            "cubic, modulus and abkowitz"
        )


def _named(settings: DictConfig, kind: type) -> bool:
    """Whether settings are those of a class; nothing is imported."""
    return str(settings[configs.TARGET]) == f"{kind.__module__}.{kind.__qualname__}"


def known_part(cfg: DictConfig) -> tuple[Ship | Particulars, Ship]:
    """The ship at its approach speed and the part of its forces that is taken as known.

    Args:
        cfg: The config.

    Returns:
        Ship and known part.
    """
    ship, speed = configs.build(cfg.ship), configs.approach_speed(cfg.manoeuvre)
    if speed is not None and isinstance(ship, Ship):
        ship = ship.on_approach(speed)  # the known part and g are then in units of this speed
    return ship, configs.build(cfg.linear, ship=ship)


def blank_network(cfg: DictConfig) -> tuple[torch.nn.Module, str, torch.dtype]:
    """The network with its first weights.

    Args:
        cfg: The config.

    Returns:
        Network, kind of scaling, floating type.
    """
    settings = OmegaConf.to_container(cfg.network, resolve=True)
    assert isinstance(settings, dict)
    scaling, name = str(settings.pop("scaling")), str(settings.pop("dtype"))
    check_choice("network.scaling", scaling, list(KINDS))
    check_choice("network.dtype", name, list(DTYPES))
    dtype = DTYPES[name]
    network = configs.build(settings, seed=configs.whole_number("seed", cfg.seed, 0), dtype=dtype)
    if isinstance(network, HullRudder | Series):
        check_choice("network.scaling", scaling, list(network.scalings))
    return network, scaling, dtype


def _data(cfg: DictConfig, common: dict[str, Any], conf: Path) -> ManoeuvreData:
    """The data module, its files read or its manoeuvres checked."""
    names = configs.as_list(cfg.score)
    if "files" in cfg.data:
        return _recorded(cfg, common, [] if names == ["default"] else names, conf)
    check_simulable(common["ship"])
    effects = configs.chosen_effects(cfg.get("effect"), common["ship"])
    manoeuvres = configs.training_manoeuvres(cfg.manoeuvre)
    if names == ["default"]:
        seen = {m.name for m in manoeuvres}
        names = [INSTEAD[name] if name in seen else name for name in DEFAULT_SCORE]
    score = configs.named_manoeuvres(names, conf / "manoeuvre", configs.approach_speed(cfg.manoeuvre))
    return configs.build(cfg.data, **common, manoeuvres=manoeuvres, score=score, effects=effects)


def _recorded(cfg: DictConfig, common: dict[str, Any], names: list[str], conf: Path) -> RecordedData:
    """The data module for measured files; their mapping is a yaml of its own, by path or by name in conf/recording."""
    if cfg.get("effect"):
        acting = ",".join(cfg.effect)
        raise InputError(f"effect=[{acting}] acts on simulated ships, data=recording are measured: leave effect= out")
    settings = OmegaConf.to_container(cfg.data, resolve=True)
    assert isinstance(settings, dict)
    settings["mapping"] = configs.load_mapping(settings["mapping"], conf / "recording")
    settings["files"] = configs.as_list(settings["files"])
    return configs.build(settings, **common, score=names)


def make_fit(cfg: DictConfig, job: Job) -> Fit:
    """Join known part, network and scaling, and give them to the chosen method.

    Args:
        cfg: The config.
        job: The job, its data set up.

    Returns:
        The Lightning module.
    """
    scaling = make_scaling(job.scaling, job.data.known, job.data.tuples)
    return fit_of(cfg, IdentifiedShip(job.data.known, job.network, scaling).to(job.dtype))


def fit_of(cfg: DictConfig, dynamics: IdentifiedShip) -> Fit:
    """Give a model to the chosen method.

    Args:
        cfg: The config.
        dynamics: Known part, network and scaling.

    Returns:
        The Lightning module.
    """
    settings = OmegaConf.to_container(cfg.fit, resolve=True)
    assert isinstance(settings, dict)
    if "seed" in settings:
        settings["seed"] = int(cfg.seed)
    return configs.build(settings, dynamics=dynamics)
