"""Ctrl-C and SIGTERM at a random moment of every command: one line, no half-written file, no process left behind.

Ctrl-C goes to all processes of a command, as from a terminal, SIGTERM to the first of them. A training that is stopped
by one ctrl-C ends after its epoch, with its report and exit code 0.
"""

import json
import os
import random
import signal
import time
from functools import cache
from pathlib import Path

from robustness_attack import Ended, Outcome, kill_session
from robustness_disks import COMMANDS, LIMIT_S, damage, missing, written
from robustness_runs import legal, typed

ENDS = {signal.SIGINT: (130, "stopped by ctrl-C"), signal.SIGTERM: (143, "stopped by SIGTERM")}


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Stop a command."""
    draw, name = random.Random(f"{seed} {number}"), COMMANDS[number % len(COMMANDS)]
    kind = draw.choice(list(ENDS))
    after = draw.random() * _seconds(name)
    place = folder / "place"
    place.mkdir()
    ended = typed(legal(name), place, LIMIT_S, lambda: _prepare(kind, after, folder / "pid"), texts=folder)
    time.sleep(0.3)
    left = kill_session(int((folder / "pid").read_text()))
    what = f"{name}, {kind.name} after {after:.2f} s: code {ended.code}: {' | '.join(ended.err.splitlines())[-400:]}"
    return _judged(ended, kind, name, place, f"{what}{' process left: ' + left[0] if left else ''}", bool(left))


@cache
def _seconds(name: str) -> float:
    """How long a command takes."""
    place = written(name).with_name(f"{written(name).name} again")
    place.mkdir()
    return typed(legal(name), place, LIMIT_S).seconds


def _prepare(kind: signal.Signals, after: float, pid: Path) -> None:
    """In the process of the command: somebody who will stop it, and listens to nobody."""
    pid.write_text(str(os.getpid()))
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have begun all this in the background
    command = os.getpid()
    if os.fork():
        return
    os.setsid()
    time.sleep(after)
    try:
        (os.killpg if kind == signal.SIGINT else os.kill)(command, kind)
    finally:
        os._exit(0)


def _judged(ended: Ended, kind: signal.Signals, name: str, place: Path, what: str, left: bool) -> Outcome:
    """What came of it."""
    code, line = ENDS[kind]
    if ended.code is None:
        return Outcome("hang", what)
    wrong = damage({}, place)
    if left or wrong:
        return Outcome("wrong", f"{what}: {wrong}")
    if ended.code == 0:
        return Outcome("right answer" if _graceful(place) or not missing(name, place) else "wrong", what)
    told = [said for said in ended.err.splitlines() if name != "trial" or "left" not in said]
    if ended.code == code and told == [line]:
        return Outcome("clear error", what)
    return Outcome("traceback" if "Traceback" in ended.err else "wrong", what)


def _graceful(place: Path) -> bool:
    """Whether a training ended after its epoch, and has said so."""
    scores = place / "out" / "scores.json"
    return scores.is_file() and json.loads(scores.read_text())["training"]["stopped"] == "ctrl-C"
