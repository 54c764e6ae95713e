"""What the person who waits for a paper to be done again sees."""

import re
from time import monotonic

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from studies.reproduction.processes import Event
from studies.reproduction.terminal import clock


class Watch:
    """Which chapters are at work, what they are doing, and for how long: lines that change, or a line now and then."""

    def __init__(self, console: Console, chapters: int, seconds: float = 15.0) -> None:
        """Set up the display.

        Args:
            console: Where to print.
            chapters: Chapters to do.
            seconds: Time between lines of a chapter where the console is not a terminal [s].
        """
        self.console, self.chapters, self.every = console, chapters, seconds
        self._began, self._ended = monotonic(), 0
        self._since: dict[str, float] = {}
        self._doing: dict[str, str] = {}
        self._shown: dict[str, float] = {}
        self._live = Live(console=console, auto_refresh=False, transient=True)  # no thread: processes are forked

    def __enter__(self) -> "Watch":
        """Open the display."""
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Close it, whatever happened."""
        self._live.stop()

    def seconds(self, name: str) -> float:
        """How long ago a chapter began.

        Args:
            name: The chapter.

        Returns:
            Time [s].
        """
        return monotonic() - self._since[name]

    def see(self, event: Event) -> None:
        """Show what happened.

        Args:
            event: The event.
        """
        name = event.name
        if event.kind == "began":
            self._since[name], self._doing[name] = monotonic(), "begins"
        elif event.kind == "said":
            self._doing[name] = re.sub(r"^chapter [\w.]+: ", "", event.text, flags=re.IGNORECASE)  # it stands there
        elif event.kind != "tick":
            self._ended += 1
            self._doing.pop(name)
        if self.console.is_terminal:
            self._live.update(self._lines(), refresh=True)
        elif event.kind in {"began", "said"} and self._due(name, event.kind == "began"):
            line = f"{clock(monotonic() - self._began)}  chapter {name}: {self._doing[name]}"
            self.console.print(line, soft_wrap=True, highlight=False, markup=False)

    def _due(self, name: str, always: bool) -> bool:
        """Whether it is time for a line of this chapter."""
        now = monotonic()
        due = always or now - self._shown[name] > self.every
        if due:
            self._shown[name] = now
        return due

    def _lines(self) -> Group:
        """What is at work now."""
        elapsed = clock(monotonic() - self._began)
        lines = [f"{clock(self.seconds(name)):>6}  chapter {name}: {what}" for name, what in self._doing.items()]
        total = f"{elapsed:>6}  {self._ended} of {self.chapters} chapters done" if self.chapters else ""
        return Group(*(Text(line, "dim", no_wrap=True, overflow="ellipsis") for line in [*lines, total] if line))
