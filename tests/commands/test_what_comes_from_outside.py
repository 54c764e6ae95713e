"""Files from outside are data: nothing that they say is run, whatever they name."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import CONF
from hydra import compose as hydra_compose
from hydra import initialize_config_dir

from manoeuvre_nn.commands.config import with_effects
from manoeuvre_nn.commands.groups import compose, own_folder
from manoeuvre_nn.commands.guard import one_line
from manoeuvre_nn.commands.job import caveat_of, load_model, prepare
from manoeuvre_nn.commands.shelves import on_shelf
from manoeuvre_nn.commands.train import finished
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.manifest import read_manifest
from manoeuvre_nn.recording.read.mapping_file import read_mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.report.html import Report, write_report
from manoeuvre_nn.ship.mariner import mariner

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
        "ship": {"_target_": "manoeuvre_nn.core.particulars.Particulars"} | PARTICULARS,
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
        with pytest.raises(InputError):
            load_model(run / "checkpoints" / "best.ckpt")
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
        ("ship/mine.yaml", "defaults: {x: 1}\n"),
        ("ship/mine.yaml", "defaults: [3]\n"),
        ("ship/mine.yaml", "defaults: ''\n"),
        ("ship/mine.yaml", "defaults: null\n"),
        ("ship/mine.yaml", "[1, 2]\n"),
        ("hydra/launcher/evil.yaml", "_target_: my_evil.Launcher\n"),
        ("ship/mine.yaml", f"{GLOBAL}out: /elsewhere\n"),
        ("ship/mine.yaml", "# @package out\na: 1\n"),
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
    with pytest.raises(InputError, match="is refused: (a file in config_dir= may|its defaults name|it holds a list)"):
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


@pytest.mark.parametrize(
    "word",
    [
        "hydra.searchpath=[file:///theirs]",
        "+hydra.searchpath=[file:///theirs]",
        "--config-path=/theirs",
        "--config-pa",
        "-cp",
        "--config-name=theirs",
        "-cn",
        "--experimental-rerun=theirs/config.pickle",
        "--exp",
    ],
)
def test_hydras_own_ways_to_unchecked_and_pickled_configs_are_closed(word):
    with pytest.raises(InputError, match="is refused: what hydra finds there may run code: write config_dir=FOLDER"):
        own_folder(["ship=mariner", word])


def test_a_word_for_a_folder_without_a_folder_is_refused():
    with pytest.raises(InputError, match="--config-dir names no folder: write config_dir=FOLDER"):
        own_folder(["ship=mariner", "--config-dir"])


def test_the_beginning_of_a_word_for_a_folder_is_the_word_for_it(tmp_path):
    (tmp_path / "ship").mkdir()
    (tmp_path / "ship" / "mine.yaml").write_text(f"{GLOBAL}plugins: [my_evil]\n")
    with pytest.raises(InputError, match="may not set config_dir, hydra, out, plugins"):
        own_folder(["--config-d", str(tmp_path)])


@pytest.mark.parametrize("name", ["../../../elsewhere", "/elsewhere", "a\\b\x1b[2J"])
def test_a_name_of_a_run_leads_to_no_other_folder(name, tmp_path, monkeypatch):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = hydra_compose("train", return_hydra_config=True)
    cfg.name = name
    folder = (tmp_path / cfg.hydra.run.dir).resolve()
    assert folder.parent.parent == tmp_path / "outputs" and "\x1b" not in str(folder)


def test_a_manoeuvre_of_others_is_called_after_no_file(composed):
    cfg = composed("manoeuvre=straight", "+manoeuvre.straight.name='../../report'")
    with pytest.raises(InputError, match="manoeuvre: name '../../report' is no plain name"):
        prepare(cfg)


@pytest.mark.parametrize("kind", ["mapping", "effects", "config", "manifest"])
def test_files_of_a_later_form_are_refused(kind, tmp_path, composed, done):
    path = tmp_path / "later.yaml"
    path.write_text("format: 2\ntime: {column: t, unit: s}\nchannels: {}\n")
    with pytest.raises(InputError, match="format is 2, this version reads 1"):
        if kind == "mapping":
            read_mapping(path)
        elif kind == "effects":
            with_effects(composed(f"effects={path}"))
        elif kind == "manifest":
            (tmp_path / "manifest.json").write_text('{"format": 2}')
            read_manifest(tmp_path)
        else:
            load_model(beside(done, tmp_path / "run", {"format": 2}))


def beside(done, run, more):
    """A copy of the checkpoint of a run, its config changed."""
    (run / "checkpoints").mkdir(parents=True, exist_ok=True)
    (run / "checkpoints" / "best.ckpt").write_bytes((done / "checkpoints" / "best.ckpt").read_bytes())
    good = yaml.safe_load((done / "config.yaml").read_text())
    (run / "config.yaml").write_text(yaml.safe_dump({**good, **more}))
    return run / "checkpoints" / "best.ckpt"


SPOILT = (None, "x", -1, [], {}, 1e300, float("nan"), True, ["a"], {"a": 1}, "\x1b[31m", 10**30, "${oc.env:HOME}")


@pytest.mark.slow
def test_a_config_beside_a_checkpoint_that_was_changed_field_by_field_is_refused_in_one_line_or_read(tmp_path, done):
    good = yaml.safe_load((done / "config.yaml").read_text())
    places = [(part, key) for part in ("ship", "linear", "network", "fit") for key in good[part]]
    places += [("seed",), ("manoeuvre",), ("manoeuvre", "speed_kn"), ("network",), ("fit", "damping", "mu")]
    refused = 0
    for number, place in enumerate(places):
        for value in SPOILT[number % 6 :: 6]:
            changed = json.loads(json.dumps(good))
            inner = changed
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            try:
                load_model(beside(done, tmp_path / "run", changed))
            except InputError as error:
                assert "\n" not in str(error) and len(str(error)) < 600
                refused += 1
    assert refused > 15


def test_a_network_that_no_memory_could_hold_is_not_begun(tmp_path, done):
    good = yaml.safe_load((done / "config.yaml").read_text())["network"]
    with pytest.raises(InputError, match=r"network.hidden=1e\+09: expected 100000 at most"):
        load_model(beside(done, tmp_path / "run", {"network": {**good, "hidden": 10**9}}))


def test_codes_in_a_heading_reach_neither_the_terminal_nor_a_page_nor_a_mapping(attack, tmp_path, capsys):
    heading = "u\x1b]0;mine\x07\x1b[2J"
    table = pd.read_csv(tmp_path / "run.csv")
    table.rename(columns={"r": heading}).to_csv(tmp_path / "sent.csv", index=False)
    with pytest.raises(SystemExit), one_line():
        read_recording(tmp_path / "sent.csv", read_mapping(mapping_of_run(tmp_path)), mariner().particulars)
    assert r"u\x1b]0;mine\x07\x1b[2J" in capsys.readouterr().err
    page = write_report(
        tmp_path / "report.html", Report(title=heading, summary="", tables={heading: [{heading: heading}]})
    )
    assert not {"\x1b", "\x07"} & set(page.read_text())


def mapping_of_run(folder):
    channels = {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}
    (folder / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t", "unit": "s"}, "channels": channels}))
    return folder / "map.yaml"


@pytest.mark.parametrize(
    "training", [None, [], {"stopped": 1, "epochs": 2}, {"stopped": "all epochs done", "epochs": "x"}]
)
def test_scores_that_were_changed_are_not_taken_for_a_finished_run(training, tmp_path):
    (tmp_path / "scores.json").write_text(json.dumps({"training": training}))
    assert not finished(tmp_path, 10)


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ('{"verdict": {"word": "doubtful"}}', "the model is doubtful by the held-out runs of its own training"),
        ('{"verdict": {"word": "do not use"}}', "the model is not to be used by the held-out runs of its own training"),
        ('{"verdict": {"word": "usable"}}', ""),
        ('{"verdict": {"word": ["doubtful"]}}', ""),
        ('{"verdict": "doubtful"}', ""),
        ("[1]", ""),
        ("no JSON", ""),
        (None, ""),
    ],
)
def test_what_its_own_training_says_against_a_model_is_read_from_its_scores(tmp_path, written, said):
    if written is not None:
        (tmp_path / "scores.json").write_text(written)
    caveat = caveat_of(tmp_path / "checkpoints" / "best.ckpt")
    assert caveat.startswith(said) and bool(caveat) == bool(said)


@pytest.mark.parametrize("group, name, target", [
    ("effect", "kite", "kite.Kite"), ("manoeuvre", "zz7", "manoeuvre_nn.manoeuvre.zigzag.zigzag")
])  # fmt: skip
def test_an_own_file_that_does_not_say_where_it_stands_is_told_its_first_line(tmp_path, group, name, target):
    path = tmp_path / group / f"{name}.yaml"
    path.parent.mkdir()
    path.write_text(f"_target_: {target}\n")
    with pytest.raises(InputError, match=rf"{name}\.yaml: its first line must say .* # @package {group}\.{name}$"):
        own_folder([f"config_dir={tmp_path}"])
    path.write_text(f"# @package {group}.{name}\n_target_: {target}\n")
    assert own_folder([f"config_dir={tmp_path}"])[1] == tmp_path


def test_a_module_of_ones_own_is_told_how_it_is_named_and_one_of_pythons_is_not():
    with pytest.raises(InputError, match=r"kite\.Kite is refused; .* that you trust, add plugins=\[kite\]$"):
        on_shelf("kite.Kite", "effect")
    with pytest.raises(InputError, match="os.system is refused") as told:
        on_shelf("os.system", "effect")
    assert "plugins" not in str(told.value)
