"""Files from outside are data: nothing that they say is run, whatever they name."""

import json
from contextlib import nullcontext

import numpy as np
import pandas as pd
import pytest
import yaml

from manoeuvre_nn.commands.config import with_effects
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.job import load_model, prepare
from manoeuvre_nn.core.errors import InputError

UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}


@pytest.fixture
def attack(tmp_path):
    """A piece of config that overwrites a file through functions of the package, and that file."""
    victim, t = tmp_path / "victim.txt", np.arange(60.0)
    victim.write_text("mine")
    pd.DataFrame({"t": t, **dict.fromkeys(UNITS, np.sin(t))}).to_csv(tmp_path / "run.csv", index=False)
    columns = {
        "_target_": "manoeuvre_nn.recording.mapping.mapping",
        "time": {"column": "t", "unit": "s"},
        "channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()},
    }
    run = {
        "_target_": "manoeuvre_nn.recording.read.reader.read_recording",
        "path": str(tmp_path / "run.csv"),
        "mapping": columns,
        "ship": {"_target_": "manoeuvre_nn.core.ship.Particulars"} | PARTICULARS,
    }
    return {"_target_": "manoeuvre_nn.core.recording.Recording.to_csv", "self": run, "path": str(victim)}, victim


PARTICULARS = {"name": "a", "length": 7.0, "beam": 1.0, "draught": 0.3, "block": 0.8, "speed": 0.7, "rudder_rate": 0.1}
PARTICULARS |= {"rudder_limit": 0.6}


def unharmed(victim) -> bool:
    return victim.read_text() == "mine"


def test_an_effects_file_runs_nothing(attack, tmp_path, composed):
    hostile, victim = attack
    path = tmp_path / "effects.yaml"
    for entry in (
        {"_target_": "manoeuvre_nn.effect.current.Current", "speed": hostile},
        {"speed": hostile},
        {"speed": [hostile]},
        {"speed": 1.0, "toward_deg": hostile},
        hostile,
    ):
        path.write_text(yaml.safe_dump({"current": entry}))
        with pytest.raises(InputError):
            prepare(with_effects(composed(f"effects={path}")))
        assert unharmed(victim)


@pytest.mark.parametrize("part", ["ship", "linear", "network", "fit", "manoeuvre"])
def test_the_config_beside_a_checkpoint_runs_nothing(part, attack, tmp_path, done):
    hostile, victim = attack
    run = tmp_path / "run"
    (run / "checkpoints").mkdir(parents=True)
    (run / "checkpoints" / "best.ckpt").write_bytes((done / "checkpoints" / "best.ckpt").read_bytes())
    good = yaml.safe_load((done / "config.yaml").read_text())
    for spoilt in (hostile, {**good[part], "deep": [hostile]}, {**good[part], "speed_kn": hostile}):
        (run / "config.yaml").write_text(yaml.safe_dump({**good, part: spoilt}))
        with (
            pytest.raises(InputError)
            if part != "manoeuvre" or "speed_kn" in spoilt and "deep" not in spoilt
            else nullcontext()
        ):
            load_model(run / "checkpoints" / "best.ckpt")  # of manoeuvres it reads the speed alone
        assert unharmed(victim)


def test_a_setting_reads_nothing_from_the_environment_of_who_loads_it(tmp_path, done, monkeypatch):
    monkeypatch.setenv("SECRET", "3")
    run = tmp_path / "run"
    (run / "checkpoints").mkdir(parents=True)
    (run / "checkpoints" / "best.ckpt").write_bytes((done / "checkpoints" / "best.ckpt").read_bytes())
    good = yaml.safe_load((done / "config.yaml").read_text())
    good["network"]["hidden"] = "${oc.decode:${oc.env:SECRET}}"
    (run / "config.yaml").write_text(yaml.safe_dump(good))
    with pytest.raises(InputError, match="expected a plain value"):
        load_model(run / "checkpoints" / "best.ckpt")


@pytest.mark.parametrize("group", ["ship", "linear", "network", "fit", "manoeuvre", "data"])
def test_a_group_names_only_what_stands_on_its_shelf(group, attack, composed):
    hostile, victim = attack
    cfg = composed("manoeuvre=zz35")
    place = cfg.manoeuvre.zz35 if group == "manoeuvre" else cfg[group]
    for target in (
        hostile["_target_"],
        "manoeuvre_nn.report.sweep.write_sweep",
        "studies.concealed_trial.stages.answer",
        "manoeuvre_nn.ship.mariner.copy.deepcopy",
        "manoeuvre_nn.ship.mariner.TaylorShip",
        "manoeuvre_nn.ship.known._particulars",
        "manoeuvre_nn.manoeuvre.imo.imo_table",
        "manoeuvre_nn.network.series.parity",
        "manoeuvre_nn.training.data.HeldOut",
    ):
        place["_target_"] = target
        with pytest.raises(InputError, match=r"is refused; a config may only name things in manoeuvre_nn\."):
            prepare(cfg)
        assert unharmed(victim)


CALLBACK = "callbacks: {a: {_target_: my_evil.Callback}}"
GLOBAL = "# @package _global_\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ship/mine.yaml", f"{GLOBAL}hydra: {{{CALLBACK}}}\n"),
        ("ship/mine.yaml", f"#@package   hydra\n{CALLBACK}\n"),
        ("ship/mine.yaml", "# @package hydra.launcher\n_target_: my_evil.Launcher\n"),
        ("ship/mine.yaml", "defaults: [more@hydra.callbacks: evil]\n"),
        ("ship/mine.yaml", "defaults: [override /hydra/launcher: evil]\n"),
        ("ship/mine.yaml", f'{GLOBAL}&a x: 1\n"\\x68ydra": {{{CALLBACK}}}\n'),
        ("ship/mine.yaml", f"{GLOBAL}plugins: [my_evil]\n"),
        ("ship/mine.yaml", f"{GLOBAL}config_dir: /elsewhere\n"),
        ("ship/plugins.yaml", "# @package _name_\nmy_evil: 1\n"),
        ("ship/hydra.yaml", f"# @package _name_\n{CALLBACK}\n"),
        ("ship/mine.yaml", f"{GLOBAL}defaults: [/outputs/evil]\n"),
        ("ship/mine.yaml", f"{GLOBAL}defaults: [{{/ship@_here_: ../outputs/evil}}]\n"),
        ("ship/mine.yaml", f"{GLOBAL}defaults: [/evil]\n"),
        ("hydra/launcher/evil.yaml", "_target_: my_evil.Launcher\n"),
        ("linked/mine.yaml", f"{GLOBAL}hydra: {{{CALLBACK}}}\n"),
    ],
)
def test_a_folder_from_outside_sets_up_neither_hydra_nor_code(name, text, tmp_path, monkeypatch):
    folder, inside = tmp_path / "theirs", tmp_path / "theirs"
    folder.mkdir()
    if name.startswith("linked"):
        inside = tmp_path / "elsewhere"
        (inside / "ship").mkdir(parents=True)
        (folder / "ship").symlink_to(inside / "ship", target_is_directory=True)
        name = "ship/mine.yaml"
    (inside / name).parent.mkdir(parents=True, exist_ok=True)
    (inside / name).write_text(text)
    (folder / "my_evil.py").write_text("raise SystemExit('it was run')\n")
    monkeypatch.setattr("sys.argv", ["manoeuvre"])
    with pytest.raises(InputError, match="is refused: (a file in config_dir= may not set|its defaults name)"):
        compose("train", [f"config_dir={folder}", "ship=mine"])


def test_a_word_that_only_looks_like_hydras_and_the_folder_of_a_run_are_no_matter(tmp_path):
    (tmp_path / "ship").mkdir()
    text = "_target_: manoeuvre_nn.ship.own.own_particulars\nhydraulic_gear: 1\n"
    (tmp_path / "ship" / "mine.yaml").write_text(text)
    (tmp_path / "outputs").mkdir()
    (tmp_path / "outputs" / "config.yaml").write_text("plugins: []\nhydra: {}\n")  # a run's, no option of a group
    assert compose("train", [f"config_dir={tmp_path}", "ship=mine"]).ship.hydraulic_gear == 1


def test_a_manifest_runs_nothing(attack, tmp_path):
    from manoeuvre_nn.diagnosis.case import read_case

    hostile, victim = attack
    (tmp_path / "manifest.json").write_text(json.dumps({"case": "a", "ship": hostile, "runs": [hostile]}))
    with pytest.raises(InputError):
        read_case(tmp_path, "starboard", None)
    assert unharmed(victim)
