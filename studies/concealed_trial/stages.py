"""The three stages of a concealed trial: generate, answer, score. The middle one never learns the seed."""

import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file
from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.commitments import METHOD, check, commitment
from studies.concealed_trial.drawing import Trial, case_name, draw_case, plans
from studies.concealed_trial.figures import write_figures
from studies.concealed_trial.record import write_case
from studies.concealed_trial.score import score_case
from studies.concealed_trial.scoreboard import label_losses, markdown, scoreboard

ENDED = ("answer.json", "error.txt")
"""What a tool leaves of a case: its answer, or why there is none."""
KEPT_ENVIRONMENT = ("PATH", "HOME", "LANG", "TMPDIR", "VIRTUAL_ENV", "SYSTEMROOT")
"""What the tool's processes see of the environment."""
POLL, PATIENCE = 1.0, 20.0
"""How often progress is looked at, and how long a process may take to end [s]."""


class Progress:
    """Steps done and time left, on one line of a terminal or now and then in a log."""

    def __init__(self, what: str, count: int) -> None:
        """Start the clock.

        Args:
            what: What is being done.
            count: How many steps.
        """
        self.what, self.count, self.done, self.began = what, count, 0, time.monotonic()

    def step(self, done: int | None = None) -> None:
        """Report progress.

        Args:
            done: Steps done; one more by default.
        """
        done = self.done + 1 if done is None else done
        if done == self.done:
            return
        told, self.done = self.done, done
        left = (time.monotonic() - self.began) / done * (self.count - done)
        text = f"{self.what} {done}/{self.count}, {left / 60:.1f} min left"
        if sys.stderr.isatty():
            print(f"\r{text}   ", end="\n" if done == self.count else "", file=sys.stderr, flush=True)
        elif done == self.count or done * 10 // self.count > told * 10 // self.count:
            print(text, file=sys.stderr, flush=True)


def generate(trial: Trial, out: Path, jobs: int) -> None:
    """Write recordings and commitments; cases that are there are kept.

    Args:
        trial: What to draw.
        out: Folder of the trial.
        jobs: Processes.

    Raises:
        InputError: If the folder holds another trial.
    """
    path, names = out / "commitments.json", [case_name(trial.seed, k) for k in range(trial.cases)]
    head = {"method": METHOD, "trial": _published(trial)}
    old: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else head | {"commitments": {}}
    commitments: dict[str, str] = old["commitments"]
    if set(commitments) - set(names) or old["trial"] != head["trial"]:
        raise InputError(f"out={out} holds another trial: give another folder, or seed, cases and all else of that one")
    todo = [k for k, name in enumerate(names) if not _is_there(out, name, commitments)]
    progress = Progress("recordings", len(todo))
    (out / "recordings").mkdir(parents=True, exist_ok=True)
    with _processes(jobs) as pool:
        waiting = [pool.submit(_generate_one, trial, k, out / "recordings") for k in todo]
        for future in as_completed(waiting):
            name, digest = future.result()
            commitments[name] = digest
            _write(path, head | {"commitments": dict(sorted(commitments.items()))})
            progress.step()


@contextmanager
def _processes(jobs: int) -> Generator[ProcessPoolExecutor]:
    """Processes that end at once when something goes wrong: a case takes minutes, and many may be waiting."""
    with ProcessPoolExecutor(jobs) as pool:
        try:
            yield pool
        except BaseException:
            for process in multiprocessing.active_children():
                process.terminate()
            raise


def _published(trial: Trial) -> dict[str, Any]:
    """What may be known of a trial."""
    return {key: value for key, value in asdict(trial).items() if key != "seed"}


def _is_there(out: Path, name: str, commitments: Mapping[str, str]) -> bool:
    """Whether a case has been written whole."""
    return name in commitments and (out / "recordings" / name / "manifest.json").is_file()


def _generate_one(trial: Trial, index: int, folder: Path) -> tuple[str, str]:
    """Draw and write one case; only its hash comes back."""
    case = drawn(trial, index)
    write_case(case, folder / case.name)
    return case.name, commitment(case.salt, case.answers())


def drawn(trial: Trial, index: int) -> TrialCase:
    """A case of a trial.

    Args:
        trial: The trial.
        index: Number of the case.

    Returns:
        The case.
    """
    return draw_case(trial.seed, index, plans(trial)[index], trial.nuisance)


def read_commitments(out: Path) -> dict[str, str]:
    """Hashes of a trial.

    Args:
        out: Folder of the trial.

    Returns:
        Hash of each case.

    Raises:
        InputError: If there are none.
    """
    path = out / "commitments.json"
    if not path.is_file():
        raise InputError(f"{path} does not exist: generate the trial first")
    found: dict[str, str] = json.loads(path.read_text())["commitments"]
    return found


def _write(path: Path, content: object) -> None:
    """Write JSON so that the file is whole at any time."""
    write_file(path, json.dumps(content, indent=1))


def answer(recordings: Path, answers: Path, command: Sequence[str], jobs: int, *, root: Path, method: str) -> None:
    """Run a tool on the cases that have no answer yet, one process for each part of them.

    Args:
        recordings: Folder of the cases.
        answers: Where the tool puts ``<case>/answer.json``.
        command: Its command; ``{cases}`` and ``{out}`` are replaced by folders.
        jobs: Processes.
        root: Folder the command runs in.
        method: Name of the tool.

    Raises:
        InputError: If a process fails and leaves cases without an answer and without the error that it ended in.
    """
    cases = sorted(path.parent.name for path in recordings.glob("*/manifest.json"))
    todo = [name for name in cases if not (answers / name / "answer.json").is_file()]
    if not todo:
        return
    work = recordings.parent / "parts" / method
    parts = [_part(work / str(k + 1), recordings, todo[k::jobs]) for k in range(min(jobs, len(todo)))]
    answers.mkdir(parents=True, exist_ok=True)
    for name in todo:
        (answers / name / ENDED[1]).unlink(missing_ok=True)  # of an attempt before
    environment = {key: os.environ[key] for key in KEPT_ENVIRONMENT if key in os.environ}
    environment |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    if (root / "src").is_dir():  # else another checkout may be what is installed
        environment["PYTHONPATH"] = str(root / "src")
    running: list[subprocess.Popen] = []
    try:
        for part in parts:
            words = [word.format(cases=part, out=answers.resolve()) for word in command]
            with (part.parent / f"{part.name}.log").open("w") as log:
                running.append(subprocess.Popen(words, cwd=root, env=environment, stdout=log, stderr=subprocess.STDOUT))
        _watch(running, answers, todo, Progress(f"{method}, cases answered", len(todo)))
    finally:
        _end(running)
    for part, process in zip(parts, running, strict=True):
        # A case that the tool refused or broke down on is its own: it counts as not answered.
        left = [path for path in part.iterdir() if not any((answers / path.name / name).is_file() for name in ENDED)]
        if process.returncode and left:
            log_file = part.parent / f"{part.name}.log"
            raise InputError(f"{method} ended with code {process.returncode} on a part of the cases: see {log_file}")


def _part(folder: Path, recordings: Path, names: Iterable[str]) -> Path:
    """A folder with links to some of the cases."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    for name in names:
        (folder / name).symlink_to((recordings / name).resolve(), target_is_directory=True)
    return folder.resolve()


def _end(running: Sequence[subprocess.Popen]) -> None:
    """End processes that are still at work, and wait until they are gone; what does not listen is killed."""
    for process in running:
        process.terminate()
    for process in running:
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _watch(running: Sequence[subprocess.Popen], answers: Path, todo: Sequence[str], progress: Progress) -> None:
    """Wait for all processes and tell how far they are."""
    while True:
        alive = [process for process in running if process.poll() is None]
        progress.step(sum((answers / name / "answer.json").is_file() for name in todo))
        if not alive:
            return
        time.sleep(POLL)


def score(trial: Trial, out: Path, answers: Mapping[str, Path], jobs: int) -> str:
    """Draw the answers again, check them against the commitments and score all tools.

    Args:
        trial: What was drawn.
        out: Folder of the trial; takes scoreboard.md, scoreboard.json, and the figures with trial.html.
        answers: Folder of each tool's answers.
        jobs: Processes.

    Returns:
        The scoreboard as Markdown.
    """
    commitments, progress, rows = read_commitments(out), Progress("cases scored", trial.cases), []
    with _processes(jobs) as pool:
        arguments = [(trial, k, commitments, out / "recordings", dict(answers)) for k in range(trial.cases)]
        for future in as_completed([pool.submit(_score_one, *a) for a in arguments]):
            rows.append(future.result())
            progress.step()
    rows.sort(key=lambda row: row[0])
    if "ideal" in answers:
        ideal = [row[1]["ideal"] for row in rows]
        for tool in answers:
            label_losses([row[1][tool] for row in rows], ideal)
    boards = {tool: scoreboard([row[1][tool] for row in rows]) for tool in answers}
    text = markdown(boards)
    details = {tool: {"board": boards[tool], "cases": [row[1][tool] for row in rows]} for tool in answers}
    _write(out / "scoreboard.json", {"trial": _published(trial), "tools": details})
    write_file(out / "scoreboard.md", text)
    write_figures(details, out)
    return text


def _score_one(
    trial: Trial, index: int, commitments: Mapping[str, str], recordings: Path, answers: Mapping[str, Path]
) -> tuple[str, dict[str, Any]]:
    """Open one case and score every tool's answer to it."""
    case = drawn(trial, index)
    check(commitments, case.salt, case.answers())
    truth = case.answers()
    if trial.strict:  # the responses come to light only now
        recordings = recordings.parent / "responses"
        if not (recordings / case.name / "manifest.json").is_file():
            write_case(replace(case, strict=False), recordings / case.name)
    return case.name, {tool: score_case(recordings / case.name, f / case.name, truth) for tool, f in answers.items()}
