"""``manoeuvre train``: from a config to a trained, scored and documented model, alone or in a sweep."""

from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.control import Control
from rich.segment import ControlType

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands import guard, response
from manoeuvre_nn.commands.groups import accept, brought_along
from manoeuvre_nn.commands.job import Job, make_fit, prepare
from manoeuvre_nn.commands.provenance import SCORES, check_same_run, write_provenance
from manoeuvre_nn.commands.response_results import print_response, score_response, write_response
from manoeuvre_nn.commands.results import print_outcome, score_finally, write_results
from manoeuvre_nn.commands.shelves import plain
from manoeuvre_nn.core.data_files import load_json, read_as
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.terminal import Say, Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.report.figures import comparison_figures
from manoeuvre_nn.report.sweep import OVERRIDES
from manoeuvre_nn.training import session
from manoeuvre_nn.training.rollout_score import RolloutScore

OVER_THE_BAR = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))
"""What a job of a sweep sends before its line: the terminal shows the sweep's progress there."""


class _StoredTraining(BaseModel):
    """How a training ended."""

    model_config = ConfigDict(strict=True)
    stopped: str
    epochs: int


class _StoredScores(BaseModel):
    """What is read again of ``scores.json``."""

    model_config = ConfigDict(strict=True)
    training: _StoredTraining
    error: float | None = None
    mean_dev_L: float | None = None  # noqa: N815  # the file's name


class _Task(NamedTuple):
    """How a kind of model is trained and told of, step by step."""

    prepare: Callable[[DictConfig], Any]
    fit: Callable[[DictConfig, Any, Path, Console], session.Trained]
    score: Callable[[Mapping[str, Any], session.Trained, Any, Say], Any]
    write: Callable[[Any, Path], None]
    tell: Callable[[Any, Path, Console], None]


def run_job(cfg: DictConfig, out: Path) -> float | None:
    """Run one job; in a sweep its failure is written down and does not stop the others.

    Args:
        cfg: The config.
        out: Output folder.

    Returns:
        The error that a search for settings makes small; infinite if it failed.
    """
    (out / guard.ERROR).unlink(missing_ok=True)
    write_file(out / OVERRIDES, yaml.safe_dump(list(HydraConfig.get().overrides.task), allow_unicode=True))
    if HydraConfig.get().mode != RunMode.MULTIRUN:
        accept(cfg)
        return train(cfg, out)[1]
    console = Terminal(quiet=True)
    try:
        accept(cfg)  # jobs of a sweep run in processes of their own
        told, error = train(cfg, out, console)
    except Exception as failure:  # whatever it is, the other jobs go on
        told, error = f"failed: {guard.write_error(failure, out)}", inf
    shown = Terminal()
    shown.control(OVER_THE_BAR)
    shown.print(f"#{HydraConfig.get().job.num}  {out.name}: {told}", soft_wrap=True, highlight=False)
    return error


def train(cfg: DictConfig, out: Path, console: Console | None = None) -> tuple[str, float | None]:
    """Run the main job, unless the folder already holds the finished run.

    Args:
        cfg: The config.
        out: Output folder.
        console: Where to print.

    Returns:
        What came out, in a few words, and the error that says how good it is.
    """
    console = console or Terminal()
    use_threads(cfg.trainer.threads)
    task = OF_RESPONSES if "task" in cfg else OF_SHIPS
    cfg = configs.with_effects(cfg)
    with waiting(console, "reading and checking what is learnt from"):
        job = task.prepare(cfg)
    check_same_run(cfg, out)
    if finished(out, job.session.max_epochs):
        console.print(f"{out} holds this run already: nothing to do", soft_wrap=True)
        return "done before", error_before(out)
    write_provenance(cfg, out)
    with waiting(console, "checking what is learnt from"):
        remarks = job.data.remarks()
    for line in [*_chosen_with(), *remarks]:
        console.print(f"note: {line}", highlight=False, soft_wrap=True)
    trained = task.fit(cfg, job, out, console)
    with waiting(console, "scoring") as say:
        outcome = task.score(plain(cfg), trained, job.data, say)
        say("writing the report")
        task.write(outcome, out)
    task.tell(outcome, out, console)
    return f"{outcome.in_short} in {outcome.trained.seconds:.0f} s", outcome.error


def finished(out: Path, max_epochs: int) -> bool:
    """Whether a folder holds a scored run that ctrl-C did not end, with as many epochs as are asked for now."""
    try:
        stored = read_as(_StoredScores, load_json(out / SCORES), str(out / SCORES)).training
    except InputError:
        return False
    stopped, epochs = stored.stopped, stored.epochs
    return stopped != session.CTRL_C and not (stopped == session.ALL_EPOCHS and epochs < max_epochs)


def error_before(out: Path) -> float | None:
    """The error of a run that was finished before; None if its file does not say it."""
    stored = read_as(_StoredScores, load_json(out / SCORES), str(out / SCORES))
    return stored.mean_dev_L if stored.error is None else stored.error


def _chosen_with() -> list[str]:
    """A line on the groups that came with other choices, so that none is set behind the user's back."""
    if not HydraConfig.initialized():
        return []
    run = HydraConfig.get()
    along = brought_along(run.runtime.choices, run.overrides.task, str(run.job.config_name))
    first = along[0].partition("=")[0] if along else ""
    return [f"{', '.join(along)} came with your other choices; write {first}=... to choose otherwise"] if along else []


def fit(cfg: DictConfig, job: Job, out: Path, console: Console) -> session.Trained:
    """Fit a model to the job's recordings, and keep checkpoints in the output folder."""
    with waiting(console) as job.data.say:
        job.data.setup(stage=None)
    rollout_score = RolloutScore(job.data.held_out, draw=comparison_figures, **cfg.scoring)
    return session.run(make_fit(cfg, job), job.data, rollout_score, job.session, out, console)


OF_SHIPS = _Task(prepare, fit, score_finally, write_results, print_outcome)
OF_RESPONSES = _Task(response.prepare, response.fit, score_response, write_response, print_response)
