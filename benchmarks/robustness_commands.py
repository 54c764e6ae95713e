"""Hostile command lines: every setting spoilt, hydra's grammar, paths, payloads, contradictions, sizes.

A command line that cannot be meant must be refused in one line that names what was given; another may also be carried
out, with numbers at the end. Nothing that it names is run, and nothing is written outside of its folder.
"""

import json
import os
import random
import re
import resource
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from robustness_attack import Ended, Outcome
from robustness_hostile_files import FOLDERS, PAYLOADS, hostile_files
from robustness_hostile_words import (
    ANY,
    EITHER,
    FILES,
    GRAMMAR,
    GROUPS,
    OPTIONS,
    PATHS,
    REFUSED,
    SCRIPTS,
    SPOILT,
    TOGETHER,
    WORTHLESS,
)  # fmt: skip
from robustness_runs import LEGAL, legal, typed

from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.main import with_folder

CPU_S, LIMIT_S = 60, 240.0
"""A command that computes for longer than the first, or waits for longer than the second, hangs [s]."""
OF_PARTS = {"sweep", "diagnose cases"}
"""Commands that go on where a part fails, and say so."""
UNREAD = {
    "simulate": {"linear", "fit", "network"},
    "diagnose": {"linear", "fit", "network", "report"},
    "diagnose cases": {"linear", "fit", "network"},
    "check": {"fit", "network"},
    "coefficients": {"linear", "fit", "network", "manoeuvre", "data", "ship", "trainer", "scoring", "seed", "relative"},
}
"""Groups and settings that a legal command does not use: nothing of them is carried out."""
OF_HYDRA = (
    "train", "train pitch", "simulate", "diagnose", "check", "import", "coefficients", "excite", "export", "sweep",
)  # fmt: skip
"""Commands that hydra's grammar is tried on."""


@dataclass(frozen=True)
class _Attempt:
    """A command line.

    Attributes:
        name: Of the legal command that is spoilt.
        more: Words after those of the legal command; they hold.
        wanted: What must come of it: that it is refused, or that it is refused or carried out.
        named: One of these must be in the line of the error; none: anything.
    """

    name: str
    more: tuple[str, ...]
    wanted: str
    named: tuple[str, ...] = ()


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Type a hostile command line."""
    attempt = _attempts(seed)[number % len(_attempts(seed))]
    (folder / "canary.txt").write_text("mine")
    _strange_files(folder)
    files = hostile_files(folder, [word for word in attempt.more if word.startswith("HOSTILE")])
    more = tuple(part for word in attempt.more for part in (files[word].split(" ") if word in files else [word]))
    words = (attempt.name,) if attempt.name.startswith("scripts/") else legal(attempt.name)
    what = f"{attempt.name}: {' '.join(more)[:200]!r}"
    os.environ["SECRET"] = "7"
    ended = typed((*words, *more), folder, LIMIT_S, lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S)))
    return _judged(ended, attempt, more, what, folder)


@cache
def _attempts(seed: int) -> list[_Attempt]:
    """All command lines, the same for a seed: shuffled, one of each kind after the other."""
    draw = random.Random(seed)
    kinds = [list(made) for made in (_settings(), _words(), _options(), _paths(), _together(), _payloads(), _scripts())]
    for kind in kinds:
        draw.shuffle(kind)
    found = []
    while any(kinds):
        for kind, share in zip(kinds, (4, 1, 1, 2, 2, 2, 1), strict=True):
            found += [kind.pop() for _ in range(min(share, len(kind)))]
    return list(dict.fromkeys(found))


def _settings() -> Iterator[_Attempt]:
    """Every setting of every command, spoilt."""
    for name in LEGAL:
        if name.startswith(("trial", "reproduce", "import", "sweep")):
            continue
        command, *words = legal(name)
        task = next((word.partition("=")[2] for word in words if word.startswith("task=")), None)
        words = [word for word in with_folder(words, command) if not word.startswith(("task=", "hydra"))]
        cfg = compose(command if task is None else f"task/{task}", words)
        for key, value in _leaves(OmegaConf.to_container(cfg, resolve=False)):
            kind = float if type(value) is int else type(value)
            for wanted, text in (*_each(SPOILT[kind]), *_each(ANY)):
                text = text.replace("{{key}}", f"${{{key}}}")
                group = key.split(".")[0]
                must = REFUSED if key.endswith("_target_") else wanted
                must = EITHER if group in UNREAD.get(name, ()) else must
                yield _Attempt(name, (f"{key}={text}",), must, (*key.split("."), text))


def _each(table: dict[str, tuple[str, ...]]) -> Iterator[tuple[str, str]]:
    """What is wanted, and the word, one by one."""
    for wanted, words in table.items():
        for word in words:
            yield wanted, word


def _leaves(value: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Settings and their values; those of hydra and of names that are made are left out."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            if before or key not in {"config_dir", "plugins", "hydra"}:
                yield from _leaves(inner, f"{before}.{key}" if before else str(key))
    elif not (isinstance(value, str) and "${" in value):
        yield before, value


def _words() -> Iterator[_Attempt]:
    """Hydra's grammar, of which import knows nothing and a sweep makes more."""
    for name in OF_HYDRA:
        for wanted, word in _each(GRAMMAR):
            must = EITHER if name in {"import", "sweep"} else wanted
            yield _Attempt(name, (word,), must, _parts_of(word))


def _parts_of(word: str) -> tuple[str, ...]:
    """What an error may name of a word."""
    key, _, value = word.strip("~+'\"").partition("=")
    return key[:9], value[:9]


def _options() -> Iterator[_Attempt]:
    """Options of groups that there are not."""
    for name in ("train", "simulate", "diagnose", "check", "coefficients", "excite"):
        for group in GROUPS:
            for wanted, text in _each(OPTIONS):
                yield _Attempt(name, (f"{group}={text}",), wanted, (group, text))


def _paths() -> Iterator[_Attempt]:
    """Paths that lead to nothing good."""
    for name, settings in FILES.items():
        for setting in settings:
            for path in PATHS:
                yield _Attempt(name, (setting.format(path),), EITHER)


def _together() -> Iterator[_Attempt]:
    """What does not go together."""
    for name, table in TOGETHER.items():
        for wanted, words in _each(table):
            yield _Attempt(name, tuple(re.split(r" (?=[\w.]+=)", words)), wanted)


def _payloads() -> Iterator[_Attempt]:
    """Names of code wherever one may stand."""
    for place in FOLDERS:
        for payload in PAYLOADS:
            yield _Attempt(place.command, (f"HOSTILE {place.name} {payload}",), REFUSED)


def _scripts() -> Iterator[_Attempt]:
    """Settings of the scripts that are no commands."""
    for script, settings in SCRIPTS.items():
        for setting in settings:
            for value in WORTHLESS:
                yield _Attempt(script, (setting.format(value),), REFUSED)


def _strange_files(folder: Path) -> None:
    """Files that are no files of ours."""
    os.mkfifo(folder / "fifo")
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("nowhere")
    (folder / "empty").write_bytes(b"")
    (folder / "binary").write_bytes(random.Random(0).randbytes(3000))
    (folder / "folder").mkdir()
    lines = [f"{b}: &{b} [{','.join(9 * [f'*{a}'])}]" for a, b in pairwise("abcdefghi")]
    (folder / "bomb.yaml").write_text("\n".join(["a: &a [1,1,1,1,1,1,1,1,1]", *lines]))


def _judged(ended: Ended, attempt: _Attempt, words: tuple[str, ...], what: str, folder: Path) -> Outcome:
    """What came of it."""
    lines = ended.err.splitlines()
    said = f"{what}: code {ended.code}: {' | '.join(lines)[-300:]}"
    if (folder / "canary.txt").read_text() != "mine" or list(folder.rglob("executed*")):
        return Outcome("executed", said)
    if ended.code in {None, -signal.SIGKILL, -signal.SIGXCPU}:
        return Outcome("hang", said)
    if attempt.name in OF_PARTS and ended.code == 1 and not lines and ": failed: " in ended.out:
        return Outcome("clear error", said)  # of a job or a case
    if ended.code == 0:
        wrong = attempt.wanted == "refused" or not _finite(folder)
        return Outcome("wrong" if wrong else "right answer", said)
    if ended.code != 2 or "Traceback" in ended.err:
        return Outcome("traceback", said)
    names = not any(attempt.named) or any(name in lines[-1] for name in map(_in_a_line, attempt.named) if name)
    clear = len(lines) == 1 and lines[0].startswith("error: ") and len(lines[0]) < 1000 and names
    return Outcome("clear error" if clear and not re.search("[\x00-\x08\x0b-\x1f\x7f]", lines[0]) else "wrong", said)


def _in_a_line(word: str) -> str:
    """A word as an error can show it: a number as Python writes it, without ends of lines."""
    try:
        return f"{float(word):g}"
    except ValueError:
        return " ".join(word.replace(r"\n", " ").strip('"').split())


def _finite(folder: Path) -> bool:
    """Whether what was written has numbers."""
    for path in (folder / "out").rglob("*.json"):
        found: list[str] = []
        json.loads(path.read_text(), parse_constant=found.append)
        if found:
            return False
    return True
