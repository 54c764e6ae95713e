"""``python scripts/reproduce.py``: chapters done in processes, kept, told and written; wrong input in one line."""

import json
import os
import runpy
import signal
import sys
import time
import types
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from rich.console import Console
from tiers import mainly

import studies
from manoeuvre_nn.commands import guard
from manoeuvre_nn.core.errors import InputError
from studies.reproduction.job import job_of, reproduce, wanted
from studies.reproduction.processes import Event, Task, do_chapters
from studies.reproduction.section import ChapterResult, Claim, ComputingEffort, Line, Panel, Plot
from studies.reproduction.watch import Watch

ROOT = Path(__file__).parents[3]
CONF = ROOT / "studies" / "reproduction"


def good(effort, say):
    say("sailing a zigzag")
    x = np.linspace(0.0, 1.0, 5)
    drawn = float(torch.rand(()))
    made = [
        Claim("Table 1", "Y_v", 0.5, 0.51, "holds"),
        Claim("Table 1", "drawn", 5.0, drawn, "does not hold", "drawn"),
        Claim("Figure 2", "effort", "-", f"{effort.quick} {effort.starts} {effort.seed}", "not comparable"),
    ]
    plot = Plot("figure_2", "Figure 2: a line", [Panel("x", "y", [Line("a", x, x)])])
    return ChapterResult(
        "Chapter 1: good", f"{torch.get_num_threads()} thread", made, {"t": [{"m": np.int64(3)}]}, [plot]
    )


def other(effort, say):
    say("training")
    return good(effort, say)


def bad(effort, say):
    print("it prints")
    raise ZeroDivisionError("a fault\nin two lines")


def misled(effort, say):
    raise InputError("effort is too small")


def killed(effort, say):
    os.kill(os.getpid(), signal.SIGKILL)


def endless(effort, say):
    while True:
        say("at work")
        time.sleep(0.02)


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


CHAPTERS = {chapter.__name__: chapter for chapter in (good, other, bad, misled, killed, endless)}


@pytest.fixture
def fake(monkeypatch, tmp_path_factory):
    """A study of the chapters above, beside those of the repository."""
    place = tmp_path_factory.mktemp("studies")
    folder = place / "fake1996"
    folder.mkdir()
    for name, chapter in CHAPTERS.items():
        (folder / f"{name}.py").write_text("")
        module = types.ModuleType(f"studies.fake1996.{name}")
        module.chapter = chapter
        monkeypatch.setitem(sys.modules, module.__name__, module)
    study = {"title": "A fake", "source": "nobody", "chapters": {name: name for name in CHAPTERS}}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    monkeypatch.setattr(studies, "__path__", [*studies.__path__, str(place)])
    return folder


@pytest.fixture
def command(capsys, tmp_path):
    """``command("1=good", "2=bad", "seed=1")`` does a paper of these chapters, without hydra's own work."""

    def run(*words, terminal=False):
        guard.failed_jobs.clear()
        capsys.readouterr()
        chapters = dict(word.split("=") for word in words if word[0].isdigit())
        settings = [f"out={tmp_path / 'out'}", *(word for word in words if not word[0].isdigit())]
        code = 0
        try:
            with guard.one_line():
                asked = [word for word in settings if word.startswith("chapters=")]
                job = job_of(config("paper=wang1996", *(word for word in settings if word not in asked), "chapters=3"))
                named = wanted([word.split("=")[1] for word in asked] or ["all"], list(chapters))
                job = replace(job, chapters={k: CHAPTERS[chapters[k]] for k in named})
                reproduce(job, Console(width=100, force_terminal=terminal))
        except SystemExit as end:
            code = int(end.code or 0)
        told = capsys.readouterr()
        code = code or bool(guard.failed_jobs)
        guard.failed_jobs.clear()
        return Ended(code, told.out, told.err)

    return run


def config(*words):
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("reproduce", list(words))


def result(out):
    return json.loads((out / "reproduction.json").read_text())


def test_everything_is_told_and_written(command, tmp_path):
    ended = command("1=good", "2=other", "seed=3", "starts=2", "quick=true")
    out = tmp_path / "out"
    found = result(out)
    assert ended.code == 0 and ended.err == ""
    assert ended.out.count("Chapter 1: good ──") == 2 and "Figures: figure_2" in ended.out
    assert "2 hold, 2 do not hold, 2 not comparable" in ended.out
    assert found["verdicts"] == {"holds": 2, "holds in direction": 0, "does not hold": 2, "not comparable": 2}
    assert found["effort"] == {"quick": True, "starts": 2, "seed": 3} and found["versions"]["torch"]
    assert found["chapters"]["1"]["claims"][2]["ours"] == "True 2 3"
    assert found["chapters"]["1"]["summary"] == "1 thread" and set(found["seconds"]["chapters"]) == {"1", "2"}
    files = [chapter["figures"][0]["file"] for chapter in found["chapters"].values()]
    assert len(set(files)) == 2 and all((out / file).read_bytes()[:4] == b"\x89PNG" for file in files)
    assert (out / "reproduction.html").read_text().count("data:image/svg+xml") == 2
    kept = yaml.safe_load((out / "config.yaml").read_text())
    assert (kept["paper"], kept["seed"]) == ("wang1996", 3) and kept["versions"]["numpy"]
    assert not list(out.rglob("*.part")) and not list(out.rglob("*.log"))


@pytest.mark.slow
def test_the_same_command_gives_the_same_numbers_whatever_the_order(command, tmp_path):
    found = []
    for out, words in (("a", ["workers=1"]), ("b", ["workers=2"])):
        torch.rand(3)  # what was drawn before must not matter
        command("1=good", "2=other", *words, f"out={tmp_path / out}")
        found.append(result(tmp_path / out))
        assert found[-1].pop("seconds")["command"] > 0
    assert found[0] == found[1]
    command("1=good", "2=other", "seed=1", f"out={tmp_path / 'c'}")
    drawn = [r["chapters"]["1"]["claims"][1]["ours"] for r in (found[0], result(tmp_path / "c"))]
    assert drawn[0] != drawn[1]


def test_a_chapter_that_fails_is_a_line_and_the_others_come(command, tmp_path):
    ended = command("1=bad", "2=good", "3=misled", "4=killed", "workers=1")
    assert ended.code == 1
    lines = ended.out.splitlines()
    assert "Chapter 1 failed: ZeroDivisionError: a fault" in lines and "Chapter 3 failed: effort is too small" in lines
    assert "Chapter 4 failed: its process was ended by signal 9 (SIGKILL)" in lines
    assert "1 holds, 1 does not hold, 1 not comparable" in ended.out
    found = result(tmp_path / "out")
    assert found["failed"] == ["1", "3", "4"] and len(found["chapters"]["2"]["claims"]) == 3
    assert found["chapters"]["1"] == {"failure": "ZeroDivisionError: a fault"}
    log = (tmp_path / "out" / "chapters" / "1.log").read_text()
    assert log.startswith("it prints\n") and "Traceback" in log and "it prints" not in ended.out


def test_finished_chapters_are_kept_and_only_the_others_are_done(command, tmp_path):
    command("1=good", "2=bad")
    kept = tmp_path / "out" / "chapters" / "1.json"
    before = kept.stat().st_mtime_ns, result(tmp_path / "out")["chapters"]["1"]
    ended = command("1=good", "2=other")
    assert ended.code == 0 and "done before: chapter 1\n" in ended.out and "chapter 2: begins" in ended.out
    found = result(tmp_path / "out")
    assert (kept.stat().st_mtime_ns, found["chapters"]["1"]) == before and found["failed"] == []
    assert not (tmp_path / "out" / "chapters" / "2.log").exists()
    again = command("1=good", "2=other")
    assert "done before: chapter 1, 2\n" in again.out and "begins" not in again.out
    assert again.out.count("Chapter 1: good ──") == 2


def test_chapters_are_chosen_and_may_be_added_later(command, tmp_path):
    command("1=good", "2=other", "chapters=2")
    assert list(result(tmp_path / "out")["chapters"]) == ["2"]
    ended = command("1=good", "2=other")
    assert ended.code == 0 and list(result(tmp_path / "out")["chapters"]) == ["1", "2"]


@pytest.mark.parametrize("content", mainly(2, ["{", '{"paper": "wang1996"}', "", "[1]", "null", "\x00"]))
def test_a_damaged_chapter_is_refused_in_one_line(command, tmp_path, content):
    command("1=good")
    (tmp_path / "out" / "chapters" / "1.json").write_text(content)
    ended = command("1=good")
    assert ended.code == 2 and ended.err.count("\n") == 1
    assert ended.err.endswith("1.json is damaged: remove it, and the same command does chapter 1 again\n")


def test_a_chapter_of_another_command_is_refused_in_one_line(command, tmp_path):
    command("1=good", "seed=1", f"out={tmp_path / 'other'}")
    command("1=good")
    (tmp_path / "other" / "chapters" / "1.json").replace(tmp_path / "out" / "chapters" / "1.json")
    ended = command("1=good")
    assert ended.code == 2 and "1.json is of another command: remove it or choose another out" in ended.err
    other_seed = command("1=good", "seed=2")
    assert other_seed.code == 2 and "holds a run with seed=0, this one has seed=2: choose another out" in other_seed.err


def test_ctrl_c_ends_in_a_line_and_the_processes_with_it(command, tmp_path, monkeypatch):
    seen = Watch.see

    def press(self, event):
        seen(self, event)
        if event.text == "at work":
            raise KeyboardInterrupt

    monkeypatch.setattr(Watch, "see", press)
    ended = command("1=good", "2=endless")
    assert ended.code == 130
    assert ended.out.replace("\n", "").endswith(
        f"stopped; the same command with out={tmp_path / 'out'} goes on from here"
    )
    monkeypatch.undo()


def task(run, tmp_path, name="1"):
    return Task(name, run, lambda section, seconds: None, tmp_path / f"{name}.log")


def test_processes_end_when_nobody_listens(tmp_path):
    def tells_its_number(effort, say):
        say(str(os.getpid()))
        endless(effort, say)

    events = do_chapters([task(tells_its_number, tmp_path)], ComputingEffort(), 1)
    number = next(int(event.text) for event in events if event.kind == "said")
    os.kill(number, 0)
    events.close()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_a_chapter_whose_log_cannot_be_written_fails_in_a_line(tmp_path, capfd):
    (tmp_path / "chapters").write_text("a file where the folder should be")
    chapter = Task("1", endless, lambda section, seconds: None, tmp_path / "chapters" / "1.log")
    *_, end = do_chapters([chapter], ComputingEffort(), 1)
    assert end.kind == "failed" and end.text.startswith("cannot write ")
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_as_many_chapters_are_at_work_as_there_are_workers(tmp_path):
    def run(effort, say):
        say("a")
        time.sleep(0.05)
        return ChapterResult("", "", [])

    for workers in (1, 2, 9):
        at_work = most = 0
        kinds = []
        for event in do_chapters([task(run, tmp_path, str(k)) for k in range(4)], ComputingEffort(), workers):
            at_work += {"began": 1, "finished": -1}.get(event.kind, 0)
            most = max(most, at_work)
            kinds.append(event.kind)
        assert most == min(workers, 4) and kinds.count("said") == kinds.count("finished") == 4


def test_time_without_events_is_told_too(tmp_path):
    def slow(effort, say):
        time.sleep(0.2)
        return ChapterResult("", "", [])

    kinds = [event.kind for event in do_chapters([task(slow, tmp_path)], ComputingEffort(), 1, tick=0.02)]
    assert kinds[0] == "began" and kinds[-1] == "finished" and "tick" in kinds


def test_progress_is_a_line_now_and_then(capsys):
    for every, expected in ((-1.0, ["begins", "a", "b"]), (1e6, ["begins"])):
        with Watch(Console(width=80), 2, seconds=every) as watch:
            for event in (Event("began", "5"), Event("said", "5", "a"), Event("tick"), Event("said", "5", "b")):
                watch.see(event)
            watch.see(Event("finished", "5"))
        assert capsys.readouterr().out.splitlines() == [f"0:00  chapter 5: {what}" for what in expected]


def test_a_terminal_shows_all_that_is_at_work(capsys):
    with Watch(Console(width=60, force_terminal=True), 3) as watch:
        for event in (Event("began", "5"), Event("began", "6"), Event("said", "5", "training " * 20)):
            watch.see(event)
        lines = [str(line) for line in watch._lines().renderables]
        assert [line.split("  ")[-1][:12] for line in lines] == ["chapter 5: t", "chapter 6: b", "0 of 3 chapt"]
        capsys.readouterr()
        watch.see(Event("finished", "5"))
    told = capsys.readouterr().out
    assert "chapter 6: begins" in told and "1 of 3 chapters done" in told and "chapter 5" not in told


def test_a_number_stands_for_its_parts_and_the_papers_order_is_kept():
    known = ["3", "5.2", "5.3", "6", "A"]
    assert wanted(["all"], known) == known
    assert wanted([6, 5], known) == ["5.2", "5.3", "6"] and wanted([5.3, "A"], known) == ["5.3", "A"]
    with pytest.raises(InputError, match="chapter '5.4' is unknown; choose one of: 3, 5.2, 5.3, 6, A"):
        wanted([3, 5.4], known)


@pytest.mark.parametrize(
    "words, told",
    [
        ("", "which paper? write paper=cepowski2007 or paper=hess2000 or paper=rajesh2009 or paper=wang1996"),
        ("paper=nope", "paper 'nope' is unknown; choose one of: cepowski2007, hess2000, rajesh2009, wang1996"),
        ("paper=wang1996 chapters=9", "chapter '9' is unknown; choose one of: 3, 4, 5.2"),
        ("paper=wang1996 chapters=[]", "chapters=[] names none; write chapters=all"),
        ("paper=wang1996 starts=0", "starts=0: expected a whole number, 1 or more"),
        ("paper=wang1996 starts=many", "starts=many: expected a whole number"),
        ("paper=wang1996 quick=maybe", "quick=maybe: expected true or false"),
        ("paper=wang1996 seed=-1", "seed=-1: expected a whole number, 0 or more"),
        ("paper=wang1996 workers=0", "workers=0: expected a whole number, 1 to 256"),
        ("paper=../wang1996", "paper '../wang1996' is unknown"),
        ("paper=wang1996 nosuch=3", "there is no setting nosuch"),
    ],
)
def test_wrong_commands_end_in_one_line_before_anything_is_written(monkeypatch, capsys, tmp_path, words, told):
    ended = script(monkeypatch, capsys, tmp_path, *words.split())
    assert ended.code == 2 and told in ended.err and ended.err.startswith("error: ") and ended.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def script(monkeypatch, capsys, place, *words):
    monkeypatch.chdir(place)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.setattr(sys, "argv", ["reproduce.py", *words])
    GlobalHydra.instance().clear()
    guard.failed_jobs.clear()
    code = 0
    try:
        runpy.run_path(str(ROOT / "scripts" / "reproduce.py"), run_name="__main__")
    except SystemExit as end:
        code = int(end.code or 0)
    guard.failed_jobs.clear()
    told = capsys.readouterr()
    return Ended(code, told.out, told.err)


@pytest.mark.usefixtures("fake")
def test_the_command_writes_where_it_says(monkeypatch, capsys, tmp_path):
    ended = script(monkeypatch, capsys, tmp_path, "paper=fake1996", "chapters=good")
    (out,) = (tmp_path / "outputs").glob("*/*_reproduce_fake1996")
    here = out.relative_to(tmp_path)
    assert ended.code == 0 and f"report: {here}/reproduction.html   numbers: {here}/reproduction.json" in ended.out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["outputs"]
    assert sorted(p.name for p in out.iterdir()) == [
        "chapters", "config.yaml", "figures", "reproduction.html", "reproduction.json",
    ]  # fmt: skip
    failed = script(monkeypatch, capsys, tmp_path, "paper=fake1996", "chapters=bad", "out=bad")
    assert failed.code == 1


def test_a_folder_that_cannot_be_written_is_one_line(command, tmp_path):
    (tmp_path / "file").write_text("")
    ended = command("1=good", f"out={tmp_path / 'file'}")
    assert ended.code == 2 and ended.err.count("\n") == 1 and "cannot write" in ended.err
