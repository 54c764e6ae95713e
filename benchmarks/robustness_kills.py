"""Kill -9 at a random moment, then the same command again until it is done: the same results, bit for bit.

Commands are those of :mod:`tiny_commands`, each family as often as the others; what it leaves when nobody disturbs it
is found once. A kill is at a moment that is uniform over its duration. Half of the kills end all of the command's
processes at once, half the first of them alone, after which the others must end by themselves. After every kill each
file that is not a draft must be whole, and at the end no draft and no lock may be left.
"""

import atexit
import importlib
import io
import json
import shutil
import sys
import tempfile
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from matplotlib.image import imread
from robustness_attack import Ended, Outcome, in_child
from tiny_commands import COMMANDS, NOT_COMPARED, ROOT, Tiny, results, write_cases

from manoeuvre_nn.core.writing import LOCK, FolderInUse, locked

sys.path.insert(0, str(ROOT))  # studies stand beside the package, not in it
for module in ("commands.train", "commands.diagnose", "commands.response", "report.sweep"):
    importlib.import_module(f"manoeuvre_nn.{module}")
for module in (
    "concealed_trial.stages",
    "concealed_trial.loop",
    "concealed_trial.rivals.ablations",
    "reproduction.job",
):
    importlib.import_module(f"studies.{module}")

LIMIT_S = 300.0
"""A tiny command that takes longer hangs."""
MORE_KILLS = 0.3
"""Chance that the command is killed once more when it goes on."""
FAMILIES = tuple(dict.fromkeys(command.family for command in COMMANDS))


@cache
def _place() -> Path:
    """Folder of the cases, and of what undisturbed commands leave; gone with this process."""
    place = Path(tempfile.mkdtemp(prefix="undisturbed_"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    write_cases(place / "cases")
    return place


@cache
def undisturbed(command: Tiny) -> tuple[dict[str, Any], float]:
    """What a command leaves when nobody kills it, and how long it takes [s]."""
    out = _place() / command.name.replace(" ", "_") / "out"
    ended = _run(command, out, LIMIT_S)
    if ended.code != 0:
        raise RuntimeError(f"{command.name}: exit code {ended.code}: {ended.err[-2000:]}")
    return results(out), ended.seconds


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Kill a command, and let it go on.

    Args:
        number: Number of the attack; it chooses the command.
        seed: Of the moments.
        folder: Empty folder to work in.

    Returns:
        What came of it.
    """
    family = FAMILIES[number % len(FAMILIES)]
    ours = [command for command in COMMANDS if command.family == family]
    command = ours[number // len(FAMILIES) % len(ours)]
    expected, seconds = undisturbed(command)
    draw, out, what = np.random.default_rng([seed, number]), folder / "out", command.name
    kills = 1 + (draw.uniform() < MORE_KILLS)
    for _ in range(kills):
        moment = draw.uniform(0, seconds)
        alone = bool(draw.uniform() < 0.5)
        what += f", killed {'alone' if alone else 'with all that it began'} after {moment:.2f} of {seconds:.2f} s"
        ended = _run(command, out, moment, alone)
        if ended.left:
            return Outcome("wrong", f"{what}: processes left: {', '.join(ended.left)}")
        halves = half_written(out)
        if halves:
            return Outcome("wrong", f"{what}: half written: {halves[0]}")
        if ended.code not in {None, 0}:
            return Outcome("wrong", f"{what}: exit code {ended.code} before the kill: {_last(ended)}")
    ended = _run(command, out, LIMIT_S)
    if ended.code is None:
        return Outcome("hang", what)
    if "Traceback" in ended.err:
        return Outcome("traceback", f"{what}: {_last(ended)}")
    if ended.code:
        return Outcome("wrong", f"{what}: exit code {ended.code} when it went on: {_last(ended)}")
    left = [str(p.relative_to(out)) for p in out.rglob(".*") if p.suffix == ".part" or is_locked(p)]
    different = [*left, *differences(expected, results(out))]
    return Outcome("wrong", f"{what}: {', '.join(different[:5])}") if different else Outcome("right answer", what)


def _run(command: Tiny, out: Path, limit_s: float, alone: bool = False) -> Ended:
    """A command in a process of its own, killed after so long [s]."""
    out.parent.mkdir(parents=True, exist_ok=True)
    return in_child(partial(command.run, out, _place() / "cases"), out.parent, limit_s, alone)


def _last(ended: Ended) -> str:
    """The last thing that was said."""
    return next(iter(reversed((ended.err or ended.out).strip().splitlines())), "nothing was said")


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Files that only one folder has, or that differ."""
    return sorted(name for name in one.keys() | other.keys() if repr(one.get(name)) != repr(other.get(name)))


def is_locked(path: Path) -> bool:
    """Whether somebody holds a lock."""
    if path.name != LOCK:
        return False
    try:
        with locked(path.parent):
            return False
    except FolderInUse:
        return True


def half_written(out: Path) -> list[str]:
    """Files under their own names that a reader would not get through."""
    halves = []
    for path in sorted(p for p in out.rglob("*") if p.is_file() and not p.name.endswith(".part")):
        name = str(path.relative_to(out))
        if NOT_COMPARED.search(name):
            continue
        try:
            _read(path)
        except Exception as error:  # whatever it is, the file is not whole
            halves.append(f"{name} ({type(error).__name__})")
    return halves


def _read(path: Path) -> None:
    """Read a file to its end."""
    content = path.read_bytes()
    if path.suffix == ".json":
        json.loads(content)
    elif path.suffix == ".ckpt":
        torch.load(io.BytesIO(content), weights_only=True)
    elif path.suffix in {".yaml", ".yml"}:
        assert yaml.safe_load(content) is not None
    elif path.suffix == ".png":
        imread(io.BytesIO(content), format="png")
    elif path.suffix == ".html":
        assert content.rstrip().endswith(b"</html>")
    else:
        assert content.endswith(b"\n")
