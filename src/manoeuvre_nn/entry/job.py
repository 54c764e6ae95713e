"""The main job: from a config to a trained, scored and documented model."""

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.entry import config as configs
from manoeuvre_nn.entry.provenance import check_same_run, finished, write_provenance
from manoeuvre_nn.entry.results import Outcome, draw, print_outcome, write_results
from manoeuvre_nn.training.callbacks import MONITOR, GracefulStop, RolloutScore, RunProgress
from manoeuvre_nn.training.checkpoint import load_weights, read_checkpoint
from manoeuvre_nn.training.data import DEFAULT_SCORE, ManoeuvreData, RecordedData, check_simulable
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.scalings import KINDS, make_scaling

DTYPES = {"float64": torch.float64, "float32": torch.float32}


@dataclass(frozen=True)
class Job:
    """Everything that is checked before computing starts.

    Attributes:
        data: Data module, not yet set up.
        network: The network with its first weights.
        scaling: Kind of scaling.
        dtype: Floating type.
    """

    data: ManoeuvreData
    network: torch.nn.Module
    scaling: str
    dtype: torch.dtype


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
    _quiet()
    torch.set_num_threads(int(cfg.trainer.threads))
    job = prepare(cfg, conf)
    check_same_run(cfg, out)
    if finished(out):
        console.print(f"{out} holds this run already: nothing to do")
        return None
    write_provenance(cfg, out)
    job.data.setup()
    fit = make_fit(cfg, job)
    judge = RolloutScore(job.data.held_out, draw=draw, **cfg.scoring)
    graceful = GracefulStop(console)
    trainer = make_trainer(cfg, out, [judge, graceful, *([RunProgress(console)] if cfg.trainer.progress else [])])
    started = perf_counter()
    trainer.fit(fit, datamodule=job.data, ckpt_path=_resume_from(cfg, out, console), weights_only=True)
    seconds = perf_counter() - started
    keep_best(cfg, fit, trainer)
    outcome = Outcome.of(cfg, fit, job.data, judge, trainer, seconds, graceful.interrupted)
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

    Raises:
        InputError: If anything in the config cannot be used.
    """
    ship = configs.build(cfg.ship)
    known = configs.build(cfg.linear, ship=ship)
    network_settings = OmegaConf.to_container(cfg.network, resolve=True)
    assert isinstance(network_settings, dict)
    scaling, name = str(network_settings.pop("scaling")), str(network_settings.pop("dtype"))
    check_choice("network.scaling", scaling, list(KINDS))
    check_choice("network.dtype", name, list(DTYPES))
    check_choice("trainer.keep", cfg.trainer.keep, ["best", "last"])
    dtype = DTYPES[name]
    network = configs.build(network_settings, seed=int(cfg.seed), dtype=dtype)
    common = {"ship": ship, "known": known, "seed": int(cfg.seed), "dtype": dtype}
    names = configs.as_list(cfg.score)
    if "files" in cfg.data:
        data = _recorded(cfg, common, [] if names == ["default"] else names, conf)
    else:
        check_simulable(ship)
        speed = configs.approach_speed(cfg.manoeuvre)
        names = list(DEFAULT_SCORE) if names == ["default"] else names
        score = configs.named_manoeuvres(names, conf / "manoeuvre", speed)
        manoeuvres = configs.training_manoeuvres(cfg.manoeuvre)
        data = configs.build(cfg.data, **common, manoeuvres=manoeuvres, score=score)
    return Job(data, network, scaling, dtype)


def _recorded(cfg: DictConfig, common: dict[str, Any], names: list[str], conf: Path) -> RecordedData:
    """The data module for measured files; their mapping is a yaml of its own, by path or by name in conf/recording."""
    settings = OmegaConf.to_container(cfg.data, resolve=True)
    assert isinstance(settings, dict)
    if settings["mapping"] is None:
        there = ", ".join(sorted(p.stem for p in (conf / "recording").glob("*.yaml")))
        raise InputError(f"data.mapping is not given: write the path of a yaml that maps columns, or one of: {there}")
    named = conf / "recording" / f"{settings['mapping']}.yaml"
    path = named if named.is_file() else Path(settings["mapping"])
    settings["mapping"] = configs.load_yaml(path)
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
    dynamics = IdentifiedShip(job.data.known, job.network, scaling).to(job.dtype)
    settings = OmegaConf.to_container(cfg.fit, resolve=True)
    assert isinstance(settings, dict)
    if "seed" in settings:
        settings["seed"] = int(cfg.seed)
    return configs.build(settings, dynamics=dynamics)


def make_trainer(cfg: DictConfig, out: Path, callbacks: list[L.Callback]) -> L.Trainer:
    """Lightning's trainer with our callbacks, TensorBoard and checkpoints by the held-out score.

    Args:
        cfg: The config.
        out: Output folder.
        callbacks: Judge, progress and ctrl-C.

    Returns:
        The trainer.

    Raises:
        InputError: If the number of epochs is not positive.
    """
    if cfg.trainer.max_epochs < 1:
        raise InputError(f"trainer.max_epochs={cfg.trainer.max_epochs}: expected at least 1")
    stored = ModelCheckpoint(
        dirpath=out / "checkpoints", filename="best", monitor=MONITOR, save_last=True, enable_version_counter=False,
        every_n_epochs=1, save_on_train_epoch_end=True,
    )  # fmt: skip
    if cfg.trainer.patience is not None:
        patience = int(cfg.trainer.patience) * int(cfg.scoring.every)
        callbacks = [*callbacks, EarlyStopping(MONITOR, patience=patience, check_on_train_epoch_end=True)]
    return L.Trainer(
        accelerator=cfg.trainer.accelerator, devices=1, max_epochs=cfg.trainer.max_epochs, callbacks=[*callbacks, stored],
        logger=TensorBoardLogger(out, name="", version="tensorboard", default_hp_metric=False), log_every_n_steps=1,
        enable_progress_bar=False, enable_model_summary=False, num_sanity_val_steps=0,
    )  # fmt: skip


def keep_best(cfg: DictConfig, fit: Fit, trainer: L.Trainer) -> None:
    """Put the weights of the best judgement into the fit, if the config says so.

    Args:
        cfg: The config.
        fit: The fit as it ended.
        trainer: The trainer.
    """
    stored = trainer.checkpoint_callback
    assert isinstance(stored, ModelCheckpoint)
    if cfg.trainer.keep == "best" and stored.best_model_path:
        load_weights(fit, Path(stored.best_model_path))


def _resume_from(cfg: DictConfig, out: Path, console: Console) -> str | None:
    """The checkpoint to go on from, checked before Lightning sees it."""
    if cfg.trainer.resume == "never":
        return None
    path = out / "checkpoints" / "last.ckpt" if cfg.trainer.resume == "auto" else Path(cfg.trainer.resume)
    if cfg.trainer.resume == "auto" and not path.exists():
        return None
    epoch = read_checkpoint(path)["epoch"]
    console.print(f"going on from {path} (epoch {epoch + 1})")
    return str(path)


def _quiet() -> None:
    """Lightning talks of GPUs, workers and folders that mean nothing here; its errors still come through."""
    for name in ("lightning.pytorch", "lightning.fabric", "lightning.pytorch.utilities.rank_zero"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module="lightning.*")


