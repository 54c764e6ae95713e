"""Candidates shared out among processes: threads would wait for each other in Python."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from typing import TypeVar

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
        The results in order.
    """
    if min(workers, count) < 2 or "fork" not in multiprocessing.get_all_start_methods():
        yield from map(work, range(count))
        return
    _work.append(work)
    try:
        with multiprocessing.get_context("fork").Pool(min(workers, count), _leave_ctrl_c) as pool:
            yield from pool.imap(_do, range(count))
    finally:
        _work.pop()


def _leave_ctrl_c() -> None:
    """Ctrl-C is for the process that began this one, and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(number: int) -> object:
    return _work[-1](number)
