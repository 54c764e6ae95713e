"""How large a number may be that a person sets, and how an argument says that it takes others."""

from math import inf
from typing import Annotated, Any, NamedTuple

LARGEST_NUMBER, SMALLEST_NUMBER = 1e15, 1e-30
"""No number that is set is larger, and none that is not 0 is smaller: whatever it measures, a square of it is a number
yet, and so is what it divides."""
MAX_COUNTED = 10**9
"""Nothing that is counted is more."""
MAX_SEED = 2**63 - 1
"""Largest whole number that torch and numpy take as a seed."""


class NumberLimits(NamedTuple):
    """What an argument takes, in ``Annotated[float, NumberLimits(...)]``.

    Attributes:
        low: The smallest number.
        high: The largest one.
    """

    low: float = -LARGEST_NUMBER
    high: float = LARGEST_NUMBER

    def hold(self, value: Any) -> bool:
        """Whether a value is a number within them; NaN is none."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and self.low <= value <= self.high

    def __str__(self) -> str:
        """In words, after *a number*."""
        no_end = self.high in {inf, LARGEST_NUMBER, MAX_COUNTED, MAX_SEED} and self.low in {SMALLEST_NUMBER, 0, 1}
        if self.high == -self.low == inf:
            return ""
        least = "more than 0" if self.low == SMALLEST_NUMBER else f"{self.low:g} or more"
        return f", {least}" if no_end else f" from {self.low:g} to {self.high:g}"


Endless = Annotated[float, NumberLimits(-inf, inf)]
"""A number that may be infinite."""
Positive = Annotated[float, NumberLimits(SMALLEST_NUMBER, LARGEST_NUMBER)]
"""A number more than 0."""
NotNegative = Annotated[float, NumberLimits(0.0, LARGEST_NUMBER)]
"""A number, 0 or more."""
Factor = Annotated[float, NumberLimits(1e-6, 1e6)]
"""A number more than 0 of what has a usual size of 1."""
Weight = Annotated[float, NumberLimits(0.0, 1e6)]
"""The same, or 0."""
Share = Annotated[float, NumberLimits(0.0, 1.0)]
"""A part of a whole."""
Derivative = Annotated[float, NumberLimits(-10.0, 10.0)]
"""A coefficient that has no unit: hydrodynamic derivatives in the (rho, L, T, U0) system are below .1."""
Rate = Annotated[float, NumberLimits(1e-6, 1e4)]
"""Samples a second."""
Count = Annotated[int, NumberLimits(1, MAX_COUNTED)]
"""How many; at least one."""
CountOrNone = Annotated[int, NumberLimits(0, MAX_COUNTED)]
"""How many; 0 is none."""


def is_sensible(value: Any, largest: float | int = LARGEST_NUMBER) -> bool:
    """Whether a value is a number that a person may set.

    Args:
        value: Anything.
        largest: How large it may be.

    Returns:
        False if it is NaN, infinite, larger, or so near to 0 that 0 is meant.
    """
    return NumberLimits(-largest, largest).hold(value) and (value == 0 or abs(value) >= SMALLEST_NUMBER)


def as_seed(number: int) -> int:
    """A whole number that is derived from a seed, within what torch and numpy take; those within it as they are."""
    return number % (MAX_SEED + 1)
