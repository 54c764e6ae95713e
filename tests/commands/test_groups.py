"""What one choice brings with it is said, and what the user wrote is never overruled."""

import re

import hydra
import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser

from manoeuvre_nn.api import read
from manoeuvre_nn.commands.groups import CONF, brought_along, compose, job_name, option, with_settings
from manoeuvre_nn.commands.main import with_job_names
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.ship.mariner import mariner

MINE = ["data=recording", "network=modulus", "data.folder=x", "data.files=[a.csv]"]


def choices(words):
    with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = hydra.compose("train", words, return_hydra_config=True)
    HydraConfig.instance().cfg = None
    return cfg.hydra.runtime.choices


def test_nothing_is_said_where_nothing_follows():
    assert brought_along(choices([]), []) == []


def test_network_and_fit_of_recordings_are_said():
    words = ["data=recording"]
    assert brought_along(choices(words), words) == ["linear=clarke_inertia", "network=cubic", "fit=closed_loop"]


def test_what_the_user_wrote_holds_and_is_not_repeated():
    chosen = choices(MINE)
    assert chosen["network"] == "modulus"
    assert brought_along(chosen, MINE) == ["linear=clarke_inertia", "fit=closed_loop"]


def test_a_config_from_python_does_not_take_the_name_of_a_command_that_ran_before(monkeypatch):
    with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
        before = hydra.compose("train", ["ship=mariner"], return_hydra_config=True)
    monkeypatch.setattr(HydraConfig.instance(), "cfg", before)
    assert compose("train", ["ship=esso_190k"]).name.startswith("esso_190k_")


def test_options_of_which_several_hold_are_typed_with_their_settings():
    words = ["ship=mariner", "manoeuvre=[zz20,{spiral: {rudder_deg: 15, first: port, hold: null}}]"]
    settings = ["manoeuvre.spiral.rudder_deg=15", "manoeuvre.spiral.first=port", "manoeuvre.spiral.hold=null"]
    assert with_settings(words) == ["ship=mariner", "manoeuvre=[zz20,spiral]", *settings]
    cfg = compose("simulate", ["effect={current: {speed: 0.5}}", words[1].replace(", hold: null", "")])
    assert cfg.effect.current.speed == 0.5
    assert (cfg.manoeuvre.spiral.first, cfg.manoeuvre.spiral.hold, cfg.manoeuvre.zz20.rudder_deg) == ("port", 60, 20)


@pytest.mark.parametrize(
    "value", ["[{spiral: 3}]", "[{a: {}, b: {}}]", "[zz20,{zz20: {}}]", "{", "[3,{a: {}}]", "[{{a: 1}}]"]
)
def test_what_is_neither_a_name_nor_one_with_settings_is_refused(value):
    with pytest.raises(InputError, match=r"expected names, each once, or \{name: \{setting: value\}\}"):
        with_settings([f"manoeuvre={value}"])


@pytest.mark.parametrize("text", ["|", "[1, 2]", "ship: 5", "5", "null"])
def test_a_file_that_holds_no_settings_is_refused(text, tmp_path):
    for group in ("ship", "manoeuvre"):
        (tmp_path / group).mkdir()
        (tmp_path / group / "mine.yaml").write_text(text.replace("ship", group))
        with pytest.raises(InputError, match=rf"mine.yaml holds no settings of a {group}"):
            option(group, "mine", str(tmp_path))
    with pytest.raises(InputError, match="holds no settings of a ship"):
        read("none.csv", ship=str(tmp_path / "ship" / "mine.yaml"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rudder_deg": True}, "rudder_deg=True: expected a number"),
        ({"executes": False}, "executes=False: expected a whole number or null"),
        ({"name": {"a": 1}}, "name={'a': 1}: expected a word"),
        ({"name": [1]}, "name=[1]: expected a word or null"),
    ],
)
def test_a_switch_is_no_number_and_a_table_no_word(change, said):
    with pytest.raises(InputError, match=re.escape(said)):
        build({**option("manoeuvre", "zz20"), **change}, "manoeuvre")


def test_a_file_does_not_say_on_which_ship_an_effect_acts():
    with pytest.raises(InputError, match="effect.ship=3.1 is no setting of Squat: leave ship out"):
        build({**option("effect", "squat"), "ship": 3.1}, "effect", ship=mariner())


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["ship=mariner", "network.hidden=7,11", "data.length=180,240"], "hidden=7,length=180"),
        (["network.hidden=2,3", "fit.hidden=4,5", "seed=0"], "network.hidden=2,fit.hidden=4"),
        (["+manoeuvre.zz35.executes=2,3", "config_dir='/my own'"], "executes=2"),
        (["effect=[current],[bank]", "seed=range(0,3)"], "effect=[current],seed=0"),
        (["effects=a/b.yaml,c.yaml"], "effects=a_b.yaml"),
        (["network.hidden=3", "network.hidden=7,11"], "hidden=7"),
        (["ship=mariner"], "run"),
    ],
)
def test_a_job_of_a_sweep_is_called_by_what_was_changed(words, names):
    *_, last = with_job_names(["-m", *words])
    same = OverridesParser.create().parse_override(last).value()
    first = [
        BasicSweeper.split_arguments([one], None)[0][0][0] for one in OverridesParser.create().parse_overrides(words)
    ]
    assert job_name(first, [str(name) for name in same]) == names


def test_the_words_of_a_single_run_stay_as_they_are():
    assert with_job_names(["network.hidden=7", "--cfg", "job"]) == ["network.hidden=7", "--cfg", "job"]


def test_a_run_that_is_no_path_is_refused_by_its_setting():
    with pytest.raises(InputError, match="^run="):
        compose("coefficients", ["run={a: 1}"])
