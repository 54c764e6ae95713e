"""What is being done while a person waits, and for how much longer."""

from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from threading import Event, Thread
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from manoeuvre_nn.core.terminal import Say, show_passing, silent_s

PAUSE_S = 4.5
"""Longest silence where there is no terminal [s]: nothing is silent for 5 s."""
TICK_S = 0.5
"""Time between two looks [s]."""
LATE = "longer than expected"
"""In place of the time that is left, once it has passed."""
BAR_COLUMNS = 16
"""Columns of the bar."""
Poll = Callable[[], tuple[str, float | None]]
"""What is being done, and which share of it is done, for work that does not tell."""


class _Work:
    """What is being done, its share that is done, and the time that is left if it goes on as it went."""

    def __init__(self, what: str) -> None:
        self.what, self.began = what, monotonic()
        self.first: tuple[float, float] | None = None
        self.last: tuple[float, float] | None = None

    def say(self, what: str, share: float | None = None) -> None:
        """Something else is done now; ``share`` of the whole, from 0 to 1, is behind."""
        self.what = what
        if share is None:
            self.first = self.last = None
            return
        if self.last is None or share != self.last[1]:  # a share that is told again is no older
            self.last = (monotonic(), share)
        self.first = self.first or self.last

    @property
    def share(self) -> float | None:
        """Share that is done; None if nobody knows."""
        return self.last[1] if self.last else None

    @property
    def left(self) -> str:
        """The time that is left, in words; empty if it is not known. What was done before a resumption took none."""
        if self.first is None or self.last is None or self.last[1] <= self.first[1]:
            return ""
        pace = (self.last[0] - self.first[0]) / (self.last[1] - self.first[1])
        seconds = pace * (1 - self.last[1]) - (monotonic() - self.last[0])
        if seconds < 0:
            return LATE
        return f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"

    @property
    def line(self) -> str:
        """All of it."""
        so_far = f"{self.what}: {monotonic() - self.began:.0f} s so far"
        return ", ".join(part for part in (so_far, self.left) if part)


loading = ExitStack()
"""Held from the first moment of a program until it is loaded."""


@contextmanager
def waiting(console: Console, what: str = "", seconds: float = PAUSE_S, poll: Poll | None = None) -> Generator[Say]:
    """Show what is being done, for how long, and how long it will take.

    Args:
        console: Where: on a terminal a line that moves and goes again, elsewhere a line now and then.
        what: What is done first.
        seconds: Time between these lines [s].
        poll: Says before each line what is done, where the work itself does not.

    Yields:
        What is told each time that something else is done, with the share of all that is done then, if it is known.
    """
    columns = (
        SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(BAR_COLUMNS), TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )  # fmt: skip
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    work, task, done = _Work(what), bar.add_task(what, total=None, left=""), Event()

    def show() -> None:
        share = work.share
        bar.update(task, description=work.what, total=share and 1.0, completed=share or 0.0, left=work.left)

    def say(what: str, share: float | None = None) -> None:
        work.say(what, share)
        show()

    def now_and_then() -> None:
        tick = min(TICK_S, seconds)
        while not done.wait(tick):
            if poll is not None:
                work.say(*poll())
            if console.is_terminal:
                show()
            elif work.what and silent_s() + tick > seconds:
                show_passing(console, work.line)

    Thread(target=now_and_then, daemon=True).start()
    try:
        with bar:
            yield say
    finally:
        done.set()
