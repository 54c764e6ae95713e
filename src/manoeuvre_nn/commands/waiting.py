"""What is being done while a person waits."""

from collections.abc import Generator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from manoeuvre_nn.core.terminal import Say


@contextmanager
def waiting(console: Console, what: str = "", seconds: float = 15.0, first: float = 5.0) -> Generator[Say]:
    """Show what is being done, and for how long.

    Args:
        console: Where: on a terminal a line that moves and goes again, elsewhere a line now and then.
        what: What is done first.
        seconds: Time between these lines [s].
        first: Time after which the first of them comes [s].

    Yields:
        What is told each time that something else is done.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task, done, began, words = bar.add_task(what, total=None), Event(), monotonic(), [what]

    def say(what: str) -> None:
        words[0] = what
        bar.update(task, description=what)

    def now_and_then() -> None:
        pause = min(first, seconds)
        while not done.wait(pause):
            pause = seconds
            console.print(f"{words[0]}: {monotonic() - began:.0f} s so far", highlight=False, markup=False)

    thread = Thread(target=now_and_then, daemon=True)
    if not console.is_terminal:
        thread.start()
    try:
        with bar:
            yield say
    finally:
        done.set()
