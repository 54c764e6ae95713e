"""Python's way in: the same functions as the commands, and what they give prints and plots itself."""

import logging
import os
import random
import signal
import subprocess
import sys
import threading
import warnings

import numpy as np
import pytest
import torch
from fleet import unchecked
from hydra.core.global_hydra import GlobalHydra
from matplotlib import pyplot, rcParams
from matplotlib.figure import Figure

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.simulate import as_sensed
from manoeuvre_nn.core.errors import InputError

CURRENT = {"current": {"speed": 0.6, "toward_deg": 90.0}}
NOISE = {"x": 0.5, "y": 0.5, "psi_deg": 0.05, "r_deg_s": 0.005}


def open_files() -> list[str]:
    return [os.readlink(entry.path) for entry in os.scandir("/proc/self/fd") if entry.is_symlink()]


def process_state() -> dict:
    """What a person's program may have set, and would miss."""
    return {
        "environment": {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
        "folder and paths": (os.getcwd(), list(sys.path), list(sys.argv)),
        "signals": [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE)],
        "threads": sorted(thread.name for thread in threading.enumerate()),
        "open files": sorted(file for file in open_files() if not file.endswith(".ttf")),  # matplotlib keeps its fonts
        "warnings": list(warnings.filters),
        "loggers": {name: logging.getLogger(name).level for name in ("", "lightning.pytorch", "lightning.fabric")},
        "random numbers": (random.getstate(), np.random.get_state()[1].tolist()),  # noqa: NPY002  the global one
        "torch": (torch.get_default_dtype(), torch.get_num_threads(), torch.is_grad_enabled()),
        "numpy": (np.geterr(), np.get_printoptions()),
        "figures": (dict(rcParams), pyplot.get_fignums()),
        "hydra": GlobalHydra.instance().is_initialized(),
        "ends": (sys.excepthook, sys.stdout, sys.stderr),
    }


@pytest.fixture(autouse=True)
def nothing_is_left():
    """Whatever a test calls: the process is then as it was."""
    before = process_state()
    yield
    after = process_state()
    assert [name for name in before if after[name] != before[name]] == []


@pytest.fixture(autouse=True)
def as_people_run_it():
    """Without checks of types: a yaml gives 20 where an annotation says float, which Python takes."""
    with unchecked():
        yield


@pytest.fixture(scope="module")
def runs():
    manoeuvres = [{"zz20": {"duration": 150.0}}, {"zz10": {"duration": 150.0}}, {"tc25": {"duration": 150.0}}]
    with unchecked():
        return mnn.simulate("mariner_corrected", manoeuvres, effects=[CURRENT], noise=NOISE)


def test_importing_the_package_loads_nothing_heavy():
    told = "import sys, manoeuvre_nn; print([m for m in ('torch', 'lightning', 'hydra') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", told], capture_output=True, text=True).stdout.strip() == "[]"
    assert {"read", "simulate", "fit", "score", "diagnose"} <= set(dir(mnn))
    with pytest.raises(AttributeError, match="no attribute nothing"):
        _ = mnn.nothing


def test_runs_are_a_sequence_that_prints_and_plots(runs):
    assert [run.name for run in runs] == ["zz20", "zz10", "tc25"] and len(runs[1:]) == 2
    assert "Runs of the Mariner" in repr(runs) and "tc25" in repr(runs)
    assert isinstance(runs.plot(), Figure) and len(runs[:1] + runs[1:]) == 3


def test_a_notebook_shows_a_table_once(runs, monkeypatch):
    shown = []
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setattr("rich.jupyter.display", lambda *parts: shown.append(parts))
    assert "zz10" in repr(runs) and not shown


def test_effects_are_a_name_a_mapping_or_a_list_of_these_and_a_scaled_log_stays_scaled():
    trial = {"tc25": {"duration": 60.0}}
    listed, alone = (mnn.simulate("mariner", trial, effects=given)[0] for given in ([CURRENT], CURRENT))
    np.testing.assert_array_equal(listed["ve"], alone["ve"])
    assert alone["ve"][0] == pytest.approx(0.6)
    scaled = mnn.simulate("mariner", trial, effects={"log_scale": {"factor": 1.1}})[0]
    np.testing.assert_allclose(as_sensed(scaled)["u_log"], 1.1 * scaled["u"])


def test_a_diagnosis_names_what_was_simulated(runs):
    with unchecked():
        answer = mnn.diagnose("mariner_corrected", runs[:2], candidates=["current"], held_out="zz10")
    assert abs(answer.effects["current"]["speed"] - 0.6) < 0.02 and "current" in answer.summary
    assert answer.summary in " ".join(repr(answer).split()) or "a current" in repr(answer)
    assert isinstance(answer.plot(), Figure)


def test_a_ship_in_calm_water_and_a_fitted_model_are_scored():
    with unchecked():
        calm = mnn.simulate("mariner", [{"zz20": {"duration": 110.0}}, {"zz10": {"duration": 110.0}}])
        own = mnn.score("mariner", calm)
        fitted = mnn.fit("mariner", calm[:1], settings=["network.members=1", "trainer.max_epochs=3"])
        scores = mnn.score(fitted, calm[1:])
    assert max(s.dev_L for s in own) < 1e-3 and scores[0].status == "ok" and scores[0].dev_L < 0.5
    assert "zz10" in repr(scores) and "Fitted to" in repr(fitted) and isinstance(scores.plot(), Figure)


def test_a_fit_uses_the_settings_of_data_and_refuses_files_beside_recordings(runs):
    short = ["network.members=1", "trainer.max_epochs=1"]
    with unchecked():
        all_of_it, part = (mnn.fit("mariner_corrected", runs[:1], settings=[*short, *more]).source
                           for more in ([], ["data.length=100"]))  # fmt: skip
    assert "zz20 (150 s)" in all_of_it and "zz20 (100 s)" in part
    with pytest.raises(InputError, match=r"data\.files names files, and recordings are given"):
        mnn.fit("mariner_corrected", runs[:1], settings=[*short, "data.files=[a.csv]"])


OWN_SHIP = """_target_: manoeuvre_nn.ship.own.own_particulars
name: my ferry
length: 160.93
beam: 23.17
draught: 7.468
block: 0.6
speed_kn: 15.0
"""


def test_a_ship_of_ones_own_is_a_yaml_everywhere_and_its_model_is_read_back(runs, tmp_path):
    path = tmp_path / "ferry.yaml"
    path.write_text(OWN_SHIP)
    short = ["network.surge=[u u,n n]", "network.lateral=[u v,u r,d]", "network.members=1", "trainer.max_epochs=2"]
    with unchecked():
        fitted = mnn.fit(str(path), runs[:1], "modulus", short, out=tmp_path / "run")
        assert fitted.model.particulars.name == "my ferry" and "my ferry" in fitted.source
        again = mnn.score(tmp_path / "run" / "checkpoints" / "last.ckpt", runs[:1])
        with pytest.raises(InputError, match="by name or by a yaml"):
            mnn.fit(fitted.model.particulars, runs[:1], out=tmp_path / "other")
        with pytest.raises(InputError, match="my ferry has particulars but no coefficients"):
            mnn.simulate(str(path), "zz20")
    assert again[0].dev_L == pytest.approx(fitted.scores[0].dev_L)


def test_files_that_the_package_wrote_are_read_back(runs, tmp_path):
    from manoeuvre_nn.commands.simulate import write_runs

    write_runs(runs[:1], runs.ship, tmp_path)
    back = mnn.read(tmp_path, ship="mariner_corrected")[0]
    assert np.allclose(back["delta"], runs[0]["delta"], atol=1e-6) and np.allclose(
        back["psi"], runs[0]["psi"], atol=1e-6
    )
    (tmp_path / "zz20.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="zz20.csv"):
        mnn.read(tmp_path)


def test_wrong_names_end_in_one_line():
    with pytest.raises(InputError, match="ship 'titanic' is unknown; choose one of: container"):
        mnn.simulate("titanic", "zz20")
    with pytest.raises(InputError, match="effect 'wind' is unknown; choose one of: bank"):
        mnn.simulate("mariner", "zz20", effects=["wind"])
    with pytest.raises(InputError, match="has particulars but no coefficients"):
        mnn.simulate("kvlcc2", "zz20")
