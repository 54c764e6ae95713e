"""Memory: what would not fit is refused before the system ends the process without a word."""

from pathlib import Path

from manoeuvre_nn.core.errors import InputError


def free_memory() -> float | None:
    """Bytes of memory that can be had without swapping; None where the system does not say it (only Linux does)."""
    try:
        said = Path("/proc/meminfo").read_text().partition("MemAvailable:")[2].split()
        return 1024.0 * int(said[0])
    except (OSError, IndexError, ValueError):
        return None


def check_memory(what: str, needed: float, remedy: str) -> None:
    """Refuse what would not fit into the memory that is free.

    Args:
        what: What needs it, in the plural.
        needed: About how much [byte].
        remedy: What to do.

    Raises:
        InputError: If it does not fit.
    """
    free = free_memory()
    if free is not None and needed > free:
        raise InputError(f"{what} need about {needed / 1e9:.2g} GB of memory, {free / 1e9:.2g} GB are free: {remedy}")
