"""Whatever ends a command early is one line and an exit code."""

import errno
import io
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from tiers import mainly

from manoeuvre_nn.core.ending import WATCH, Terminated, end_with_parent, explain, listen, one_line
from manoeuvre_nn.core.errors import InputError


def ended(act, capsys) -> tuple[int, str]:
    """Exit code and what is told when something ends a command."""
    with pytest.raises(SystemExit) as caught, one_line():
        act()
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1
    return caught.value.code, told.err.strip()


def raising(error):
    def act():
        raise error

    return act


def test_wrong_input_ends_with_2(capsys):
    assert ended(raising(InputError("write a\nsmaller one")), capsys) == (2, "error: write a smaller one")


@pytest.mark.parametrize("error", [ZeroDivisionError, TypeError, ValueError, KeyError, AssertionError, OSError])
def test_a_fault_of_the_program_ends_with_1_and_its_traceback_is_in_a_file(error, capsys):
    code, told = ended(raising(error("a fault")), capsys)
    path = Path(told.rpartition(" ")[2])
    try:
        assert code == 1 and told.startswith(f"error: {error.__name__}: ") and "a fault" in told
        assert path.read_text().startswith("Traceback") and "in raising" not in told and __file__ in path.read_text()
    finally:
        path.unlink()


def test_where_no_file_can_be_written_the_traceback_is_printed(capsys, monkeypatch):
    monkeypatch.setattr(tempfile, "NamedTemporaryFile", lambda *_, **__: raising(OSError(errno.ENOSPC, "full"))())
    with pytest.raises(SystemExit) as caught, one_line():
        raise ZeroDivisionError("x")
    told = capsys.readouterr().err
    assert caught.value.code == 1 and "Traceback" in told and told.endswith("report it with the lines above\n")


def test_a_line_is_never_longer_than_a_screen(capsys):
    code, told = ended(raising(InputError(f"name={5000 * 'x'} is unknown: write another")), capsys)
    assert code == 2 and len(told) < 910 and " ... " in told and told.endswith("x is unknown: write another")


def test_ctrl_c_ends_with_130(capsys):
    assert ended(lambda: os.kill(os.getpid(), signal.SIGINT), capsys) == (130, "stopped by ctrl-C")


def test_sigterm_ends_with_143_and_is_what_it_was_before_afterwards(capsys):
    before = signal.getsignal(signal.SIGTERM)
    cleaned = []

    def act():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            cleaned.append(True)

    assert ended(act, capsys) == (143, "stopped by SIGTERM")
    assert cleaned and signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_that_compiled_code_may_not_raise_is_told_in_a_line(number, code, capsys):
    """As scipy's Sobol points do it: they print it by the hook of what ends a program, then say that it is lost."""

    def act():
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt as error:
            sys.excepthook(type(error), error, error.__traceback__)
            sys.unraisablehook(SimpleNamespace(exc_value=error))
        time.sleep(20.0)

    before = sys.excepthook
    assert ended(act, capsys) == (code, "stopped by SIGTERM" if code == 143 else "stopped by ctrl-C")
    assert sys.excepthook is before

    with one_line():
        sys.excepthook(ValueError, ValueError("of another kind"), None)
    assert capsys.readouterr().err.strip() == "ValueError: of another kind"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_that_comes_while_memory_is_freed_is_not_lost(number, code, capsys):
    class Freed:
        def __del__(self):
            signal.raise_signal(number)

    def act():
        Freed()  # Python would print what is raised now, and go on
        threading.Event().wait(10)

    assert ended(act, capsys) == (code, "stopped by SIGTERM" if code == 143 else "stopped by ctrl-C")


def test_one_inside_another_says_it_once(capsys):
    def act():
        with one_line():
            raise InputError("write another")

    assert ended(act, capsys) == (2, "error: write another")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_one_line_even_where_the_system_names_no_file(number, capsys):
    code, told = ended(raising(OSError(number, os.strerror(number))), capsys)
    assert code == 2 and told.startswith(f"error: cannot write: {os.strerror(number)}: make room, or choose another")
    assert "cannot write /a/b:" in explain(OSError(number, os.strerror(number), "/a/b"))


def test_a_file_that_may_not_be_read_is_told_from_one_that_may_not_be_written(tmp_path, monkeypatch):
    path = tmp_path / "there.csv"
    path.write_text("")
    error = OSError(errno.EACCES, "Permission denied", str(path))
    assert f"cannot write {path}: Permission denied; choose another folder" in explain(error)
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.R_OK)
    assert f"cannot read {path}: Permission denied; ask its owner" in explain(error)
    assert "cannot write" in explain(OSError(errno.EACCES, "Permission denied", str(tmp_path / "not_there.csv")))


def test_a_full_disk_is_seen_behind_what_a_library_makes_of_it():
    with pytest.raises(RuntimeError) as caught:
        try:
            raise OSError(errno.ENOSPC, "No space left on device", "/a/b")
        except OSError as error:
            raise RuntimeError("enforce fail at inline_container.cc") from error
    assert "cannot write /a/b" in explain(caught.value)


def test_a_thread_is_quiet_of_a_full_disk_and_of_nothing_else(monkeypatch):
    def run(error):
        thread = threading.Thread(target=raising(error))
        thread.start()
        thread.join()

    told = []
    monkeypatch.setattr(threading, "excepthook", lambda args: told.append(args.exc_value))
    fault = ZeroDivisionError("x")
    with one_line():
        run(OSError(errno.ENOSPC, "full"))
        run(fault)
    run(late := OSError(errno.ENOSPC, "full"))
    assert told == [fault, late]


def test_outside_the_main_thread_it_works_without_signals(capsys):
    codes = []

    def act():
        try:
            with one_line():
                raise InputError("no")
        except SystemExit as end:
            codes.append(end.code)

    thread = threading.Thread(target=act)
    thread.start()
    thread.join()
    assert codes == [2]


def test_a_forked_process_is_ended_by_sigterm_however_soon_it_comes():
    with one_line():
        for _ in range(20):
            child = os.fork()
            if not child:
                signal.alarm(5)
                signal.pause()
            os.kill(child, signal.SIGTERM)
            _, status = os.waitpid(child, 0)
            assert os.WTERMSIG(status) == signal.SIGTERM
        assert signal.SIGTERM not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_what_ends_on_ctrl_c_ends_on_sigterm():
    assert issubclass(Terminated, KeyboardInterrupt)


def test_what_a_library_makes_of_ctrl_c_is_still_ctrl_c(capsys):
    def act():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt as stop:
            raise ImportError("cannot import a module") from stop

    assert ended(act, capsys) == (130, "stopped by ctrl-C")


@pytest.mark.parametrize("fails", [
    ValueError("Invalid affine transformation matrix"),  # as matplotlib's C++ does
    InputError("goal=accuracy asks an ensemble"),  # as where a class was imported twice
])  # fmt: skip
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_of_which_a_library_leaves_no_trace_is_still_told(number, code, fails, capsys):
    def act(stopped=True):
        if stopped:
            with suppress(KeyboardInterrupt):
                signal.raise_signal(number)
        raise fails

    assert ended(act, capsys) == (code, "stopped by SIGTERM" if code == 143 else "stopped by ctrl-C")
    code, told = ended(lambda: act(False), capsys)
    assert code == (2 if isinstance(fails, InputError) else 1)
    if code == 1:
        Path(told.rpartition(" ")[2]).unlink()


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 7.11 PiB"), RuntimeError("DefaultCPUAllocator: can't allocate memory")]
)
def test_sizes_that_no_memory_has_are_wrong_input(error, capsys):
    code, told = ended(raising(error), capsys)
    assert code == 2 and told.startswith("error: not enough memory (") and "write smaller sizes" in told


@pytest.mark.parametrize(("number", "code", "told"), [(2, 130, "ctrl-C"), (15, 143, "SIGTERM")])
def test_a_program_that_still_imports_ends_in_one_line(number, code, told):
    start = "from manoeuvre_nn.core.ending import listen; listen(); import time; print(flush=True); time.sleep(60)"
    script = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {start}"
    process = subprocess.Popen(
        [sys.executable, "-c", script], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.readline()
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (code, f"stopped by {told}\n")


def test_the_commands_listen_before_they_import_anything_that_takes_long():
    script = "import manoeuvre_nn.commands.start, sys; print({'hydra', 'numpy', 'torch', 'yaml'} & set(sys.modules))"
    assert (
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout == "set()\n"
    )


def test_ctrl_c_is_raised_again_where_it_can_be_ended_orderly(capsys, monkeypatch):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail("it was ended at once"))
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        listen()
        assert ended(lambda: os.kill(os.getpid(), signal.SIGINT), capsys) == (130, "stopped by ctrl-C")
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


BEGINS_OTHERS = {
    "that of a pool": """
from manoeuvre_nn.diagnosis.workers import shared_out
list(shared_out([lambda: work(0), lambda: work(1)], 2))
""",
    "one that says so": """
def alone(): end_with_parent(); work(0)
process = multiprocessing.get_context("fork").Process(target=alone)
process.start(), process.join()
""",
}


@pytest.mark.parametrize("begins", mainly(1, BEGINS_OTHERS.values()), ids=BEGINS_OTHERS)
def test_a_process_that_another_began_ends_when_that_one_is_killed(begins):
    code = f"""
import multiprocessing, os, time
from manoeuvre_nn.core.ending import end_with_parent
def work(number): print(os.getpid(), flush=True); time.sleep(60)
{begins}"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.kill()
    for _ in range(100):
        if not Path(f"/proc/{child}").exists():
            return
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    pytest.fail(f"{child} is still there")


def test_a_process_of_a_person_does_not_end_with_its_shell():
    end_with_parent()
    assert WATCH not in {thread.name for thread in threading.enumerate()}


class Full(io.StringIO):
    """A stream on a full disk."""

    def write(self, text):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_the_exit_code_is_the_same_where_the_line_cannot_be_written(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Full())
    with pytest.raises(SystemExit) as end, one_line():
        raise InputError("write another")
    assert end.value.code == 2


def test_streams_that_a_shell_has_closed_go_nowhere(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    with one_line():
        print("done")
    assert sys.stdout.name == os.devnull
    sys.stdout.close(), sys.stderr.close()
