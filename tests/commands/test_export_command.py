"""``manoeuvre export``: a trained run as formulas; wrong input in one line."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import Ended
from hydra.core.global_hydra import GlobalHydra
from rich.console import Console

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.export import checkpoint_of, export
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.job import load_model
from manoeuvre_nn.commands.main import main
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.formulas import check, conversions, onnx_graph, rollouts
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.network.recursive_settings import RecursiveSettings
from manoeuvre_nn.ship.naval_vessel import naval_vessel

SHORT = ["network.surge=[u u,n n]", "network.lateral=[u v,u r,d]", "network.members=1", "trainer.max_epochs=2"]
FILES = {
    *(f"accelerations{ending}" for ending in (".tex", ".py", ".c", ".csv")),
    *(f"mariner{ending}" for ending in (".onnx", ".fmu", ".sdf", ".m")),
    "export.json",
}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Few and short manoeuvres to fit to and to sail."""
    monkeypatch.setattr(conversions, "ZIGZAGS_DEG", (30.0,))
    monkeypatch.setattr(conversions, "CIRCLES_DEG", ())
    monkeypatch.setattr(rollouts, "TRIALS", (zigzag(20.0, duration=20.0),))


@pytest.fixture
def typed(monkeypatch, capsys, tmp_path):
    """``typed("run=OUT", ...)`` runs ``manoeuvre export`` in an empty folder."""
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> Ended:
        GlobalHydra.instance().clear()
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["manoeuvre", "export", *words])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        told = capsys.readouterr()
        return Ended(code, told.out, told.err)

    return run


@pytest.fixture
def run(done, tmp_path) -> Path:
    """A copy of the folder of a complete tiny run."""
    shutil.copytree(done, tmp_path / "run", ignore=shutil.ignore_patterns("figures", "predictions"))
    return tmp_path / "run"


def test_all_formats_of_a_run_are_written_beside_it_and_the_function_is_the_model(typed, run, tmp_path):
    ended = typed(f"run={run}", "format=all")
    assert ended.code == 0, ended.err
    assert {p.name for p in (run / "export").iterdir()} == FILES
    assert {p.name for p in tmp_path.iterdir()} == {"run"}  # no folder of hydra's
    for told in (
        "zz20 (L)",
        "mss: zz20: the track deviates from the model's by ",
        "range of validity: u ",
        "; delta -",
        "written: ",
        "zz35 (60 s)",
    ):
        assert told in " ".join(ended.out.split())
    verdict = json.loads((run / "scores.json").read_text())["verdict"]["sentence"]
    assert f"Verdict of its own training: {verdict}" in " ".join(ended.out.split())
    for name in ("accelerations.py", "accelerations.c", "accelerations.tex", "accelerations.csv", "mariner.m"):
        assert verdict.split(",")[0] in " ".join((run / "export" / name).read_text().split()), name
    module: dict = {}
    exec((run / "export" / "accelerations.py").read_text(), module)
    made, motion = load_model(run / "checkpoints" / "best.ckpt"), (7.1, -0.3, 0.004, 0.35)
    nu = torch.tensor(motion[:3], dtype=torch.float64)
    expected = calm_accelerations(made, nu, torch.tensor(motion[3], dtype=torch.float64)).detach().numpy()
    np.testing.assert_allclose(module["accelerations"](*motion), expected, rtol=1e-12)
    again = typed(f"run={run}", "format=latex")
    assert again.code == 0 and "there already: " in again.out


def test_a_file_of_another_content_is_left_alone_and_another_is_written(typed, run, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text("mine = 1\n")
    ended = typed(f"run={run / 'checkpoints' / 'last.ckpt'}", f"out={mine}")
    assert ended.code == 2 and mine.read_text() == "mine = 1\n"
    (line,) = ended.err.splitlines()
    assert "mine.py exists and holds something else: choose another out=, or remove it" in line
    ended = typed(f"run={run}", "format=latex", f"out={tmp_path / 'part' / 'a.tex'}", "document=false")
    assert ended.code == 0 and "documentclass" not in (tmp_path / "part" / "a.tex").read_text()


def test_the_checkpoint_that_a_training_kept_is_taken(run):
    assert checkpoint_of(run).name == "best.ckpt"
    config = run / "config.yaml"
    config.write_text(config.read_text().replace("keep: best", "keep: last"))
    assert checkpoint_of(run).name == "last.ckpt"
    (run / "checkpoints" / "last.ckpt").unlink()
    assert checkpoint_of(run).name == "best.ckpt"


@pytest.mark.parametrize(
    "words, told",
    [
        ([], "run must be given: write run=OUT"),
        (["run=nowhere"], "run=nowhere: there is no such folder"),
        (["run=."], "run=.: there is no checkpoints/best.ckpt; write the output folder of manoeuvre train"),
        (
            ["run={run}", "format=fortran"],
            "format 'fortran' is unknown; choose one of: latex, python, c, csv, onnx, fmu, gazebo, ",
        ),
        (["run={run}", "format=mss", "effect=[current]"], "format=mss holds coefficients of calm water alone: leave"),
        (["run={run}", "effect=[rudder_slow]"], "effect.rudder_slow acts on the steering gear, which is no part of"),
        (["run={run}", "document=3"], "document=3: expected true or false"),
        (["run={run}/config.yaml"], "config.yaml"),
        (["run={run}", "form=c"], "there is no setting form"),
    ],
)
def test_wrong_input_ends_in_one_line(typed, run, words, told):
    ended = typed(*(word.format(run=run) for word in words))
    assert ended.code == 2
    (line,) = ended.err.splitlines()
    assert line.startswith("error: ") and told in line
    assert not (run / "export").exists()


def test_effects_go_with_the_model_and_what_is_found_out_is_kept(typed, run):
    ended = typed(f"run={run}", "format=onnx", "effect=[current]", "effect.current.speed=0.7")
    assert ended.code == 0, ended.err
    assert "may be changed: current_speed = 0.7 m/s; current_toward_deg = " in " ".join(ended.out.split())
    assert typed(f"run={run}", "format=python").code == 0
    kept = json.loads((run / "export" / "export.json").read_text())
    assert set(kept) == {"mariner.onnx", "accelerations.py"} and kept["mariner.onnx"]["format"] == "onnx"
    assert kept["mariner.onnx"]["difference"] < 1e-9
    assert kept["accelerations.py"]["tracks"]["zz20"]["largest_over_L"] < 1e-9


def test_without_a_compiler_one_line_says_so_and_the_sources_are_written(typed, run, monkeypatch):
    monkeypatch.setattr(check, "COMPILERS", ())
    ended = typed(f"run={run}", "format=fmu")
    assert ended.code == 0, ended.err
    assert "fmu: holds its sources without a binary, and was not run: no compiler of C" in " ".join(ended.out.split())
    assert (run / "export" / "mariner.fmu").is_file()


def test_without_onnx_one_line_says_what_to_install(typed, run, monkeypatch):
    monkeypatch.setattr(onnx_graph, "onnx", None)
    ended = typed(f"run={run}", "format=onnx")
    assert ended.code == 2
    (line,) = ended.err.splitlines()
    assert line == "error: format=onnx needs the packages onnx and onnxruntime: pip install 'manoeuvre-nn[onnx]'"


def test_a_recursive_network_is_written_as_its_next_step(monkeypatch, run):
    made = RecursiveShip(naval_vessel(), RecursiveNetwork(RecursiveSettings(hidden=(3,))))
    monkeypatch.setattr("manoeuvre_nn.commands.export.load_model", lambda path: made)
    (written,) = export(compose("export", [f"run={run}", "format=c"]), run, Console(quiet=True))
    assert "void next_step(" in (run / "export" / "next_step.c").read_text()
    assert max(d.largest for d in written.deviations) < 1e-6
    with pytest.raises(InputError, match="a recursive network takes steps of its own length: write format=c"):
        export(compose("export", [f"run={run}", "format=fmu"]), run, Console(quiet=True))


def test_ranges_are_usual_ones_where_the_recordings_are_gone(run):
    config = run / "config.yaml"
    text = config.read_text()
    config.write_text(text.replace("data:\n", "data:\n  folder: gone\n  files: [a.csv]\n  mapping: null\n", 1))
    made = export(compose("export", [f"run={run}"]), run, Console(quiet=True))[0]
    assert any("is not to be had" in note and "hard manoeuvres" in note for note in made.program.notes)


def test_pythons_way_in_writes_a_model_a_run_and_a_ship(run, tmp_path):
    text = mnn.export(run, "csv")
    assert text.startswith("Accelerations of the Mariner") and json.dumps("zz35")[1:-1] in text
    assert mnn.export(run / "checkpoints" / "best.ckpt", tmp_path / "a.tex") == (tmp_path / "a.tex").read_text()
    assert "double out[3]" in mnn.export("esso_190k", "c")
    windy = mnn.export("mariner", "python", effects={"wind_steady": {"speed": 9}})
    assert "wind_steady_speed: speed of a steady wind [m/s]" in windy
    with pytest.raises(InputError, match=r"'\.txt' is unknown; choose one of: \.tex, \.py, \.c, \.csv, \.onnx, \.fmu"):
        mnn.export("mariner", tmp_path / "a.txt")
    calm = mnn.simulate("mariner", {"zz20": {"duration": 120.0}})
    fitted = mnn.fit("mariner", calm, "modulus", SHORT)
    found = mnn.export(fitted)
    assert f"delta: rudder angle, positive turns the ship to starboard [rad], {calm[0]['delta'].min():.6g} to" in found


@pytest.mark.parametrize("said, words", [("cc1: write error: no room", "format=all"), ("", "format=fmu")])
def test_a_compiler_that_fails_ends_all_in_one_line(typed, run, tmp_path, monkeypatch, said, words):
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\necho warning >&2\necho '{said}' >&2\nexit 4\n")
    compiler.chmod(0o755)
    monkeypatch.setattr(check, "COMPILERS", (str(compiler),))
    ended = typed(f"run={run}", words)
    told = f"error: the compiler {compiler} ended with code 4 ({said or 'warning'}): make room in "
    assert ended.code == 2 and told in ended.err.replace("\n", " ")
