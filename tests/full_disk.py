"""A disk that is full."""

import resource
from contextlib import contextmanager


@contextmanager
def room_for(bytes_a_file: int):
    """A disk that is full when a file reaches a size: the system ends writing as on a full disk, with EFBIG."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_a_file, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
