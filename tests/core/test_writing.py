"""Every file is written whole or not at all; two processes are kept out of one folder."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from full_disk import room_for

from manoeuvre_nn.core.writing import LOCK, FolderInUse, draft_of, locked, write_file

HOLD = "import sys, time; from pathlib import Path; from manoeuvre_nn.core.writing import locked\n"


def test_a_text_is_written_in_utf8_and_its_folder_made(tmp_path):
    path = tmp_path / "a" / "b.txt"
    write_file(path, "Grad °\n")
    assert path.read_bytes() == "Grad °\n".encode()
    write_file(path, b"\x00\x01")
    assert path.read_bytes() == b"\x00\x01" and list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("size", [0, 1, 4095])
def test_a_full_disk_leaves_the_old_file_and_no_draft(tmp_path, size):
    path = tmp_path / "mapping.yaml"
    path.write_text("good")
    with room_for(size), pytest.raises(OSError) as caught:
        write_file(path, "x" * 4096)
    assert caught.value.errno == errno.EFBIG and caught.value.filename == str(path)
    assert path.read_text() == "good" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_what_breaks_off_leaves_the_old_file_and_no_draft(tmp_path, error):
    path = tmp_path / "mapping.yaml"
    path.write_text("good")
    with pytest.raises(error), draft_of(path) as draft:
        draft.write_text("half")
        raise error
    assert path.read_text() == "good" and list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_a_draft_of_a_killed_process_goes_when_the_file_is_written_again(tmp_path):
    path, of_another = tmp_path / "scores.json", tmp_path / f".scores.json.{os.getppid()}.part"
    of_another.write_text("half")
    child = os.fork()
    if child == 0:
        with draft_of(path) as draft:
            draft.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)  # ended, and still in the system's list
    assert not path.exists() and (tmp_path / f".scores.json.{child}.part").exists()
    write_file(path, "whole")
    os.waitpid(child, 0)
    assert path.read_text() == "whole" and set(tmp_path.iterdir()) == {path, of_another}


def test_the_draft_is_on_the_disk_before_it_takes_the_place(tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(os, "fsync", lambda file: done.append(os.fstat(file).st_size))
    monkeypatch.setattr(Path, "replace", lambda draft, path: done.append("replaced"))
    write_file(tmp_path / "a", "12345")
    assert done == [5, "replaced"]


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path):
    path, link = tmp_path / "shared.yaml", tmp_path / "mine.yaml"
    path.write_text("old")
    link.symlink_to(path)
    write_file(link, "new")
    assert link.is_symlink() and path.read_text() == "new"
    write_file(Path("/dev/null"), "new")
    assert Path("/dev/null").is_char_device()


def test_a_pipe_that_nobody_reads_is_refused_and_one_that_is_read_gets_all(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    text = "from pathlib import Path; from manoeuvre_nn.core.writing import write_file; write_file(Path('pipe'), 'new')"
    # In a process of its own, which would wait without end.
    refused = subprocess.run([sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert "InputError" in refused.stderr and "pipe is a pipe that nobody reads: write a file" in refused.stderr
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_file(pipe, "new")
    assert os.read(reader, 10) == b"new" and pipe.is_fifo()
    os.close(reader)


def test_permissions_stay_and_a_protected_file_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "mapping.yaml"
    path.write_text("old")
    path.chmod(0o640)
    write_file(path, "new")
    assert path.stat().st_mode & 0o777 == 0o640
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anything
    with pytest.raises(PermissionError) as caught:
        write_file(path, "newer")
    assert caught.value.filename == str(path) and path.read_text() == "new"


def test_a_name_as_long_as_the_system_takes_is_written(tmp_path):
    path = tmp_path / f"{'x' * 251}.csv"
    write_file(path, "a")
    assert path.read_text() == "a"


def held_by(folder: Path) -> subprocess.Popen:
    """A process that is at work in a folder."""
    work = f"{HOLD}with locked(Path({str(folder)!r})):\n print('in', flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "in\n"
    return process


def test_a_process_that_waits_goes_on_when_the_first_has_ended(tmp_path):
    first = held_by(tmp_path / "run")
    work = f"{HOLD}with locked(Path({str(tmp_path / 'run')!r}), wait=True):\n print('in', flush=True)"
    second = subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE, text=True)
    try:
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(timeout=1.5)
        first.kill()
        assert second.communicate(timeout=30)[0] == "in\n"
        assert second.returncode == 0
    finally:
        for process in (first, second):
            process.kill()
            process.communicate()


def test_a_second_process_is_refused_until_the_first_has_died(tmp_path):
    first = held_by(tmp_path / "run")
    try:
        with pytest.raises(FolderInUse, match=rf"run: another run \(process {first.pid}\) is at work"):
            locked(tmp_path / "run").__enter__()
        first.send_signal(signal.SIGKILL)
        first.wait()
        with locked(tmp_path / "run"):
            assert (tmp_path / "run" / LOCK).read_text() == str(os.getpid())
    finally:
        first.kill()
        first.communicate()
    assert list((tmp_path / "run").iterdir()) == []


def test_a_process_may_lock_twice_what_it_holds(tmp_path):
    with locked(tmp_path):
        with locked(tmp_path / "." / ""):
            assert (tmp_path / LOCK).exists()
        assert (tmp_path / LOCK).exists()
    assert not (tmp_path / LOCK).exists()


def test_a_forked_child_does_not_keep_the_lock_of_its_parent(tmp_path):
    work = (
        f"{HOLD}import os\nwith locked(Path({str(tmp_path)!r})):\n"
        " if not os.fork(): print(os.getpid(), flush=True)\n time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    try:
        parent.kill()
        parent.wait()
        with locked(tmp_path):
            os.kill(child, 0)  # it lives on
    finally:
        os.kill(child, signal.SIGKILL)
        parent.stdout.close()


def test_where_nothing_can_be_locked_work_goes_on(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with locked(tmp_path):
        pass
    monkeypatch.setattr(os, "open", lambda *_: (_ for _ in ()).throw(PermissionError(errno.EACCES, "denied", "x")))
    with locked(tmp_path):
        pass


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    (tmp_path / "precious").write_text("mine")
    (tmp_path / LOCK).symlink_to(tmp_path / "precious")
    with pytest.raises(OSError), locked(tmp_path):
        pass
    assert (tmp_path / "precious").read_text() == "mine"


def test_one_who_waited_at_a_lock_that_is_gone_takes_the_new_one(tmp_path, monkeypatch):
    # The holder removes its file between our opening it and our locking it.
    import fcntl

    before, seen = fcntl.flock, []

    def late(lock, how):
        if not seen:
            (tmp_path / LOCK).unlink()
        seen.append(lock)
        before(lock, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with locked(tmp_path):
        assert len(seen) == 2 and (tmp_path / LOCK).read_text() == str(os.getpid())
