"""Memory: what would not fit is refused before the system ends the process without a word."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from manoeuvre_nn.core.errors import InputError

try:
    import resource
except ImportError:  # Windows has no limits of a process
    resource = None  # type: ignore[assignment]

MAPPED = 5e8
"""What libraries that are loaded on the way map of their files, which takes no memory [byte]."""


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


@contextmanager
def within_free_memory() -> Generator[None]:
    """What is done inside ends with a ``MemoryError`` where it would take more than is free; only where Linux says it.

    For files that may unpack to far more than their size says.
    """
    free = free_memory()
    if free is None or resource is None:
        yield
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    asked = [pages * resource.getpagesize() + int(MAPPED + free), *(limit for limit in (soft, hard) if limit >= 0)]
    resource.setrlimit(resource.RLIMIT_AS, (min(asked), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
