"""``python diagnose.py``: cases answered, a person's own runs diagnosed, and every wrong input in one line."""

import json
import re
import runpy
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from fleet import unchecked
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig
from rich.console import Console
from sailed import manifest, sailed, to_starboard, write_runs
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiers import mainly

import manoeuvre_nn as mnn
from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.config import with_effects
from manoeuvre_nn.commands.diagnose import case_folders, diagnose_all
from manoeuvre_nn.commands.diagnosis_setup import setup, wanted, write_effects
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.job import load_model, prepare
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.manoeuvre.zigzag import zigzag

ROOT = Path(__file__).parents[2]
CONF = ROOT / "conf"
CURRENT = 0.6, 60.0
ONLY = "candidates=[current,heading_bias]"


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


@cache
def config(*words: str) -> DictConfig:
    return compose("diagnose", words)


def diagnose(capsys, out: Path, *words: str, terminal: bool = False) -> Ended:
    """The command without hydra's own work."""
    guard.failed_jobs.clear()
    capsys.readouterr()
    code = 0
    try:
        with guard.one_line():
            diagnose_all(config(f"out={out}", *words), out, Console(width=200, force_terminal=terminal))
    except SystemExit as end:
        code = int(end.code or 0)
    told = capsys.readouterr()
    code = code or bool(guard.failed_jobs)
    guard.failed_jobs.clear()
    return Ended(code, told.out, told.err)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    tables = (to_starboard(table[::4]) for table in sailed(*CURRENT))
    runs = dict(zip(["zz1", "tc1", "zz2"], tables, strict=False))
    return write_runs(tmp_path_factory.mktemp("recordings"), runs)


@pytest.fixture(scope="module")
def found(tmp_path_factory, recordings) -> Path:
    """The folder of a whole command."""
    out = tmp_path_factory.mktemp("found") / "out"
    before = sys.argv
    sys.argv = ["diagnose.py", "ship=mariner_corrected", f"recordings={recordings}", f"out={out}", ONLY]
    GlobalHydra.instance().clear()
    try:
        with unchecked():
            runpy.run_path(str(ROOT / "diagnose.py"), run_name="__main__")
    finally:
        sys.argv = before
        GlobalHydra.instance().clear()
    return out


@pytest.fixture
def no_figures(monkeypatch):
    """Leaves figures out, which take most of the time."""
    monkeypatch.setattr("manoeuvre_nn.commands.diagnose.draw_diagnosis", lambda d: {})


def test_a_persons_runs_tell_what_acted_on_them(found):
    answer = json.loads((found / "answer.json").read_text())
    assert (answer["verdict"], answer["model"]) == ("mismatch", ["current"])
    values = answer["effects"][0]["parameters"]
    for (value, error, _), truth in zip((values["speed"], values["toward_deg"]), CURRENT, strict=True):
        assert abs(value - truth) < 4 * error < 0.1 * truth
    assert answer["heldout_rmse_after"]["pos"] < 5 < answer["heldout_rmse_before"]["pos"]


def test_everything_to_look_at_is_written(found):
    for when in ("before", "after"):
        table = pd.read_csv(found / "predictions" / when / "zz2.csv")
        assert list(table.columns) == ["t", "x", "y", "psi", "u", "v", "r", "u_log"] and table["t"].iloc[-1] == 240.0
    page = (found / "report.html").read_text()
    assert "current" in page and "0.60" in page
    assert {"probabilities.png", "tracks.png", "channels_zz2.png"} <= {p.name for p in (found / "figures").iterdir()}
    tags = EventAccumulator(str(found / "tensorboard")).Reload().Tags()
    assert "probability/current" in tags["scalars"] and tags["images"]
    config = yaml.safe_load((found / "config.yaml").read_text())
    assert config["candidates"] == ["current", "heading_bias"] and config["versions"]["torch"]
    assert not (found / ".hydra").exists()


def test_what_was_found_is_loaded_by_train(found, composed):
    cfg = with_effects(composed(f"effects={found / 'effects.yaml'}", "effect=heading_bias"))
    data = prepare(cfg).data
    assert isinstance(data.ship, Vessel) and data.ship.effects
    acting = {e.name: e.values.tolist() for e in data.effects}
    assert acting["heading_bias"] == [1.0]
    assert acting["current"] == pytest.approx(CURRENT, rel=0.05)


@pytest.mark.parametrize("word", ["workers=1.5", "workers=1000000", "remainder=7", "report=perhaps"])
def test_settings_of_all_cases_are_checked_before_the_first(word):
    with pytest.raises(InputError, match=f"{word}: expected"):
        setup(config("cases=nowhere", word))


def test_effects_that_cannot_be_loaded_are_refused(attempt, tmp_path, found):
    path = tmp_path / "effects.yaml"
    for content, told in {
        "[1, 2]": "expected the values of effects",
        "current: 3": "expected the values of effects",
        "current: {_target_: os.system}": "os.system is refused",
        "current: {_target_: manoeuvre_nn.effect.current.Current}": "is refused; write values alone",
        "currant: {speed: 1}": "effect 'currant' is unknown; choose one of: bank",
        "current: {speed: fast}": "speed=fast: expected a number",
        "current: {speed: [{_target_: os.system}]}": "os.system is refused",
        "current: {speed: 99}": "effect.current.speed=99: expected 0 to",
    }.items():
        path.write_text(content)
        ended = attempt(tmp_path / "run", f"effects={path}")
        assert ended.code == 2 and told in ended.err and ended.err.count("\n") == 1
    both = attempt(tmp_path / "run", f"effects={found / 'effects.yaml'}", "effect=current")
    assert "current is both in effect= and in" in both.err
    assert "does not exist" in attempt(tmp_path / "run", f"effects={tmp_path}/nowhere.yaml").err


def test_nothing_found_is_an_empty_file_of_effects(tmp_path, composed):
    write_effects({}, "nothing:\n- not even this", tmp_path / "effects.yaml")
    assert "effect" not in with_effects(composed(f"effects={tmp_path / 'effects.yaml'}")) or not composed().get(
        "effect"
    )


def test_the_same_command_has_nothing_to_do_and_another_is_refused(found, recordings, capsys):
    words = ["ship=mariner_corrected", f"recordings={recordings}"]
    before = (found / "answer.json").stat().st_mtime_ns
    ended = diagnose(capsys, found, *words, ONLY)
    assert ended.code == 0 and "holds this diagnosis already: nothing to do" in ended.out
    assert (found / "answer.json").stat().st_mtime_ns == before
    other = diagnose(capsys, found, *words, "candidates=[current]")
    assert other.code == 2 and "choose another out= or remove the folder" in other.err


@pytest.fixture(scope="module")
def cases(tmp_path_factory) -> Path:
    """A good case, one with a damaged file, and a folder that is none."""
    place = tmp_path_factory.mktemp("cases") / "cases"
    runs = dict(zip(["zz1", "tc1"], (table[::3] for table in sailed(*CURRENT)), strict=False))
    for name in ("c1", "c2"):
        write_runs(place / name, runs)
        said = manifest("zz1", "tc1", held_out="zz1", case=name)
        listed = [run | {"rows": len(runs[run["run"]])} for run in said["runs"]]
        (place / name / "manifest.json").write_text(json.dumps(said | {"runs": listed}))
    (place / "c2" / "tc1.csv").write_text("t,psi\n1,2\n")
    (place / "notes").mkdir()
    return place


def test_cases_are_answered_one_by_one_and_a_broken_one_stops_none(cases, tmp_path, capsys, no_figures):
    out = tmp_path / "out"
    ended = diagnose(capsys, out, f"cases={cases}", ONLY, "report=true")
    assert ended.code == 1 and (out / "c1" / "report.html").is_file()
    lines = [line for line in ended.out.splitlines() if " s so far" not in line]  # of a slow machine
    speed, error = map(float, re.findall(r"^c1: mismatch, current \(speed ([0-9.]+) ± ([0-9.]+) m/s", lines[0])[0])
    assert abs(speed - 0.6) < 2 * error < 0.02 and " J " in lines[0] and lines[0].endswith(" s")
    assert lines[1] == "c2: failed: tc1.csv: no column 'delta'; it has: t, psi"
    assert lines[2].startswith("2 cases: 1 answered, 1 failed")
    assert json.loads((out / "c1" / "answer.json").read_text())["case"] == "c1"
    assert [p.name for p in (out / "c1" / "predictions" / "after").iterdir()] == ["zz1.csv"]
    assert not (out / "c2" / "answer.json").exists() and "InputError" in (out / "c2" / "error.txt").read_text()

    kept = (out / "c1" / "answer.json").stat().st_mtime_ns
    again = diagnose(capsys, out, f"cases={cases}", ONLY)
    assert again.code == 1 and "2 cases: 1 done before, 0 answered, 1 failed" in again.out
    assert (out / "c1" / "answer.json").stat().st_mtime_ns == kept
    alone = diagnose(capsys, out, f"cases={cases / 'c1'}", ONLY)
    assert alone.code == 0 and "1 cases: 1 done before" in alone.out
    other = diagnose(capsys, out, f"cases={cases}", "candidates=[current]")
    assert other.code == 2 and "choose another out" in other.err


def test_a_fault_of_the_program_in_one_case_is_told_and_kept(cases, tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a fault\nin two lines")

    monkeypatch.setattr("manoeuvre_nn.commands.diagnose.diagnose", fail)
    ended = diagnose(capsys, tmp_path / "out", f"cases={cases / 'c1'}", ONLY)
    assert ended.code == 1 and "c1: failed: ZeroDivisionError: a fault\n" in ended.out
    assert "Traceback" in (tmp_path / "out" / "c1" / "error.txt").read_text()


def test_ctrl_c_ends_in_a_line_and_the_same_command_goes_on(cases, tmp_path, capsys, monkeypatch):
    def press(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("manoeuvre_nn.commands.diagnose.diagnose", press)
    ended = diagnose(capsys, tmp_path / "out", f"cases={cases}", ONLY)
    assert ended.code == 130 and ended.out == "c1: stopped; the same command goes on from here\n"


def test_a_case_is_found_from_inside(cases, monkeypatch):
    monkeypatch.chdir(cases / "c1")
    assert [folder.name for folder in case_folders(Path("."))] == ["c1"]


GOOD = "ship=mariner_corrected recordings={recordings}"


WRONG = [
    ("", "write either cases=DIR or recordings=DIR"),
    ("cases=. recordings=.", "write either cases=DIR or recordings=DIR"),
    ("cases=nowhere", "cases=nowhere is not a folder"),
    ("cases={empty}", "neither it nor a folder in it has a manifest.json"),
    ("cases={cases} ship=mariner", "the ship of a case is in its manifest.json"),
    ("ship=mariner recordings=nowhere", "recordings=nowhere is not a folder"),
    ("ship=mariner recordings={empty}", "holds no csv file"),
    (
        "recordings={recordings}",
        "ship= is not given, and the folder of recordings= names none: write for instance ship=esso_190k",
    ),
    ("ship=kvlcc2 recordings={recordings}", "no coefficients: write model=OUT/checkpoints/best.ckpt"),
    (f"{GOOD} candidates=[wind]", "candidates: 'wind' is unknown; choose one of: bank, bow_thruster, current"),
    (f"{GOOD} candidates=[first_order_waves]", "candidates: 'first_order_waves' is unknown"),
    (f"{GOOD} candidates=[]", "candidates=[] names no effect"),
    (f"{GOOD} files=[zz7.csv]", "files: zz7.csv is not in"),
    (f"{GOOD} files=[zz*.csv] held_out=tc1", "run in held_out 'tc1' is unknown; choose one of: zz1, zz2"),
    (f"{GOOD} held_out=zz9", "run in held_out 'zz9' is unknown; choose one of: tc1, zz1, zz2"),
    (f"{GOOD} held_out=[zz1,tc1,zz2]", "held out are all runs"),
    (f"{GOOD} rudder_positive_to=port", "change rudder_positive_to"),
    (f"{GOOD} rudder_positive_to=left", "rudder_positive_to='left': write starboard or port"),
    (f"{GOOD} warmup_s=long", "warmup_s=long: expected seconds, more than 0, to 1e+06, or null"),
    (f"{GOOD} speed_kn=0", "speed_kn=0: expected an approach speed in knots, .05 to 200"),
    (f"{GOOD} rpm=fast", "rpm=fast: expected revolutions a minute, more than 0, to 100000, or null"),
    (f"{GOOD} mapping=nowhere.yaml", "nowhere.yaml does not exist"),
    (f"{GOOD} mapping=kvlcc2_hsva", "no column 't_s'"),
    (f"{GOOD} model=nowhere.ckpt", "model=nowhere.ckpt is no file"),
    (f"{GOOD} model={{recordings}}/zz1.csv", "zz1.csv"),
    ("ship.depth=5 ship=esso_190k recordings={recordings}", "ship.depth=5 m; the Esso 190 000 dwt tanker draws"),
    (f"{GOOD} ship._target_=os.system", "os.system is refused"),
]
"""Neighbours are alike: every second one is enough by default."""


@pytest.mark.parametrize("words, told", mainly(14, WRONG[::2] + WRONG[1::2]))
def test_wrong_commands_end_in_one_line(tmp_path, recordings, cases, capsys, words, told):
    (tmp_path / "empty").mkdir()
    given = words.format(recordings=recordings, cases=cases, empty=tmp_path / "empty").split()
    ended = diagnose(capsys, tmp_path / "out", *given)
    assert ended.code == 2 and told in ended.err and ended.err.startswith("error: ") and ended.err.count("\n") == 1
    assert not (tmp_path / "out" / "answer.json").exists()


def test_a_setting_that_does_not_exist_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.setattr(sys, "argv", ["diagnose.py", "canditates=all"])
    GlobalHydra.instance().clear()
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / "diagnose.py"), run_name="__main__")
    assert end.value.code == 2
    line = "error: there is no setting canditates: the nearest is candidates; python diagnose.py --cfg job lists them "
    assert capsys.readouterr().err == f"{line}all\n"


SHELF = {p.stem: yaml.safe_load(p.read_text()) for p in (CONF / "effect").glob("*.yaml")}


def test_in_a_tank_there_is_no_wind_no_wave_and_no_current():
    tank = set(wanted("tank", SHELF))
    assert tank < set(wanted("default", SHELF))
    assert not {"wind_steady", "wind_gusty", "wave_drift", "current", "side_force", "tow", "ice_resistance"} & tank
    assert {"rudder_offset", "heading_bias", "gps_lever_arm"} <= tank


def test_a_mapping_that_says_tank_is_enough():
    def names(*words):
        return set(setup(config("ship=kvlcc2_hsva", "recordings=FOLDER", *words)).wanted)

    assert names("mapping=kvlcc2_hsva") == set(wanted("tank", SHELF))
    assert names("mapping=esso_osaka") == names() == set(wanted("default", SHELF))
    assert names("mapping=kvlcc2_hsva", "candidates=[wind_steady]") == {"wind_steady"}


def test_candidates_are_what_conf_holds():
    default, every = wanted("default", SHELF), wanted("all", SHELF)
    assert len(default) == 28 and {"wind_gusty", "tidal_current", "gps_lever_arm"} <= set(default) < set(every)
    assert set(SHELF) - set(every) == {"first_order_waves", "gps_delay", "formula", "remainder"}
    assert wanted("current", SHELF) == wanted(["current"], SHELF) == ["current"]


@pytest.mark.parametrize("ship", ["mariner", "mariner_corrected", "great_lakes_bulker", "esso_190k"])
def test_every_candidate_can_be_made_for_every_ship(ship, recordings, tmp_path):
    common = setup(config(f"ship={ship}", f"recordings={recordings}", "candidates=all", "speed_kn=14.8"))
    effects, said = common.candidates(common.runs())
    assert [e.name for e in effects] == list(common.wanted) and said == []


def test_candidates_that_no_channel_shows_are_left_out_and_said(tmp_path):
    table = to_starboard(sailed(*CURRENT)[0]).drop(columns=["u_log", "r"])
    write_runs(tmp_path, {"zz1": table})
    words = ["ship=mariner_corrected", f"recordings={tmp_path}"]
    common = setup(config(*words, "candidates=[current,rate_bias,log_scale,rudder_delay]"))
    effects, said = common.candidates(common.runs())
    assert [e.name for e in effects] == ["current", "rudder_delay"]
    assert said == ["Not judged, for no channel shows it: rate_bias, log_scale."]


@pytest.fixture(scope="module")
def network(done) -> Path:
    return done / "checkpoints" / "best.ckpt"


def test_a_network_is_loaded_as_it_was_trained(done, network):
    model = load_model(network)
    run = simulate(model, zigzag(20.0, duration=60.0), rtol=1e-6, atol=1e-7)
    told = pd.read_csv(done / "predictions" / "zz20.csv")
    for name, column in (("x", "x [m]"), ("psi", "psi [rad]"), ("v", "v [m/s]")):
        np.testing.assert_allclose(run[name], told[column], atol=1e-5)


def test_from_python_what_a_checkpoints_training_says_against_it_is_told_as_well(network, monkeypatch):
    monkeypatch.setattr("manoeuvre_nn.commands.job.caveat_of", lambda path: f"{path.name} is doubtful")
    monkeypatch.setattr("manoeuvre_nn.api.find_causes", lambda question: question)
    monkeypatch.setattr("manoeuvre_nn.api.Answer", lambda question: question)
    models = network, load_model(network)
    runs = [simulate(models[1], zigzag(angle, duration=90.0)) for angle in (10.0, 20.0)]
    by_path, as_made = (mnn.diagnose("mariner", runs, model=m) for m in models)
    assert (by_path.caveat, as_made.caveat) == ("best.ckpt is doubtful", "")
    assert by_path.settings["model"] == str(network) and by_path.dynamics.network.members == models[1].network.members


def test_a_network_stands_in_for_the_ship(network, recordings, monkeypatch):
    monkeypatch.setattr("manoeuvre_nn.commands.job.caveat_of", lambda path: f"{path.name} is doubtful")
    common = setup(config(f"recordings={recordings}", f"model={network}", "speed_kn=12", ONLY))
    question = common.question(common.runs())
    assert question.dynamics.network is common.model.network and question.caveat == "best.ckpt is doubtful"
    assert question.dynamics.particulars.speed == pytest.approx(12 * KNOT)
    nu, rudder = torch.tensor([7.0, 0.3, 0.01]).double(), torch.tensor(0.2).double()
    with torch.no_grad():
        ours, own = (
            calm_accelerations(m, nu, rudder) for m in (question.dynamics, common.model.on_approach(12 * KNOT))
        )
    np.testing.assert_allclose(ours, own)


def test_a_network_of_another_ship_or_without_its_run_is_refused(network, recordings, tmp_path, capsys):
    words = [f"recordings={recordings}", ONLY]
    other = diagnose(capsys, tmp_path / "out", *words, "ship=esso_190k", f"model={network}")
    assert other.code == 2 and "is of the Mariner, ship= is the Esso 190 000 dwt tanker: leave ship= out" in other.err
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "best.ckpt").write_bytes(network.read_bytes())
    alone = diagnose(capsys, tmp_path / "out", *words, f"model={tmp_path}/alone/best.ckpt")
    assert alone.code == 2 and "which says what network it is" in alone.err
    (tmp_path / "config.yaml").write_text("a: 1\n")
    foreign = diagnose(capsys, tmp_path / "out", *words, f"model={tmp_path}/alone/best.ckpt")
    assert foreign.code == 2 and "is no config of manoeuvre train" in foreign.err
