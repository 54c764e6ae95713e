"""Concealed trial: draws cases nobody knows, lets tools answer them, opens the answers and scores.

    python scripts/concealed_trial.py cases=48 seed=7 out=outputs/concealed_trial jobs=2
    python scripts/concealed_trial.py cases=200 seed=8 sort=clean            # false alarms
    python scripts/concealed_trial.py cases=60 seed=9 strength=weak methods=manoeuvre_nn,ideal

``sort`` is clean, single, pair, triple or unknown; ``strength`` weak, moderate, strong or extreme; ``channels`` a
channel set (full, no_shaft, no_log, gps_heading, two_seconds); ``strict=true`` leaves only rudder and warm-up in
held-out runs; ``loop=true`` sails the run that each uncertain answer advises, and a random one, and asks again;
``tool`` holds further words for diagnose.py, whose answers then lie in a folder of their own.

Three processes: the first writes recordings and the hashes of the answers, the second runs the tools and never gets the
seed, the third draws the answers again, checks the hashes and scores. Each goes on where it was stopped.
"""

import ctypes
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # studies stand beside the package, not in it

from manoeuvre_nn.core.ending import TERMINATED, Terminated, listen, one_line  # noqa: E402

if __name__ == "__main__" and not any(word.startswith("stage=") for word in sys.argv):
    listen()  # imports take seconds
from manoeuvre_nn.commands.settings import MAX_SEED, MAX_THREADS, whole  # noqa: E402
from manoeuvre_nn.core.errors import InputError  # noqa: E402
from manoeuvre_nn.core.writing import locked  # noqa: E402
from studies.concealed_trial.channels import CHANNEL_SETS  # noqa: E402
from studies.concealed_trial.drawing import ALL, SHARES, Trial  # noqa: E402
from studies.concealed_trial.loop import WAYS, compare, sail_next  # noqa: E402
from studies.concealed_trial.stages import answer, generate, score  # noqa: E402
from studies.concealed_trial.strength import STRENGTHS  # noqa: E402

DEFAULTS = {"cases": "48", "seed": "", "out": "outputs/concealed_trial", "jobs": "2", "nuisance": "1.0"}
DEFAULTS |= {"methods": "manoeuvre_nn", "tool": ""} | dict.fromkeys(("sort", "strength", "channels"), ALL)
DEFAULTS |= {"strict": "false", "loop": "false"}
DEATH_SIGNAL = 1
"""``PR_SET_PDEATHSIG`` of prctl(2): the signal that a process gets when its parent is killed."""
STAGES = ("generate", "answer", "score")
LOOP = ("sail_next", "answer_again", "compare")
"""Stages, in turn; those that answer never learn the seed."""
CHOICES = {"sort": SHARES, "strength": STRENGTHS, "channels": CHANNEL_SETS}
METHODS = {
    "manoeuvre_nn": (sys.executable, "diagnose.py", "cases={cases}", "out={out}", "workers=1"),
} | {
    rival: (sys.executable, "scripts/rivals.py", f"method={rival}", "cases={cases}", "out={out}")
    for rival in ("regression", "pysindy", "sample_split", "structural", "neural", "neural_referee")
}
OF_MODULES = ("cases={cases}", "out={out}")
METHODS["ideal"] = (sys.executable, "-m", "studies.concealed_trial.ideal", *OF_MODULES, "nuisance={nuisance}")
ABLATED = (sys.executable, "-m", "studies.concealed_trial.rivals.ablations", *OF_MODULES, "workers=1")
WITHOUT = ("scatter", "process_noise", "relinearisation", "other_runs")  # a copy: their module imports torch
METHODS |= {f"without_{part}": (*ABLATED, f"without={part}") for part in WITHOUT}
"""Command of each tool; its answers lie in OUT/answers, or OUT/answers_NAME for others than the first."""


def settings(arguments: list[str]) -> dict[str, str]:
    """Settings from the command line.

    Args:
        arguments: ``key=value``, and ``stage=...`` from the script itself.

    Returns:
        All settings as text.

    Raises:
        InputError: If an argument is not understood.
    """
    known = [*DEFAULTS, "stage"]
    given = {}
    for argument in arguments:
        key, sign, value = argument.partition("=")
        if not sign or key not in known:
            raise InputError(f"{argument!r} is not understood; write {' '.join(f'{k}=...' for k in DEFAULTS)}")
        given[key] = value
    result = DEFAULTS | given
    unknown = [name for name in result["methods"].split(",") if name not in METHODS]
    if unknown:
        raise InputError(f"methods={result['methods']}: {unknown[0]!r} is unknown; choose from: {', '.join(METHODS)}")
    return result


def number(given: dict[str, str], key: str, least: int, most: int = MAX_SEED) -> int:
    """A whole number among the settings.

    Args:
        given: The settings.
        key: Which one.
        least: Smallest value.
        most: Largest value.

    Returns:
        The number; one that is too small or too large is refused.
    """
    value = int(given[key]) if given[key].isdecimal() and len(given[key]) < 20 else None
    whole(least, most).check(key, given[key] if value is None else value)
    assert value is not None
    return value


def trial_of(given: dict[str, str]) -> Trial:
    """What is to be drawn.

    Args:
        given: The settings.

    Returns:
        The trial.

    Raises:
        InputError: If a number is none or too small.
    """
    try:
        nuisance = float(given["nuisance"])
    except ValueError:
        nuisance = -1.0
    if not 0 <= nuisance <= 2:
        raise InputError(f"nuisance={given['nuisance']}: write a number from 0 (the model is exact) to 2")
    chosen = {key: one_of(given, key, (ALL, *known)) for key, known in CHOICES.items()}
    strict = one_of(given, "strict", ("true", "false")) == "true"
    return Trial(number(given, "seed", 0), number(given, "cases", 1), nuisance, **chosen, strict=strict)


def one_of(given: dict[str, str], key: str, known: Iterable[str]) -> str:
    """A setting that is one of a few words.

    Args:
        given: The settings.
        key: Which one.
        known: What it may be.

    Returns:
        The word.

    Raises:
        InputError: If it is another.
    """
    if given[key] not in (words := list(known)):
        raise InputError(f"{key}={given[key]}: choose from: {', '.join(words)}")
    return given[key]


def folder_of(out: Path, method: str, tool: str = "") -> Path:
    """Where a tool's answers lie.

    Args:
        out: Folder of the trial.
        method: Name of the tool.
        tool: Further words for the package's own command.

    Returns:
        The folder.
    """
    if method != next(iter(METHODS)):
        return out / f"answers_{method}"
    return out / ("answers" if not tool else f"answers_{sha256(tool.encode()).hexdigest()[:6]}")


def words_of(given: dict[str, str], method: str) -> tuple[str, ...]:
    """Command of a tool.

    Args:
        given: The settings.
        method: Name of the tool.

    Returns:
        Its words; those of ``tool`` go to the package's own.
    """
    further = shlex.split(given["tool"]) if method == next(iter(METHODS)) else []
    return (*(word.replace("{nuisance}", given["nuisance"]) for word in METHODS[method]), *further)


def run_stage(given: dict[str, str]) -> None:
    """One stage, in its own process; the seed comes by standard input where it is needed.

    Args:
        given: The settings, with ``stage``.
    """
    out, jobs, tool = Path(given["out"]), number(given, "jobs", 1, MAX_THREADS), given["tool"]
    folders = {method: folder_of(out, method, tool) for method in given["methods"].split(",")}
    commands = {method: words_of(given, method) for method in folders}
    first = next(iter(folders))
    if given["stage"] == "answer":
        for method, folder in folders.items():
            answer(out / "recordings", folder, commands[method], jobs, root=ROOT, method=method)
        return
    if given["stage"] == "answer_again":
        for place in (out / "loop" / way for way in WAYS):
            answer(place / "recordings", place / "answers", commands[first], jobs, root=ROOT, method=first)
        return
    trial = trial_of(given | {"seed": sys.stdin.read().strip()})
    if given["stage"] == "generate":
        generate(trial, out, jobs)
    elif given["stage"] == "sail_next":
        sail_next(trial, out, folders[first])
    elif given["stage"] == "compare":
        print(compare(trial, out))
    else:
        print(score(trial, out, folders, jobs))


def main(arguments: list[str]) -> int:
    """Run the stages one after the other.

    Args:
        arguments: ``key=value``.

    Returns:
        Exit code.
    """
    given = settings(arguments)
    if "stage" in given:
        try:
            run_stage(given)
        except Terminated:
            return TERMINATED
        return 0
    trial = trial_of(given)
    number(given, "jobs", 1, MAX_THREADS)
    passed_on = [f"{key}={value}" for key, value in given.items() if key != "seed"]
    loop = one_of(given, "loop", ("true", "false")) == "true"
    with locked(Path(given["out"])):
        for stage in (*STAGES, *(LOOP if loop else ())):
            command = [sys.executable, __file__, f"stage={stage}", *passed_on]
            code = in_process(command, "" if stage.startswith("answer") else str(trial.seed))
            if code:
                return code
    return 0


def in_process(command: list[str], seed: str) -> int:
    """Run a stage in a process of its own, which ends with this one.

    Args:
        command: Its words.
        seed: What it reads.

    Returns:
        Exit code.
    """
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        preexec_fn=_begin_stage,
    ) as stage:
        try:
            stage.communicate(seed)
        finally:
            stage.terminate()
            stage.wait()  # its own processes are gone by then
    return stage.returncode


def _begin_stage() -> None:
    """In the process of a stage: leave ctrl-C to the trial, and end orderly when the trial is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGTERM)


if __name__ == "__main__":
    with one_line():
        sys.exit(main(sys.argv[1:]))
