"""One attack: something wrong or hostile is done in a process of its own, and what comes of it is named."""

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

Result = Literal["clear error", "right answer", "wrong", "traceback", "hang", "executed"]
RESULTS: tuple[Result, ...] = get_args(Result)
BAD: tuple[Result, ...] = ("wrong", "traceback", "hang", "executed")
"""What must never come of an attack."""
END_S = 10.0
"""How long processes may take to see that the one that began them was killed: imports are not interrupted [s]."""


@dataclass(frozen=True)
class Outcome:
    """What came of an attack.

    Attributes:
        result: Its name.
        what: What was done, and for a bad result what was seen, on a line.
    """

    result: Result
    what: str


Attack = Callable[[int, int, Path], Outcome]
"""Number of the attack, seed, empty folder to work in -> outcome; the same number and seed do the same again."""


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    Attributes:
        code: Exit code; negative is the signal that killed it, None that it was killed after the limit.
        out: What it printed.
        err: What it printed to stderr.
        seconds: How long it ran.
        left: Names of processes that it had begun and that did not end with it; they are killed.
    """

    code: int | None
    out: str
    err: str
    seconds: float
    left: tuple[str, ...] = ()


def in_child(work: Callable[[], None], folder: Path, limit_s: float, alone: bool = False) -> Ended:
    """Run a function in a forked process, so that nothing that it does stays.

    Args:
        work: The function; it ends as a command does, with SystemExit, or with a traceback.
        folder: Where the texts that it prints are kept meanwhile.
        limit_s: After this long it is killed [s].
        alone: Whether it is killed alone, or with all that it has begun.

    Returns:
        How it ended.
    """
    texts = folder / "stdout.txt", folder / "stderr.txt"
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _be_child(work, texts)
    code = _wait(child, began + limit_s, alone)
    left = _left_after(child) if code is None and alone else ()
    out, err = (path.read_text(errors="replace") if path.exists() else "" for path in texts)
    for path in texts:
        path.unlink(missing_ok=True)
    return Ended(code, out, err, time.monotonic() - began, left)


def _wait(child: int, until: float, alone: bool) -> int | None:
    """Exit code of a child; None if it had to be killed, alone or with whatever it had started."""
    pause = 0.001
    while time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(pause)
        pause = min(1.5 * pause, 0.05)
    try:
        (os.kill if alone else os.killpg)(child, signal.SIGKILL)
    except ProcessLookupError:  # it has no group of its own yet, and has started nothing
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _left_after(session: int) -> tuple[str, ...]:
    """What has not ended some seconds after the process that began it; it is killed."""
    until = time.monotonic() + END_S
    while processes_of(session) and time.monotonic() < until:
        time.sleep(0.1)
    return kill_session(session)


def processes_of(session: int) -> dict[int, str]:
    """Number -> name of the processes of a session that are still there."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, fields = path.read_text().rsplit(")", 1)
        except OSError:
            continue
        if int(fields.split()[3]) == session and fields.split()[0] != "Z":
            found[int(path.parent.name)] = name.partition("(")[2]
    return found


def kill_session(session: int) -> tuple[str, ...]:
    """Kill what is left of a session; their names."""
    left = processes_of(session)
    for number in left:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    return tuple(left.values())


def _be_child(work: Callable[[], None], texts: tuple[Path, Path]) -> None:
    """Do the work with output to files, and end the process without what the parent would do at its end."""
    code = 1
    try:
        os.setsid()
        for number, path in zip((1, 2), texts, strict=True):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        work()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                pass
        os._exit(code)
