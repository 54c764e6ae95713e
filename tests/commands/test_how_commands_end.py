"""Full disks, ctrl-C, SIGTERM and two runs in one folder, as a person meets them: one line, nothing lost."""

import inspect
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from io import StringIO

import matplotlib as mpl
import pytest
from conftest import ROOT, SHORT, TINY
from full_disk import room_for
from rich.console import Console
from tiers import mainly

from manoeuvre_nn.commands import check, main, simulate, train
from manoeuvre_nn.core.waiting import _Work, waiting
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.training import data
from manoeuvre_nn.training.rollout_score import RolloutScore

ONE_EPOCH = (*SHORT, "trainer.max_epochs=1")


def test_import_on_a_full_disk_leaves_the_mapping_that_was_there(tmp_path, capsys):
    recording, mapping = tmp_path / "run.csv", tmp_path / "mine.yaml"
    rows = "".join(f"{k},{0.1 * k},{k % 7},5,0.1\n" for k in range(90))
    recording.write_text(f"t,psi,delta,u,v\n{rows}")
    mapping.write_text("# the good one\n")
    with room_for(100), pytest.raises(SystemExit) as end:
        main.run("import", [str(recording), f"out={mapping}", "overwrite=true"])
    told = capsys.readouterr()
    assert end.value.code == 2 and "written" not in told.out
    assert (
        told.err.startswith(f"error: cannot write {mapping}: File too large: make room") and told.err.count("\n") == 1
    )
    assert mapping.read_text() == "# the good one\n"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.yaml", "run.csv"]


@pytest.mark.parametrize("size", mainly(2, [100, 3000, 30_000]))  # .hydra, checkpoints, figures
def test_training_on_a_full_disk_ends_in_one_line_and_leaves_no_halves(cli, tmp_path, size):
    out = tmp_path / "run"
    with room_for(size):
        ended = cli(*ONE_EPOCH, f"out={out}")
    assert ended.code == 2 and ended.err.count("\n") == 1
    assert ended.err.startswith("error: cannot write") and "File too large: make room" in ended.err
    assert not (out / "scores.json").exists() and not list(out.rglob("*.part")) and not (out / ".lock").exists()


def test_a_sweep_on_a_full_disk_leaves_no_lock(cli, tmp_path):
    with room_for(50):
        ended = cli("-m", "hydra/launcher=basic", *TINY, f"out={tmp_path / 'sweep'}")
    assert ended.code == 2 and ended.err.startswith("error: cannot write") and ended.err.count("\n") == 1
    assert not list(tmp_path.rglob(".lock"))


@pytest.mark.slow  # seconds to start a process; in this one, whatever is at work, below
def test_sigterm_while_it_prepares_ends_in_one_line(tmp_path):
    words = [sys.executable, str(ROOT / "train.py"), *TINY, "data.length=20000", f"out={tmp_path / 'run'}"]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(words, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    until = time.monotonic() + 60
    while not (tmp_path / "run" / "config.yaml").exists() and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 143 and err == "stopped by SIGTERM\n"
    assert not (tmp_path / "run" / ".lock").exists()


INT, TERM = (signal.SIGINT, 130), (signal.SIGTERM, 143)


@pytest.mark.parametrize(
    ("step", "number", "code"),
    mainly(
        3, [("prepare", *TERM), ("score", *INT), ("write", *TERM), ("prepare", *INT), ("score", *TERM), ("write", *INT)]
    ),
)
def test_whatever_is_at_work_is_stopped_in_one_line(cli, tmp_path, monkeypatch, step, number, code):
    stopped = train.OF_SHIPS._replace(**{step: lambda *_: os.kill(os.getpid(), number)})
    monkeypatch.setattr(train, "OF_SHIPS", stopped)
    ended = cli(*ONE_EPOCH, f"out={tmp_path / 'run'}")
    assert ended.code == code and ended.err.startswith("stopped by ") and ended.err.count("\n") == 1


def test_training_is_stopped_by_a_second_ctrl_c_with_its_own_code(cli, tmp_path, monkeypatch):
    # Lightning makes an exit with code 1 of it.
    def press(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(RolloutScore, "on_train_epoch_end", press)
    before = signal.getsignal(signal.SIGINT)
    try:
        ended = cli(*ONE_EPOCH, f"out={tmp_path / 'run'}")
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.code == 130 and ended.err == "stopped by ctrl-C\n"


@pytest.mark.parametrize("lines", [1, 20_000])  # what fits into the stream's buffer, and what does not
def test_a_reader_that_has_left_ends_the_command_quietly(lines):
    script = f"from manoeuvre_nn.core.ending import one_line\nwith one_line():\n    for k in range({lines}): print(k)"
    reads, writes = os.pipe()
    os.close(reads)
    ended = subprocess.run([sys.executable, "-c", script], stdout=writes, stderr=subprocess.PIPE, timeout=60)
    os.close(writes)
    assert (ended.returncode, ended.stderr) == (141, b"")


HOLD = "import time; from pathlib import Path; from manoeuvre_nn.core.writing import locked\n"


@pytest.fixture
def occupied(tmp_path):
    """A folder in which another process is at work."""
    work = f"{HOLD}with locked(Path({str(tmp_path / 'run')!r})): print('in', flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE, text=True)
    process.stdout.readline()
    yield tmp_path / "run"
    process.kill()
    process.communicate()


@pytest.mark.parametrize("words", [["out={}"], ["-m", "hydra/launcher=basic", "out={}"]])
def test_a_second_run_in_a_folder_is_refused_before_it_writes_anything(cli, occupied, words):
    ended = cli(*(word.format(occupied) for word in words), *TINY)
    assert ended.code == 2 and ended.err.count("\n") == 1
    assert ended.err.startswith(f"error: {occupied}: another run (process ")
    assert [p.name for p in occupied.iterdir()] == [".lock"]


def test_a_finished_run_leaves_no_lock_and_says_what_was_asked_for(done):
    assert not (done / ".lock").exists() and json.loads((done / "scores.json").read_text())
    assert "data.length=60" in (done / ".hydra" / "overrides.yaml").read_text()


def test_a_folder_is_locked_while_a_command_is_at_work_in_it(cli, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "manoeuvre_nn.commands.train.train", lambda cfg, out: seen.append((out / ".lock").read_text()) or ("", 0.0)
    )
    assert cli(*TINY, f"out={tmp_path / 'run'}").code == 0
    assert seen == [str(os.getpid())] and not (tmp_path / "run" / ".lock").exists()
    with locked(tmp_path / "run"):
        pass


@pytest.mark.parametrize("kind", ["gpu", "cuda"])
def test_a_gpu_that_is_not_there_is_refused_before_anything_is_computed(attempt, tmp_path, monkeypatch, kind):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("torch.backends.mps.is_available", lambda: False)
    ended = attempt(tmp_path / "run", *TINY, f"trainer.accelerator={kind}")
    assert ended.code == 2 and not (tmp_path / "run").exists()
    assert ended.err == f"error: trainer.accelerator={kind}: torch finds none here: write trainer.accelerator=cpu\n"


def test_what_takes_minutes_says_what_it_does_and_for_how_long():
    text = StringIO()
    with waiting(Console(file=text, width=100), seconds=0.01) as say:
        say("simulating zz35 over 100000 s")
        time.sleep(0.1)
    lines = text.getvalue().splitlines()
    assert lines and set(lines) == {"simulating zz35 over 100000 s: 0 s so far"}
    shown = StringIO()
    with waiting(Console(file=shown, width=100, force_terminal=True)) as say:
        say("simulating zz35 over 100000 s")
        time.sleep(0.2)
    assert "simulating zz35 over 100000 s" in shown.getvalue() and "0:00:00" in shown.getvalue()


def test_the_time_that_is_left_is_that_of_the_pace_since_the_first_share(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("manoeuvre_nn.core.waiting.monotonic", lambda: now[0])
    work = _Work("training")
    work.say("training", 0.5)  # resumed: the first half took no time of this run
    assert work.line == "training: 0 s so far"
    now[0] += 10
    work.say("training", 0.6)
    assert work.line == "training: 10 s so far, about 40 s left"
    now[0] += 15
    assert work.line == "training: 25 s so far, about 25 s left"
    work.say("training", 0.6)  # as a sweep says while a job goes on
    assert work.line == "training: 25 s so far, about 25 s left"
    now[0] += 1000
    assert work.left == "longer than expected"
    work.say("drawing")
    assert work.left == ""


def test_silence_counts_over_phases_and_not_from_the_beginning_of_each(monkeypatch):
    silent = [0.0]
    monkeypatch.setattr("manoeuvre_nn.core.waiting.silent_s", lambda: silent[0])
    text = StringIO()
    with waiting(Console(file=text), "reading a.csv", seconds=0.02):
        time.sleep(0.1)
        assert text.getvalue() == ""
        silent[0] = 5.0
        time.sleep(0.1)
    assert text.getvalue().startswith("reading a.csv: 0 s so far\n")
    assert inspect.signature(waiting).parameters["seconds"].default <= 5


LONG = {
    "simulate": (simulate, "solve", "sailing zz20 over 100000 s (1 of 1)", ["manoeuvre.zz20.duration=100000"]),
    "check": (check, "inspect_file", "checking run.csv (1 of 1)", ["data.files=run.csv", "data.mapping=esso_osaka"]),
}


@pytest.mark.parametrize("name", LONG)
def test_what_takes_long_is_named_before_it_begins(name, tmp_path, monkeypatch, capsys):
    module, step, told, words = LONG[name]
    said = []

    @contextmanager
    def heard(console):
        yield lambda what, *share: said.append(what)

    monkeypatch.setattr(module, "waiting", heard)
    monkeypatch.setattr(module, step, lambda *_, **__: os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.csv").write_text("t [s],u [m/s]\n")
    monkeypatch.setattr(sys, "argv", ["manoeuvre"])
    with pytest.raises(SystemExit) as end:
        main.run(name, [*words, "out=out"])
    assert end.value.code == 130 and said == [told], capsys.readouterr().err


def test_a_long_simulation_is_named_before_it_begins(cli, tmp_path, monkeypatch):
    said = []

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(data, "simulate", stop)
    before = data.SimulatedData.setup

    def setup(self, stage=None):
        shown, self.say = self.say, lambda what, *share: said.append(what)
        assert shown is not data.ManoeuvreData.say
        before(self, stage)

    monkeypatch.setattr(data.SimulatedData, "setup", setup)
    ended = cli(*TINY, "data.length=100000", f"out={tmp_path / 'run'}")
    assert ended.code == 130 and said == ["simulating zz35 over 100000 s (1 of 2)"]


OF_LIBRARIES = r"home/\.(cache|config)(/matplotlib)?|temporary/torchinductor_\w+"
"""Folders of matplotlib's, and an empty one that torch makes when Lightning imports its compiler."""


@pytest.mark.slow  # a process with a home of its own
def test_a_command_writes_into_its_folder_alone(tmp_path):
    home, temporary, here = (tmp_path / name for name in ("home", "temporary", "here"))
    for folder in (home, temporary, here):
        folder.mkdir()
    kept = {name: value for name, value in os.environ.items() if name in {"PATH", "PYTHONPATH"}}
    set_here = {"HOME": str(home), "TMPDIR": str(temporary), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    set_here["MPLCONFIGDIR"] = mpl.get_cachedir()  # a list of all fonts, which takes longer than all the rest, is there
    words = [sys.executable, str(ROOT / "train.py"), *ONE_EPOCH, "out=run"]
    ended = subprocess.run(words, cwd=here, env=kept | set_here, text=True, capture_output=True)
    assert ended.returncode == 0 and ended.stderr == ""
    assert os.listdir(here) == ["run"] and not list(here.rglob(".lock")) and not list(here.rglob("*.part"))
    left = [str(path.relative_to(tmp_path)) for folder in (home, temporary) for path in folder.rglob("*")]
    assert [name for name in left if not re.fullmatch(OF_LIBRARIES, name)] == []
