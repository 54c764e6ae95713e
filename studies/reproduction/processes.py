"""Chapters done in processes of their own, several at a time; each tells what it is doing, none can stop another."""

import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import monotonic
from typing import Literal

import torch

from manoeuvre_nn.core.ending import end_with_parent, explain, in_short
from manoeuvre_nn.core.threads import use_threads
from studies.reproduction.section import ChapterResult, ComputingEffort, Say

Keep = Callable[[ChapterResult, float], None]
"""Puts a finished chapter, and how long it took [s], where the next command finds it."""


@dataclass(frozen=True)
class Task:
    """A chapter to do.

    Attributes:
        name: What the command line calls it.
        run: Does it.
        keep: Keeps it; both are called in the process of the chapter.
        log: File for what it prints, and for its traceback if it fails.
    """

    name: str
    run: Callable[[ComputingEffort, Say], ChapterResult]
    keep: Keep
    log: Path


@dataclass(frozen=True)
class Event:
    """Something happened.

    Attributes:
        kind: ``began``, ``said``, ``finished``, ``failed``; ``tick`` when nothing did for a while.
        name: The chapter; empty for a tick.
        text: What was said, or why it failed.
    """

    kind: Literal["began", "said", "finished", "failed", "tick"]
    name: str = ""
    text: str = ""


def do_chapters(tasks: Sequence[Task], effort: ComputingEffort, workers: int, tick: float = 0.5) -> Generator[Event]:
    """Do chapters, each in a process with one thread.

    Args:
        tasks: The chapters; they are begun in this order.
        effort: How much computing is allowed.
        workers: Processes at a time.
        tick: Longest time without an event [s].

    Yields:
        What happens. Processes still at work when the caller stops listening are ended.
    """
    forks = "fork" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("fork" if forks else None)
    waiting, running = deque(tasks), dict[Connection, tuple[str, BaseProcess]]()
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                task = waiting.popleft()
                reader, writer = context.Pipe(duplex=False)
                process = context.Process(target=_do, args=(task, effort, writer), daemon=True)  # type: ignore
                process.start()
                writer.close()  # so that the end of the process is the end of the pipe
                running[reader] = task.name, process
                yield Event("began", task.name)
            ready = wait(list(running), tick)
            yield from (Event("tick") for _ in range(not ready))
            for heard in ready:
                assert isinstance(heard, Connection)
                event = _heard(heard, *running[heard])
                if event.kind in {"finished", "failed"}:
                    running.pop(heard)[1].join()
                    heard.close()
                yield event
    finally:
        for _, left in running.values():
            left.terminate()
            left.join()


def _heard(reader: Connection, name: str, process: BaseProcess) -> Event:
    """The next word of a chapter; of one whose process was killed, that it was."""
    try:
        kind, text = reader.recv()
    except (EOFError, OSError):
        process.join()
        code = process.exitcode or 0
        how = f"by signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"with exit code {code}"
        return Event("failed", name, f"its process was ended {how}")
    return Event(kind, name, text)


def _do(task: Task, effort: ComputingEffort, writer: Connection) -> None:
    """Do a chapter in a process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C is the parent's, which ends this process
    end_with_parent()

    def say(what: str) -> None:
        writer.send(("said", what))

    try:
        end = _logged(task, effort, say)
    except OSError as error:  # the log cannot be written, as on a full disk
        end = "failed", explain(error) or in_short(error)
    writer.send(end)


def _logged(task: Task, effort: ComputingEffort, say: Say) -> tuple[str, str]:
    """Do a chapter, with what it prints in its log; how it ended, and why it failed."""
    task.log.parent.mkdir(parents=True, exist_ok=True)
    with task.log.open("w", buffering=1, encoding="utf-8") as log:
        for number in (1, 2):
            os.dup2(log.fileno(), number)  # warnings would tear the display
        sys.stdout = sys.stderr = log
        use_threads(1)
        torch.manual_seed(effort.seed)
        try:
            began = monotonic()
            section = task.run(effort, say)
            task.keep(section, monotonic() - began)
            end = "finished", ""
        except Exception as error:  # whatever it is, the other chapters go on
            with suppress(OSError):
                traceback.print_exc(file=log)
            end = "failed", explain(error) or in_short(error)
    if not task.log.stat().st_size:
        task.log.unlink()
    return end
