"""How every file is written: whole or not at all, and by one process at a time in a folder."""

import errno
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from manoeuvre_nn.core.errors import InputError

try:
    import fcntl
except ImportError:  # Windows: nothing keeps two processes out of one folder there
    fcntl = None  # type: ignore[assignment]

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""How a system says that no more can be written: the disk, a quota, or the allowed size of a file is used up."""
MAX_NAME = 80
"""Characters of a file's name that its draft keeps: names may be as long as a file system takes."""
LOCK = ".lock"
"""File in a folder that the process at work in it holds; it holds the number of the process."""
_held: dict[str, int] = {}
"""Locked folder -> descriptor of its lock."""


class FolderInUse(ValueError):
    """Another process is at work in a folder; told as wrong input is."""


@contextmanager
def draft_of(path: Path) -> Generator[Path]:
    """Give the path of a draft, which takes a file's place when it is written whole and is on the disk.

    Until then, and whatever goes wrong before, the file is as it was: nobody ever finds half of it. A link stays a
    link; what is no file, such as ``/dev/stdout``, is written to directly; a named pipe must have a reader.

    Args:
        path: The file; its folder is made if need be.

    Yields:
        Path to write to, in the same folder.

    Raises:
        OSError: If it cannot be written; it names the file, also where the system does not (a full disk).
        PermissionError: If the file may not be written to, though its folder may.
    """
    path = Path(os.path.realpath(path))
    if path.exists() and not path.is_file():
        with _read_by_somebody(path):
            yield path
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not os.access(path, os.W_OK):  # which replacing it would not mind
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    draft = path.with_name(f".{path.name[:MAX_NAME]}.{os.getpid()}.part")
    _remove_abandoned(draft)
    try:
        yield draft
        with draft.open("rb+") as written:
            os.fsync(written.fileno())
        if path.exists():
            shutil.copymode(path, draft)
        draft.replace(path)
    except OSError as error:
        if error.errno is None or error.filename not in {None, str(draft)}:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            draft.unlink()


@contextmanager
def _read_by_somebody(path: Path) -> Generator[None]:
    """Hold a named pipe open, whose reader would otherwise be waited for without end; nothing for what is none."""
    if not path.is_fifo():
        yield
        return
    try:
        end = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    except OSError as error:
        if error.errno != errno.ENXIO:
            raise
        raise InputError(f"{path} is a pipe that nobody reads: write a file") from None
    try:
        yield
    finally:
        os.close(end)


def _remove_abandoned(draft: Path) -> None:
    """Remove drafts of the same file whose processes were killed; those of others at work are left alone."""
    if fcntl is None:  # Windows: to ask for a process there is to send it a signal
        return
    begin = draft.name.removesuffix(f"{os.getpid()}.part")
    with suppress(OSError):
        for other in draft.parent.iterdir():
            number = other.name.removeprefix(begin).removesuffix(".part")
            if other.name == f"{begin}{number}.part" and number.isdecimal() and not _runs(int(number)):
                other.unlink()


def _runs(process: int) -> bool:
    """Whether a process runs, whoever's it is."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    with suppress(OSError):  # where there is /proc: one that has ended and that nobody has asked for has the state Z
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    return True


def write_file(path: Path, content: str | bytes) -> None:
    """Write a text, in UTF-8, or bytes to a file as a whole or not at all, see :func:`draft_of`."""
    with draft_of(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def locked(folder: Path, *, wait: bool = False) -> Generator[None]:
    """Keep other processes out of a folder, which is made if need be.

    The lock is the system's, so that a process that dies does not keep it, however it dies.

    Args:
        folder: The folder; if another process is at work in it, that is a :class:`FolderInUse`.
        wait: Whether to wait until that has ended.
    """
    name = os.path.realpath(folder)
    if name in _held:
        yield
        return
    Path(name).mkdir(parents=True, exist_ok=True)
    lock = _lock(Path(name), wait)
    if lock is None:
        yield
        return
    _held[name] = lock
    try:
        yield
    finally:
        # Removed before it is let go: one who opened it in between finds that it is not the folder's any more.
        Path(name, LOCK).unlink(missing_ok=True)
        os.close(_held.pop(name))


def _lock(folder: Path, wait: bool) -> int | None:
    """Descriptor of a folder's lock; None where there are no locks, or nothing can be written there anyway."""
    if fcntl is None:
        return None
    path = folder / LOCK
    while True:
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            if error.errno in {errno.EACCES, errno.EROFS}:
                return None
            raise
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            holder = os.read(lock, 20).decode(errors="replace")
            os.close(lock)
            if error.errno not in {errno.EAGAIN, errno.EACCES}:  # a file system without locks
                return None
            raise FolderInUse(
                f"{folder}: another run (process {holder or 'unknown'}) is at work in this folder: wait for it, or "
                "choose another folder"
            ) from None
        with suppress(OSError):
            if os.path.samestat(os.fstat(lock), path.stat()):
                with suppress(OSError):  # the disk may be full: the number is only for the message
                    os.truncate(lock, 0)
                    os.write(lock, str(os.getpid()).encode())
                return lock
        os.close(lock)  # of one who has just let go


def _let_go() -> None:
    """In a forked process: the lock is its parent's, and must not outlive that."""
    while _held:
        os.close(_held.popitem()[1])


if fcntl is not None:
    os.register_at_fork(after_in_child=_let_go)
