"""Tasks shared out among processes: threads would wait for each other in Python."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

from manoeuvre_nn.core.ending import end_with_parent

Result = TypeVar("Result")
_tasks: Sequence[Callable[[], Any]] = ()
"""In a forked process: what its pool is to do, inherited with the recordings, so that nothing large is sent."""


def shared_out(tasks: Sequence[Callable[[], Result]], workers: int) -> Iterator[Result]:
    """Do tasks that do not depend on each other, several at a time.

    Args:
        tasks: Their results are sent between processes.
        workers: Processes; 1, or a system that cannot fork, does all in this one.

    Yields:
        The results in order; that a process was killed, as one is where memory is short, is a ``BrokenProcessPool``.
    """
    count = min(workers, len(tasks))
    if count < 2 or "fork" not in multiprocessing.get_all_start_methods():
        yield from (task() for task in tasks)
        return
    # multiprocessing's own pool would wait for ever for what a killed process was to do.
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("fork"), _begin, (tasks,))
    try:
        yield from pool.map(_do, range(len(tasks)))
    except BaseException:  # nobody waits for the others
        for process in dict(pool._processes or {}).values():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(tasks: Sequence[Callable[[], Any]]) -> None:
    """Take the tasks, leave ctrl-C to the process that began this one, and end with it."""
    global _tasks
    _tasks = tasks
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def _do(number: int) -> Any:
    return _tasks[number]()
