"""``python scripts/coefficients.py``, and what train.py leaves of a series; wrong input in one line."""

import json
import runpy
import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from fleet import unchecked
from pages import unexplained
from pytest import approx
from rich.console import Console

from manoeuvre_nn.commands.coefficients import _read, tell
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.train import train
from manoeuvre_nn.core.ending import WRONG_INPUT
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.estimation.coefficients import fitted_from

ROOT = Path(__file__).parents[2]
NOISY = ("data.length=120", "data.noise.u=.03", "data.noise.v=.03", "data.noise.r_deg_s=.02", "data.noise.x=1",
         "data.noise.y=1", "data.noise.psi_deg=.2", "trainer.progress=false")  # fmt: skip


def config(name, *words):
    return compose(name, [*NOISY, *words, "name=test"])


def told(out, *words):
    console = Console(record=True, width=100, file=open("/dev/null", "w"))  # noqa: SIM115
    with unchecked():
        tell(config("coefficients", *words), out, console)
    return json.loads((out / "coefficients.json").read_text()), console.export_text()


@pytest.fixture
def no_figures(monkeypatch):
    """Leaves figures out, which take most of the time."""
    monkeypatch.setattr("manoeuvre_nn.commands.coefficients.figures", lambda told: {})


@pytest.fixture(scope="module")
def tests_file(tmp_path_factory):
    """A table of captive tests and its mapping, in the units that the file of HMRI has."""
    folder = tmp_path_factory.mktemp("captive")
    rows = ["b,d,U,n,X,Y,N"]
    for b, d in [(x, 0) for x in (-16, -8, -4, 0, 4, 8, 16)] + [(0, x) for x in (-20, -10, 10, 20)]:
        v, delta = -np.sin(np.radians(b)), np.radians(d)
        y, n = -0.25 * v - v * abs(v) - 0.06 * delta, -0.1 * v + 0.03 * delta
        rows.append(f"{b},{d},1.2,9,{-0.0005 - 0.001 * delta**2},{y / 18.7},{n / 18.7}")
    (folder / "tests.csv").write_text("\n".join(rows))
    columns = {"beta": "b, unit: deg", "delta": "d, unit: deg", "speed": "U, unit: m/s", "n": "n, unit: 1/s"}
    columns |= {k: k for k in "XYN"}
    lines = [f"  {k}: {{column: {v}}}" for k, v in columns.items()]
    first = "_target_: manoeuvre_nn.recording.captive.captive_mapping"
    (folder / "map.yaml").write_text("\n".join([first, "columns:", *lines]))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of train.py with a small series."""
    out = tmp_path_factory.mktemp("train") / "run"
    words = ("network=modulus", "network.surge=[u u,n n,d d]", "network.lateral=[u v,u r,v |v|,d n n]")
    words += ("fit=closed_loop", "trainer.max_epochs=8", "score=[{zz20: {duration: 60}}]", "network.members=2")
    with unchecked(), patch("manoeuvre_nn.commands.results.figures", lambda outcome: {}):  # those of coefficients alone
        train(config("train", *words), out, Console(quiet=True))
    return out


def test_a_run_of_train_py_leaves_its_coefficients(run):
    stored = json.loads((run / "coefficients.json").read_text())
    names = [row["symbol"] for row in stored["coefficients"]]
    assert {"X_uu", "Y_uv", "N_ur", "N_dnn", "Y_v|v|"} <= set(names)
    page = (run / "report.html").read_text()
    assert unexplained(page) == set()
    assert "What follows from them" in page and "Free runs show forces over inertia only" in page
    assert (run / "figures" / "coefficients_intervals.png").is_file()
    one = stored["coefficients"][0]
    assert one["interval_95"][0] < one["value"] < one["interval_95"][1] and stored["birge_ratio"] > 0
    assert fitted_from(stored["fitted"]).symbols == tuple(names)


@pytest.mark.slow
def test_coefficients_of_a_run_are_told_again_without_a_fit_and_beside_captive_tests(run, tests_file, tmp_path):
    stored, said = told(
        tmp_path, f"run={run}", f"captive.file={tests_file / 'tests.csv'}", f"captive.mapping={tests_file / 'map.yaml'}"
    )
    before = json.loads((run / "coefficients.json").read_text())
    assert stored["coefficients"] == before["coefficients"] and stored["derived"] == before["derived"]
    rows = {r["name"]: r for r in stored["captive"]["rows"]}
    assert rows["Y' by drift"]["captive"] == approx(-0.25, rel=0.05) and "Y_ur" not in rows
    assert "Recordings beside captive tests" in said and "known is" in said
    assert (tmp_path / "figures" / "coefficients_forces.png").is_file()
    page = (tmp_path / "coefficients.html").read_text()
    assert "captive tests" in page and unexplained(page) == set()


@pytest.mark.parametrize(
    "words, name", [(["run=outputs/monday/osaka_turns"], "osaka_turns"), (["ship=esso_190k"], "esso_190k_zz35")]
)
def test_the_folder_is_called_after_the_run_or_else_after_what_is_sailed(words, name):
    assert compose("coefficients", words).name == name


def test_another_inertia_scales_the_forces_and_not_the_motion(run, tmp_path, no_figures):
    before = json.loads((run / "coefficients.json").read_text())
    m = np.array(before["fitted"]["inertia"]) * 2
    words = f"{{mx: {m[0, 0]}, my: {m[1, 1]}, mz: {m[2, 2]}, Yrdot: {-m[1, 2]}, Nvdot: {-m[2, 1]}}}"
    stored, _ = told(tmp_path, f"run={run}", f"inertia={words}")
    once, twice = ([r["value"] for r in one["coefficients"]] for one in (before, stored))
    assert twice == approx([2 * value for value in once])
    assert stored["derived"][0]["value"] == approx(4 * before["derived"][0]["value"])
    assert stored["derived"][1] == before["derived"][1]


@pytest.mark.slow
def test_the_tankers_own_table_is_told_from_a_recording(tmp_path, no_figures):
    words = ("ship=esso_190k", "network=modulus", "manoeuvre=zz20", "terms=own", "trainer.max_epochs=3")
    stored, said = told(tmp_path, *words, "data.length=400")
    rows = {r["symbol"]: r for r in stored["coefficients"]}
    low, high = rows["N_ccd"]["interval_95"]
    assert rows["N_ccd"]["prior"] == -0.098 and low < -0.098 < high and rows["N_ccd"]["word"] == "measured"
    assert "BIS system" in said


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["terms=mine"], "terms"),
        (["terms=own", "ship=kvlcc2_hsva"], "no sum of known products"),
        (["run=nowhere"], "holds no coefficients.json"),
        (["inertia={mx: 1}"], "inertia="),
        (["inertia={mx: heavy, my: 1, mz: 1}"], "inertia: mx=.heavy.: expected a number"),
        (["inertia={mx: 1, my: .1, mz: .1, Yrdot: .2, Nvdot: .2}"], "no ship's"),
        (["relative=much", "terms=own", "ship=esso_190k"], "relative=much: expected more than 0"),
        (["network=hull_rudder", "fit=ensemble"], "fit=closed_loop"),
        (["captive.file=none.csv", "captive.mapping=kvlcc2_hmri"], "does not exist"),
        (["captive.file=none.csv"], "captive.mapping is not given"),
        (["captive.file=none.csv", "captive.mapping=kvlcc2_hsva"], "no mapping of captive tests"),
        (["captive.file=none.csv", "captive.mapping=kvlcc2_hmri", "terms=own"], "terms=network"),
        (["relative=-1", "terms=own"], "expected more than 0"),
    ],
)
def test_wrong_input_ends_in_one_line(words, wanted, tmp_path):
    with pytest.raises(InputError, match=wanted) as caught:
        told(tmp_path, *words)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_result_is_refused(tmp_path):
    (tmp_path / "coefficients.json").write_text("{}")
    with pytest.raises(InputError, match="was not written by"):
        told(tmp_path / "out", f"run={tmp_path}")


SPOILT = (None, "x", [], {}, True, [None], -1, float("inf"))


def test_results_that_were_changed_field_by_field_are_refused_in_one_line_or_read(run, tmp_path):
    good, path = json.loads((run / "coefficients.json").read_text()), tmp_path / "coefficients.json"
    places = [(key,) for key in good] + [("particulars", key) for key in good["particulars"]]
    places += [("derived", 0, key) for key in good["derived"][0]] + [("fitted", key) for key in good["fitted"]]
    refused = 0
    for place in places:
        for value in SPOILT:
            changed = json.loads(json.dumps(good))
            inner = changed
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            path.write_text(json.dumps(changed))
            try:
                _read(tmp_path)
            except InputError as error:
                assert "\n" not in str(error) and len(str(error)) < 400
                refused += 1
    assert refused > 0.6 * len(SPOILT) * (len(places) - 3)  # of coefficients, groups and versions nothing is read


def test_a_turn_that_is_never_steady_is_no_number_in_the_file_and_comes_back_as_none(run, tmp_path, no_figures):
    stored = json.loads((run / "coefficients.json").read_text())
    turn = next(d for d in stored["derived"] if d["name"].startswith("r L/U0"))
    turn |= {"value": float("nan"), "interval_95": [None, None]}
    (tmp_path / "coefficients.json").write_text(json.dumps(stored))
    again, said = told(tmp_path / "out", f"run={tmp_path}")
    assert next(d for d in again["derived"] if d["name"] == turn["name"]) == turn | {"value": None}
    assert "NaN" not in (tmp_path / "out" / "coefficients.json").read_text() and "nan" not in said


def test_captive_settings_are_checked(run, tests_file, tmp_path):
    files = (f"captive.file={tests_file / 'tests.csv'}", f"captive.mapping={tests_file / 'map.yaml'}")
    for words in ("captive.speed=-1", "captive.largest_drift_deg=0"):
        with pytest.raises(InputError, match=words.split("=")[0]):
            told(tmp_path, f"run={run}", *files, words)


def test_the_command_line_says_what_is_wrong(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.setattr(sys, "argv", ["coefficients.py", "run=nowhere", "out=out"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "scripts" / "coefficients.py"), run_name="__main__")
    assert ended.value.code == WRONG_INPUT and "holds no coefficients.json" in capsys.readouterr().err
