"""Candidates shared out among processes: threads would wait for each other in Python."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

from manoeuvre_nn.core.ending import end_with_parent

Result = TypeVar("Result")
_work: list[Callable[[int], object]] = []
"""What a forked process is to do; it inherits the recordings with it, so that nothing large is sent."""


def shared_out(work: Callable[[int], Result], count: int, workers: int) -> Iterator[Result]:
    """Do ``work(0)`` to ``work(count - 1)``, several at a time.

    Args:
        work: Its results are sent between processes.
        count: How many.
        workers: Processes; 1, or a system that cannot fork, does all in this one.

    Yields:
        The results in order; that a process was killed, as one is where memory is short, is a ``BrokenProcessPool``.
    """
    if min(workers, count) < 2 or "fork" not in multiprocessing.get_all_start_methods():
        yield from map(work, range(count))
        return
    _work.append(work)
    # multiprocessing's own pool would wait for ever for what a killed process was to do.
    pool = ProcessPoolExecutor(min(workers, count), multiprocessing.get_context("fork"), _begin)
    try:
        yield from pool.map(_do, range(count))
    except BaseException:  # nobody waits for the others
        for process in dict(pool._processes or {}).values():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        _work.pop()


def _begin() -> None:
    """Leave ctrl-C to the process that began this one, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def _do(number: int) -> Any:
    return _work[-1](number)
