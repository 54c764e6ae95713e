import csv
import importlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import ROOT, SHORT

from manoeuvre_nn.commands import main
from manoeuvre_nn.commands.sweep_table import SweepTable
from manoeuvre_nn.training.checkpoint import read_checkpoint

SWEEP = [
    "-m",
    "hydra/launcher=basic",
    "hydra.callbacks.sweep_table._target_=manoeuvre_nn.commands.sweep_table.SweepTable",
]
JOBS = [*[word for word in SHORT if not word.startswith("network.hidden")], "trainer.max_epochs=1"]


def numbers(out) -> dict:
    found = json.loads((out / "scores.json").read_text())
    del found["training"]["seconds"]
    return found


def test_a_job_of_a_sweep_looks_for_who_began_it_before_it_loads_what_takes_seconds(cli, tmp_path, monkeypatch):
    done, loads = [], importlib.import_module
    monkeypatch.setattr(main, "end_with_parent", lambda: done.append("looks"))
    monkeypatch.setattr(importlib, "import_module", lambda name, *more: done.append(name) or loads(name, *more))
    assert cli("-m", "hydra/launcher=basic", *JOBS, "network.hidden=0", f"out={tmp_path / 'sweep'}").code == 1
    ours = [name for name in done if name in {"looks", "manoeuvre_nn.commands.train"}]
    assert ours == ["looks", "manoeuvre_nn.commands.train"]


@pytest.mark.slow
def test_a_sweep_survives_a_failing_job_and_can_be_continued(cli, fast, tmp_path, monkeypatch):
    folder, kept, end = tmp_path / "sweep", [], SweepTable.on_job_end

    def ended_job(self, config, job_return, **more):
        end(self, config, job_return, **more)
        kept.append(job_return)

    monkeypatch.setattr(SweepTable, "on_job_end", ended_job)
    command = [*SWEEP, *JOBS, "network.hidden=2,0,3", f"out={folder}"]
    ended = cli(*command)
    assert ended.code == 1
    assert len(kept) == 3 and all(job.cfg is None and job.hydra_cfg is None for job in kept)  # which hydra keeps
    jobs = {p.name.removeprefix("hidden="): p for p in folder.iterdir() if p.is_dir()}
    assert set(jobs) == {"2", "0", "3"}
    assert (jobs["0"] / "error.txt").read_text().startswith("network.hidden=0: three 4-m-1 networks need at least 1")
    assert "failed: network.hidden=0" in ended.out and "Traceback" not in ended.out + ended.err
    assert not (jobs["0"] / "scores.json").exists() and numbers(jobs["2"]) != numbers(jobs["3"])
    table = list(csv.DictReader((folder / "sweep.csv").open()))
    status = {row["network.hidden"]: row["status"] for row in table}
    assert status["2"] == status["3"] == "finished" and status["0"].startswith("failed: network.hidden=0")
    assert (folder / "sweep.md").is_file() and (folder / "sweep.png").is_file()

    times = {name: (jobs[name] / "scores.json").stat().st_mtime_ns for name in ("2", "3")}
    (jobs["2"] / "error.txt").write_text("failed in an earlier attempt")
    more = cli(*[word.replace("2,0,3", "2,3,0") for word in command])
    assert more.code == 1
    assert more.out.count("done before") == 2
    assert {name: (jobs[name] / "scores.json").stat().st_mtime_ns for name in ("2", "3")} == times
    assert not (jobs["2"] / "error.txt").exists()
    good = cli(*[word.replace("2,0,3", "2,3") for word in command[:-1]], f"out={tmp_path}/good")
    assert good.code == 0 and "failed" not in good.out


@pytest.mark.slow  # seconds to start a process; without one in test_train_command.py
@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_a_killed_run_goes_on_elsewhere_to_the_scores_of_an_undisturbed_one(cli, fast, tmp_path):
    long = [*SHORT, "trainer.max_epochs=2000", "scoring.every=1000", "trainer.progress=false"]
    killed, straight = tmp_path / "killed", tmp_path / "straight"
    elsewhere = {"PYTHONHASHSEED": "77", "TZ": "Pacific/Auckland", "OMP_NUM_THREADS": "2"}
    environment = {**os.environ, **elsewhere, "HYDRA_FULL_ERROR": "0"}
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "train.py"), *long, f"out={killed}"],
        env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    checkpoint, until = killed / "checkpoints" / "last.ckpt", time.monotonic() + 60
    while not checkpoint.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(0.2)
    process.send_signal(signal.SIGKILL)
    _, told = process.communicate()
    assert checkpoint.exists() and process.returncode == -signal.SIGKILL, told.decode()
    assert not (killed / "scores.json").exists()

    short = [*SHORT, "scoring.every=1000", "trainer.progress=false"]
    reached = read_checkpoint(checkpoint)["epoch"] + 1
    short += [f"trainer.max_epochs={reached + 6}"]
    again = cli(*short, f"out={killed}")
    assert again.code == 0 and f"after epoch {reached}" in again.out
    assert cli(*short, f"out={straight}").code == 0
    assert numbers(killed) == numbers(straight)
