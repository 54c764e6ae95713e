"""``python scripts/excite.py``: advice for simulated and given models; wrong input in one line."""

import json
import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hydra.core.global_hydra import GlobalHydra
from pages import unexplained
from rich.console import Console

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.config import named_manoeuvres, training_manoeuvres
from manoeuvre_nn.commands.excite import excite, question_of
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.report.design_tables import sentence

ROOT = Path(__file__).parents[2]
TINY = (
    "network.members=3", "network.hidden=3", "fit.epochs=3", "data.length=60", "trainer.progress=false",
    "candidates=[{zz20: {duration: 60}},{tc10: {duration: 60}}]", "score=[{zz10: {duration: 60}}]",
    "effort={truths: 1, others: 2, samples: 50}",
)  # fmt: skip


def config(*words):
    return compose("excite", [*TINY, *words, "name=test"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("excite") / "run"


@pytest.fixture(scope="module")
def asked(folder):
    """A tiny advice and what it said."""
    from fleet import unchecked

    console = Console(record=True, width=100, quiet=False, file=open("/dev/null", "w"))  # noqa: SIM115
    with unchecked():
        advice = excite(config(), folder, console)
    return advice, console.export_text()


def test_the_best_candidate_is_named_in_the_terminal_in_json_and_on_the_page(asked, folder):
    advice, said = asked
    told = json.loads((folder / "excite.json").read_text())
    gains = {row["manoeuvre"]: row["gain"] for row in told["candidates"]}
    assert set(gains) == {"zz20", "tc10"} and told["sail_next"] == max(gains, key=gains.get)
    page = (folder / "report.html").read_text()
    assert unexplained(page) == set()
    for text in (said, page):
        assert f"Sail next: {told['sail_next']}" in text
    assert "because the members disagree most about zz10" in told["sentence"]
    assert told["candidates"][0]["targets"]["zz10"]["now"] == pytest.approx(told["candidates"][0]["now"])
    assert {p.name for p in (folder / "figures").iterdir()} == {"gain.png", "where.png"}
    assert advice.best.manoeuvre == told["sail_next"]
    assert not (folder / "tensorboard").exists(), "nothing is held out that could be shown"


def test_the_settings_and_versions_are_kept(asked, folder):
    kept = yaml.safe_load((folder / "config.yaml").read_text())
    assert kept["goal"] == "accuracy" and kept["network"]["members"] == 3
    assert "torch" in kept["versions"]


def test_the_same_command_has_nothing_to_do_and_another_is_refused(asked, folder):
    console = Console(record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    assert excite(config(), folder, console) is None
    assert "holds this advice already" in console.export_text()
    with pytest.raises(InputError, match="holds a run with seed=0, this one has seed=1"):
        excite(config("seed=1"), folder, Console(quiet=True))


@pytest.mark.slow
def test_a_trained_model_is_asked_about_what_it_was_trained_on(asked, folder, tmp_path):
    model = f"model={folder / 'checkpoints' / 'last.ckpt'}"
    again = excite(config(model, "manoeuvre=zz10"), tmp_path, Console(quiet=True))
    assert again.trained_on == asked[0].trained_on and "zz35" in again.trained_on
    assert [e.now for e in again.expected] == pytest.approx([e.now for e in asked[0].expected])
    assert not (tmp_path / "checkpoints").exists()


def test_what_tells_most_about_coefficients_is_advised(folder, asked, tmp_path):
    model = f"model={folder / 'checkpoints' / 'last.ckpt'}"
    advice = excite(config(model, "goal=coefficients"), tmp_path, Console(quiet=True))
    told = json.loads((tmp_path / "excite.json").read_text())
    assert told["coefficients"] == "the ship's own products"
    assert all(row["gain"] > 0 and row["then"] < row["now"] for row in told["candidates"])
    assert "tells most about the coefficients" in told["sentence"]
    assert set(advice.expected[0].targets) == {"X", "Y", "N"}


def test_of_a_single_network_no_disagreement_is_drawn(tmp_path):
    words = ("network.members=1", "goal=coefficients", "trainer.max_epochs=1")
    assert excite(config(*words), tmp_path, Console(quiet=True)).where is None
    assert {f.name for f in (tmp_path / "figures").glob("*.png")} == {"gain.png"}


def test_what_the_rudder_cannot_do_is_told_and_not_dropped():
    question = question_of(config("candidates=[tc10,{turning_circle: {rudder_deg: 60}}]"))
    assert [m.name for m in question.candidates] == ["tc10"]
    assert "orders 60 deg" in question.left_out[0]


@pytest.mark.parametrize(
    "words, told",
    [
        (["goal=speed"], "goal 'speed' is unknown; choose one of: accuracy, coefficients"),
        (["network=wang", "fit=levenberg_marquardt"], "goal=accuracy asks the members of an ensemble"),
        (["network.members=1"], "the members of an ensemble: network=hull_rudder with network.members=2 or more"),
        (["candidates=[zz99]"], "'zz99' is unknown; choose one of"),
        (["candidates=[]"], "name at least one manoeuvre of each"),
        (["candidates=[{turning_circle: {rudder_deg: 60}}]"], "orders 60 deg"),
        (["effort.others=1"], "effort.others=1: expected 2 or more"),
        (["per_minute=3"], "per_minute=3: expected true or false"),
        (["model=nowhere/checkpoints/best.ckpt"], "nowhere/checkpoints/best.ckpt"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(words, told, tmp_path):
    words = [*(w for w in words if w.startswith(("network=", "fit="))), *(w for w in words if "network=" not in w)]
    given = [w for w in TINY if not (words[0].startswith("network") and w.startswith(("network", "fit")))]
    with pytest.raises(InputError, match=told.replace("(", r"\(")) as refusal:
        excite(bare(*given, *words), tmp_path, Console(quiet=True))
    assert "\n" not in str(refusal.value) and not (tmp_path / "config.yaml").exists()


def bare(*words):
    return compose("excite", ["name=test", *dict.fromkeys(words)])


def test_the_script_lists_its_settings(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["excite.py", "--help"])
    GlobalHydra.instance().clear()
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / "scripts" / "excite.py"), run_name="__main__")
    assert not end.value.code and "which manoeuvre to sail next" in capsys.readouterr().out
    assert guard.failed_jobs == []


def test_a_candidate_of_ones_own_is_told_as_it_is_typed(asked):
    question = question_of(config("candidates=[zz20,{spiral: {rudder_deg: 15}},{zigzag: {heading_deg: 8}}]"))
    typed = {"spiral15": "manoeuvre=[{spiral: {rudder_deg: 15}}]", "zz20_8": "manoeuvre=[{zigzag: {heading_deg: 8}}]"}
    assert question.typed == typed
    for name, word in typed.items():
        (made,) = training_manoeuvres(compose("simulate", [word]).manoeuvre)
        assert made.name == name
    best = asked[0].best.manoeuvre
    place = r"at \d+ deg of rudder( to (starboard|port))?, v' = \S+ \(sway.*?\), r' = \S+ \(yaw rate.*?\)"
    assert re.search(place, sentence(asked[0]))
    assert f"Sail next: {best} ('manoeuvre=[x]', " in sentence(replace(asked[0], typed={best: "manoeuvre=[x]"}))


@pytest.mark.slow
def test_what_is_advised_can_be_typed_back_as_it_stands():
    cfg = compose("excite")
    for name in dict.fromkeys([*cfg.candidates, *cfg.score]):
        (asked,) = named_manoeuvres([name], None)
        (typed,) = training_manoeuvres(compose("simulate", [f"manoeuvre={name}"]).manoeuvre)
        assert typed == asked and typed.name == name
