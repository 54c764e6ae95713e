"""The terminal: what comes from files is shown there and never obeyed, and what stays there is logged."""

import io
import logging
import threading
from collections.abc import Callable, Iterable
from time import monotonic
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.control import Control
from rich.segment import Segment

from manoeuvre_nn.core.ending import UNREAD, send_nowhere
from manoeuvre_nn.core.plain_text import OBEYED, harmless

Say = Callable[..., None]
"""Tells the person who waits what is being done and, after it, which share of all is done, from 0 to 1."""
LOG = logging.getLogger("manoeuvre_nn")
"""Where everything goes that a command prints, but for its progress; what becomes of it is the command's matter."""
LOG_WIDTH = 120
"""Columns of a table in a log."""
_quiet = False
_shown_at = monotonic()


def silent_s() -> float:
    """Time since anything was shown on a terminal of ours, or since the program began [s]."""
    return monotonic() - _shown_at


def be_quiet(quiet: bool) -> None:
    """Say whether terminals that are opened from now on show nothing; what is printed is logged all the same."""
    global _quiet
    _quiet = quiet


def show_passing(console: Console, line: str) -> None:
    """Print a line of progress, which is not logged."""
    global _shown_at
    Console.print(console, line, highlight=False, markup=False)
    _shown_at = monotonic()


class Terminal(Console):
    """A console that takes brackets, colons and control characters in a text for letters."""

    def __init__(self, **settings: Any) -> None:
        """Set up; ``settings`` are those of rich's console."""
        usual: dict[str, Any] = {"markup": False, "emoji": False, "quiet": _quiet}
        super().__init__(**usual | settings)

    def print(self, *objects: Any, **settings: Any) -> None:
        """Print and log."""
        global _shown_at
        super().print(*objects, **settings)
        _shown_at = monotonic()
        if LOG.isEnabledFor(logging.INFO) and not any(isinstance(one, Control) for one in objects):  # of a bar
            plain = Console(file=io.StringIO(), width=LOG_WIDTH, color_system=None, markup=False, emoji=False)
            settings["highlight"] = False
            plain.print(*objects, **settings)
            for line in plain.file.getvalue().splitlines():  # type: ignore[attr-defined]
                if line.strip():
                    LOG.info("%s", harmless(line.rstrip()))

    def on_broken_pipe(self) -> None:
        """End as a shell expects where nobody reads on; a thread leaves that to the command, which prints next.

        Raises:
            SystemExit: With code 141.
        """
        if threading.current_thread() is not threading.main_thread():
            return
        self.quiet = True
        send_nowhere(self.file)
        raise SystemExit(UNREAD)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Parts of a text with their styles; rich's own colours are styles, so that a code in a text is the text's."""
        for part in super().render(renderable, options):
            foreign = not part.control and OBEYED.search(part.text)
            yield Segment(harmless(part.text), part.style) if foreign else part
