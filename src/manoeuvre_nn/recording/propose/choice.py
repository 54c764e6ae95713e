"""How one column of an undescribed file is read, and why."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Choice:
    """How one channel is read, and why.

    Attributes:
        channel: The channel.
        column: Its column as the mapping names it.
        unit: Its unit.
        sign: +1 or -1.
        offset: What the file shows where the true value is zero, in the file's unit.
        why: In words.
        decided: Whether names or data decided; else somebody should look at it.
        misfit: Misfit of what was chosen; empty where nothing can be compared.
        next: Misfit of what the data would choose next, and what that is.
    """

    channel: str
    column: str
    unit: str
    sign: int = 1
    offset: float = 0.0
    why: str = ""
    decided: bool = True
    misfit: str = ""
    next: str = ""

    @property
    def entry(self) -> dict[str, Any]:
        """What a mapping says of the channel."""
        entry: dict[str, Any] = {"column": self.column, "unit": self.unit}
        entry |= {"sign": self.sign} if self.sign != 1 else {}
        return entry | ({"offset": self.offset} if self.offset else {})
