"""The command ``manoeuvre``, and what train.py, diagnose.py and scripts/ call."""

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig

from manoeuvre_nn import __version__
from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.groups import CONF, GROUPS, accept, options, own_folder, with_settings
from manoeuvre_nn.commands.guard import of_home, quoted
from manoeuvre_nn.commands.logs import logged
from manoeuvre_nn.core.ending import end_with_parent
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.plain_text import listed
from manoeuvre_nn.core.terminal import Terminal, be_quiet
from manoeuvre_nn.core.waiting import loading
from manoeuvre_nn.core.writing import locked

USAGE = """manoeuvre COMMAND [group=option] [setting=value]

  train         identify a model from manoeuvres or recordings, and score it on others
  simulate      sail a ship through a manoeuvre, with what effects do to it
  diagnose      find what a calm-water model leaves out of recordings
  check         find what is wrong with measured files
  import        propose how a measured file is read
  coefficients  coefficients with intervals
  excite        which manoeuvre to sail next
  export        a trained model as formulas or for another simulator: ONNX, FMU, ...
  compare       one table over trained models, wherever they lie

manoeuvre COMMAND --help lists groups, options and settings. Every command takes
  out=FOLDER    write there (import: out=FILE); the same command goes on there
  -q            print errors only
  -v            also show warnings and what libraries say
What is printed stands in run.log of the run's folder too. manoeuvre --version
To begin with: manoeuvre diagnose recordings=sample"""
QUIET_WORDS, VERBOSE_WORDS = ("-q", "--quiet"), ("-v", "--verbose")


TASKS = {
    "train": "train.run_job",
    "simulate": "simulate.simulate",
    "diagnose": "diagnose.diagnose_all",
    "check": "check.check_or_refuse",
    "coefficients": "coefficients.tell",
    "excite": "excite.excite",
    "export": "export.export",
}
"""Command, which is the name of its config too -> module and function that do it."""


FOLDER, RUN_FOLDER, SWEEP_FOLDER = "out=", "hydra.run.dir=", "hydra.sweep.dir="
"""Word that chooses the folder to write into, for all commands; what hydra calls that of a run, and of a sweep."""
SETS_FOLDER = ("simulate", "diagnose", "export")
"""Commands whose own config has the setting ``out``."""
OF_FILES = {"import": "import_recording.import_recording", "compare": "compare.compare"}
"""Commands that are given files or folders and have no config: the same."""
OF_HYDRA = ("hydra/launcher=two_cores", "hydra/job_logging=disabled", "hydra/hydra_logging=disabled")
"""Hydra's groups as train has them."""


def main() -> None:
    """Run ``manoeuvre COMMAND ...``; a command that there is not ends with code 2."""
    loud = {*QUIET_WORDS, *VERBOSE_WORDS}  # before the command or after it
    command, *words = sorted(sys.argv[1:], key=lambda word: word in loud) or ["--help"]
    if command in TASKS or command in OF_FILES:
        run(command, words)
        return
    with guard.one_line():
        if command not in {"-h", "--help", "--version"}:
            raise InputError(f"there is no command {command}; choose one of: {', '.join([*TASKS, *OF_FILES])}")
        print(__version__ if command == "--version" else USAGE)


def run(command: str, words: list[str] | None = None) -> None:
    """Run a command; whatever ends it early ends in one line.

    Args:
        command: Its name.
        words: What follows it; by default the command line.
    """
    words = sys.argv[1:] if words is None else words
    guard.command = command
    with guard.one_line():
        if "--version" in words:
            print(__version__)
            return
        _check_place()
        words, quiet, verbose = _loudness([of_home(word, hydras=command in TASKS) for word in words])
    be_quiet(quiet)
    if command in OF_FILES:
        with guard.one_line():
            _of_files(OF_FILES[command], words)
        return
    with guard.one_line():
        words, folder = own_folder(with_settings(words))
        _check_options(words)
        _check_choices(words, None if folder is None else str(folder))
        words, config = task_of(words, command, folder)
        words = with_job_names(with_folder(words, command))
    sys.argv = [sys.argv[0], *words, *(() if folder is None else ("--config-dir", str(folder)))]
    guard.guarded(
        hydra.main(version_base="1.3", config_path=str(CONF), config_name=config)(_task(command, quiet, verbose))
    )


def _check_place() -> None:
    """Refuse to begin in a folder that was removed meanwhile, in which no library could be loaded."""
    try:
        os.getcwd()
    except OSError as error:
        raise InputError("the folder in which you are is not there any more: go to another one (cd ..)") from error


def _loudness(words: Sequence[str]) -> tuple[list[str], bool, bool]:
    """Take ``-q`` and ``-v`` out of a command line, for a command that hydra knows neither of."""
    quiet, verbose = (bool(set(names) & set(words)) for names in (QUIET_WORDS, VERBOSE_WORDS))
    if quiet and verbose:
        raise InputError("-q and -v: write one of them")
    return [word for word in words if word not in {*QUIET_WORDS, *VERBOSE_WORDS}], quiet, verbose


def _check_options(words: list[str]) -> None:
    """Refuse options (``--name``) that hydra does not know, of which it would tell on several lines."""

    def refuse(message: str) -> NoReturn:
        raise InputError(f"{message}; {guard.program()} --help lists what there is")

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    parser.parse_args(words)


def _check_choices(words: Sequence[str], own: str | None) -> None:
    """Refuse an option of a group that is a way to another folder."""
    for word in words:
        key, _, value = word.lstrip("+").partition("=")
        if key in GROUPS and (".." in value or "/" in value[:2]):
            raise InputError(f"{word}: expected the name of an option of {key}: {listed(list(options(key, own)))}")


def task_of(words: Sequence[str], command: str, own: Path | None = None) -> tuple[list[str], str]:
    """Take ``task=NAME`` out of a command line: a task of train has a config of its own.

    Args:
        words: The words.
        command: The command.
        own: Folder of the user's own.

    Returns:
        The other words, and the name of the config. An unknown task is refused with those that there are.
    """
    named = [word.partition("=")[2] for word in words if word.startswith("task=")]
    if command != "train" or not named:
        return list(words), command
    check_choice("task", named[-1], list(options("task", None if own is None else str(own))))
    # Not in the task's file: hydra lets only the first file of all say these, and one's own task builds on ours.
    left = [word for word in words if not word.startswith("task=")]
    left += [word for word in OF_HYDRA if not any(w.startswith(word.partition("=")[0]) for w in left)]
    return left, f"task/{named[-1]}"


def with_folder(words: Sequence[str], command: str) -> list[str]:
    """Say ``out=FOLDER`` as hydra does: of a run or of a sweep.

    Args:
        words: The words.
        command: The command; those of :data:`SETS_FOLDER` take them as they are.

    Returns:
        As many words.

    Raises:
        InputError: If no folder is named.
    """
    if command in SETS_FOLDER:
        return list(words)
    for word in words:
        if word.startswith(FOLDER) and word.removeprefix(FOLDER).strip("'\"") in {"", "null"}:
            raise InputError(f"{word}: expected the path of a folder")
    of_hydra = SWEEP_FOLDER if _sweeps(words) else RUN_FOLDER
    return [of_hydra + word.removeprefix(FOLDER) if word.startswith(FOLDER) else word for word in words]


def _sweeps(words: Sequence[str]) -> bool:
    """Whether a command line is that of a sweep."""
    return bool({"-m", "--multirun"} & set(words))


def with_job_names(words: Sequence[str]) -> list[str]:
    """Say in the words of a sweep which settings are the same in all jobs: they are left out of the jobs' names.

    The sweep's folder is made absolute, for jobs may begin in another one.

    Args:
        words: The words.

    Returns:
        More words; those of a single run as they are.
    """
    if not _sweeps(words):
        return list(words)
    words = [_absolute(word) if word.startswith(SWEEP_FOLDER) else word for word in words]
    typed = [word for word in words if "=" in word or word.startswith("~")]  # not --cfg job
    parsed = OverridesParser.create().parse_overrides(typed)
    swept = {one.get_key_element(): one.is_sweep_override() for one in parsed}  # of two words the last one holds
    same = [quoted(key) for key, several in swept.items() if not several]
    return [*words, f"hydra.job.config.override_dirname.exclude_keys=[{','.join(same)}]"]


def _absolute(word: str) -> str:
    """The word that chooses the sweep's folder, with its whole path."""
    folder = Path(word.removeprefix(SWEEP_FOLDER).strip("'\"")).absolute()
    return SWEEP_FOLDER + quoted(str(folder))


def _task(command: str, quiet: bool = False, verbose: bool = False) -> Callable[[DictConfig], float | None]:
    """What hydra calls; a job is imported when it runs: torch and lightning take seconds, and --help need not wait."""
    module, _, function = TASKS[command].partition(".")

    def task(cfg: DictConfig) -> float | None:
        be_quiet(quiet)  # a job of a sweep runs in a process of its own
        with guard.one_line(), ExitStack() as stack:  # here, not outside alone: hydra would put a line before ours
            hydra_cfg = HydraConfig.get()
            out = Path(hydra_cfg.runtime.output_dir)
            sweeps = hydra_cfg.mode == RunMode.MULTIRUN
            if sweeps:
                end_with_parent()  # before what takes long to import on a machine that has other work, too
                os.chdir(hydra_cfg.runtime.cwd)  # a job on another machine begins elsewhere
            if command != "export":  # which has no folder of its own
                if cfg.get("cases") is None:  # several may answer cases into one folder
                    # A search may ask for the same settings twice at once: the second job finds the first one done.
                    stack.enter_context(locked(out, wait=sweeps))
                typed = " ".join(hydra_cfg.overrides.task)
                stack.enter_context(logged(out, f"manoeuvre {command} {typed}", verbose))
            if command != "train":  # in a sweep, what a job cannot import is a failure of that job
                accept(cfg)
            job = getattr(importlib.import_module(f"manoeuvre_nn.commands.{module}"), function)
            loading.close()
            error: float | None = job(cfg, out)
            return error  # what a search makes small

    return task


def _of_files(task: str, words: list[str]) -> None:
    """Do a command that is given files or folders; its settings are few and no config."""
    module, _, function = task.partition(".")
    job = importlib.import_module(f"manoeuvre_nn.commands.{module}")
    loading.close()
    if {"-h", "--help"} & set(words):
        print(job.HELP)
        return
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 130
    getattr(job, function)(job.request(words), Terminal(width=width))
