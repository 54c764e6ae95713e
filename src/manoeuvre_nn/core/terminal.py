"""The terminal: what comes from files is shown there and never obeyed."""

from collections.abc import Callable, Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from manoeuvre_nn.core.plain_text import OBEYED, harmless

Say = Callable[[str], None]
"""Tells the person who waits what is being done."""


class Terminal(Console):
    """A console that takes brackets, colons and control characters in a text for letters."""

    def __init__(self, **settings: Any) -> None:
        """Set up; ``settings`` are those of rich's console."""
        super().__init__(**{"markup": False, "emoji": False, **settings})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Parts of a text with their styles; rich's own colours are styles, so that a code in a text is the text's."""
        for part in super().render(renderable, options):
            foreign = not part.control and OBEYED.search(part.text)
            yield Segment(harmless(part.text), part.style) if foreign else part
