"""How a command ends: well, or in one line that says why."""

import errno
import multiprocessing
import os
import select
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType, TracebackType
from typing import Any, TextIO

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.writing import FULL, FolderInUse

WRONG_INPUT, DEFECT = 2, 1
STOPPED, UNREAD, TERMINATED = 130, 141, 143
"""Exit codes after ctrl-C, when nobody reads on (``| head``), and after SIGTERM, as shells have them."""
OF_FILES = (errno.ENOENT, errno.EACCES, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.EROFS, errno.ENAMETOOLONG)
MAX_LINE = 900
"""Characters of a line of an error: names that people give may be as long as they like."""
AGAIN_S = 0.05
"""After this long a signal that was lost is sent again [s]."""
LOOK_S = 0.5
"""How often a process that another began looks whether that one is still there [s]."""
_came: list[KeyboardInterrupt] = []
"""What signals stopped the command that runs: a library may have made something else of it."""
WATCH = "watch of the parent"
"""Name of the thread that looks."""
ANOTHER_FOLDER = "choose another folder (out=)"


class Terminated(KeyboardInterrupt):
    """SIGTERM: ends what ctrl-C ends, in the same way."""


def explain(error: BaseException) -> str | None:
    """The one line that a person needs.

    Args:
        error: What was raised.

    Returns:
        The line; None if the cause is a fault of the program.
    """
    chain = list(causes(error))
    for cause in chain:
        if isinstance(cause, InputError | FolderInUse):
            return str(cause)
        if isinstance(cause, BrokenProcessPool):
            return "one of several processes was killed, as where memory is short: write the same command, with fewer"
    full = next((c for c in chain if isinstance(c, OSError) and c.errno in FULL), None)
    if full is not None:
        which = f"cannot write {full.filename}" if full.filename else "cannot write"
        return f"{which}: {full.strerror}: make room, or {ANOTHER_FOLDER}"
    if any(isinstance(c, MemoryError) or "can't allocate memory" in str(c) for c in chain):
        return f"not enough memory ({in_short(error)[:120]}): write smaller sizes, or shorter or fewer recordings"
    if not isinstance(error, OSError) or error.filename is None or error.errno not in OF_FILES:
        return None
    path = str(error.filename)
    if os.path.isfile(path) and not os.access(path, os.R_OK):
        return f"cannot read {path}: {error.strerror}; ask its owner, or copy it"
    return f"cannot write {path}: {error.strerror}; {ANOTHER_FOLDER}"


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """An error, what it was raised from or while, and so on."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def listen() -> None:
    """From the first line of a program on, while it imports: ctrl-C and SIGTERM end it in one line.

    Nothing is begun yet that must be ended orderly; what is, is inside of :func:`one_line`.
    """
    _open_closed_streams()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in {signal.default_int_handler, signal.SIG_DFL}:  # nobody said otherwise
            signal.signal(number, _end_now)


def _open_closed_streams() -> None:
    """Where a shell has closed a stream (``>&-``), what is printed goes nowhere, and no file takes its number."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))


def _end_now(number: int, frame: FrameType | None) -> None:
    terminated = number == signal.SIGTERM
    os.write(2, f"stopped by {'SIGTERM' if terminated else 'ctrl-C'}\n".encode())
    os._exit(TERMINATED if terminated else STOPPED)


def end_with_parent() -> None:
    """End a process that another began when that one is gone, by kill -9 for instance: nobody waits for its work then.

    A process that a person began goes on, whatever becomes of the shell.
    """
    parent = multiprocessing.parent_process()
    if parent is not None and WATCH not in {thread.name for thread in threading.enumerate()}:
        threading.Thread(target=_end_after, args=(parent.pid,), name=WATCH, daemon=True).start()


def _end_after(parent: int | None) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    os._exit(TERMINATED)


@contextmanager
def one_line(explained: Callable[[BaseException], str | None] = explain) -> Generator[None]:
    """Turn whatever ends a command early into one line and an exit code.

    Args:
        explained: What to say of an error that is no fault of the program; None for one that is.

    Raises:
        SystemExit: With code 2 for wrong input and for what cannot be read or written, 1 for a fault of the program,
            whose traceback is then written to a file, 130 for ctrl-C, 143 for SIGTERM, 141 if nobody reads on.
    """
    _open_closed_streams()
    try:
        with _signals_raised(), _threads_quiet_of_full_disks():
            yield
            sys.stdout.flush()
    except KeyboardInterrupt as stop:
        raise SystemExit(_stopped(stop)) from None
    except Exception as error:
        for cause in causes(error):
            if isinstance(cause, KeyboardInterrupt):  # of which a library has made something else
                raise SystemExit(_stopped(cause)) from None
        if isinstance(error, BrokenPipeError) and _nobody_reads(sys.stdout):
            raise SystemExit(UNREAD) from None
        if _came:  # a library went on after it: what fails then may fail because of it
            raise SystemExit(_stopped(_came[-1])) from None
        line = explained(error)
        if line is not None:
            _tell(f"error: {line}")
            raise SystemExit(WRONG_INPUT) from None
        _tell(f"error: {in_short(error)}: a fault of the program: please report it with {_written_down(error)}")
        raise SystemExit(DEFECT) from error


def _stopped(stop: KeyboardInterrupt) -> int:
    """Say that somebody stopped it; the exit code that goes with it."""
    _tell(stopped_by(stop))
    return TERMINATED if isinstance(stop, Terminated) else STOPPED


def stopped_by(stop: KeyboardInterrupt) -> str:
    """What somebody stopped a command with, in a line."""
    return f"stopped by {'SIGTERM' if isinstance(stop, Terminated) else 'ctrl-C'}"


def _nobody_reads(stream: TextIO) -> bool:
    """Whether the reader of a pipe has left; what is left in the stream then goes nowhere."""
    try:
        number = stream.fileno()
    except (OSError, ValueError):  # no file of the system's
        return False
    if not hasattr(select, "poll"):  # Windows
        return False
    pipe = select.poll()
    pipe.register(number, 0)
    left = any(event & select.POLLERR for _, event in pipe.poll(0))
    if left:
        send_nowhere(stream)
    return left


def send_nowhere(stream: Any) -> None:
    """Let what is left in a stream, and what will be written to it, go nowhere, so that its end is quiet."""
    with suppress(OSError, ValueError):  # no file of the system's
        number, nowhere = stream.fileno(), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


def in_short(error: BaseException) -> str:
    """Kind and first line of a fault of the program."""
    first = next(iter(str(error).splitlines()), "")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def full_story(error: BaseException) -> str:
    """An error's traceback."""
    return "".join(traceback.format_exception(error))


def _tell(line: str) -> None:
    """A line to the person, if it can be; what is longer than a screen with its middle left out."""
    told = harmless(" ".join(line.split()))
    told = told if len(told) <= MAX_LINE else f"{told[: MAX_LINE - 200]} ... {told[-190:]}"
    try:
        print(told, file=sys.stderr, flush=True)
    except OSError:  # it is full, or nobody reads on: the exit code tells it
        send_nowhere(sys.stderr)


def _written_down(error: BaseException) -> str:
    """Path of a file with an error's traceback; where none can be written, it is printed."""
    try:
        with tempfile.NamedTemporaryFile("w", prefix="manoeuvre_", suffix=".txt", delete=False, encoding="utf-8") as f:
            f.write(full_story(error))
    except OSError:
        print(full_story(error), file=sys.stderr)
        return "the lines above"
    return f.name


@contextmanager
def _signals_raised() -> Generator[None]:
    """Make SIGTERM an exception, so that it ends as orderly as ctrl-C; only the main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _ours():
        _came.clear()
    unraisable, printed = sys.unraisablehook, sys.excepthook
    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, _raise_terminated)}
    if signal.getsignal(signal.SIGINT) in {_end_now, signal.default_int_handler}:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, _raise_interrupted)
    sys.unraisablehook, sys.excepthook = partial(_raise_again, unraisable), partial(_print_unless_stopped, printed)
    try:
        yield
    finally:
        sys.unraisablehook, sys.excepthook = unraisable, printed
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


def _print_unless_stopped(
    printed: Callable[..., Any], kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print an error unless it is a signal: compiled code that may not raise prints it, then says that it is lost."""
    if not issubclass(kind, KeyboardInterrupt):
        printed(kind, error, trace)


def _raise_again(told: Callable[[Any], Any], lost: Any) -> None:
    """Send a signal again that came while Python freed memory, where what is raised is lost."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        told(lost)
        return
    number = signal.SIGTERM if isinstance(lost.exc_value, Terminated) else signal.SIGINT
    again = threading.Timer(AGAIN_S, os.kill, (os.getpid(), number))  # by then this is over
    again.daemon = True
    again.start()


def _raise_terminated(number: int, frame: FrameType | None) -> None:
    _came.append(Terminated())
    raise Terminated


def _raise_interrupted(number: int, frame: FrameType | None) -> None:
    _came.append(KeyboardInterrupt())
    raise KeyboardInterrupt


@contextmanager
def _threads_quiet_of_full_disks() -> Generator[None]:
    """Let TensorBoard's thread say nothing of a full disk: the next who writes to it is told."""
    before = threading.excepthook

    def hook(args: threading.ExceptHookArgs) -> None:
        if not (isinstance(args.exc_value, OSError) and args.exc_value.errno in FULL):
            before(args)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = before


def _ours() -> bool:
    """Whether SIGTERM is an exception now."""
    return signal.getsignal(signal.SIGTERM) is _raise_terminated


def _hold_sigterm() -> None:
    """Before a process is forked: what is sent to it before it listens would be lost."""
    if _ours():
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})


def _take_sigterm() -> None:
    """Afterwards, where it was forked from."""
    if _ours():
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def _end_at_sigterm() -> None:
    """Afterwards, in the forked process: it is ended by its parent at once, and has nothing to say."""
    if _ours():
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_hold_sigterm, after_in_parent=_take_sigterm, after_in_child=_end_at_sigterm)
