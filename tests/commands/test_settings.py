"""Settings of no group: every one has a kind, and what is of another kind is refused before anything is read."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from manoeuvre_nn.commands.groups import GROUPS, compose
from manoeuvre_nn.commands.job import config_beside
from manoeuvre_nn.commands.settings import SETTINGS, check_settings
from manoeuvre_nn.core.errors import InputError

CONF = Path(__file__).parents[2] / "conf"
COMMANDS = sorted(path for path in [*CONF.glob("*.yaml"), *CONF.glob("task/*.yaml")])
OF_GROUPS = {*GROUPS, "defaults", "hydra"} - {"manoeuvre", "data"}
NAN, ENDLESS = float("nan"), float("inf")


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.stem)
def test_every_setting_of_every_command_has_a_kind(path):
    said = yaml.safe_load(path.read_text())
    own = [key for key in said if key not in OF_GROUPS]
    own += [f"{key}.{inner}" for key in ("manoeuvre", "data", "captive") for inner in said.get(key, ())]
    assert len(own) > 3 and not set(own) - set(SETTINGS)


def test_no_kind_is_of_a_setting_that_there_is_not():
    known = {f"data.{key}" for key in yaml.safe_load((CONF / "data" / "files.yaml").read_text())}
    known |= {f"trainer.{key}" for key in yaml.safe_load((CONF / "trainer" / "default.yaml").read_text())}
    for path in COMMANDS:
        said = yaml.safe_load(path.read_text())
        known |= {*said, *(f"{key}.{inner}" for key in ("manoeuvre", "data", "captive") for inner in said.get(key, ()))}
    assert not set(SETTINGS) - known - set(GROUPS)


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.stem)
def test_the_settings_of_every_command_are_of_their_kinds(path):
    check_settings(compose(path.relative_to(CONF).with_suffix("").as_posix()))


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("seed", [0, 7, 2**63 - 1], [-1, 1.0, True, "1", None, 2**63, [1], {}]),
        ("workers", [1, 256], [0, 257, "two", 1.5, None]),
        ("remainder", [True, False], ["yes", 1, 0, None, "true", []]),
        ("model", ["a/best.ckpt", 2026, None], [True, [], ["a"], {"a": 1}, "", 256 * "x", 2048 * "a/"]),
        ("data.folder", ["runs", 2026], [None, "", ["a"], False]),
        ("data.files", ["A.csv", ["A.csv", 7], []], [None, [True], [["A"]], {"a": 1}, [""], True]),
        ("files", ["A.csv", None], [[None], True, {}]),
        ("manoeuvre.speed_kn", [15, 15.5, None], [0, -1, True, "15", NAN, ENDLESS, [15]]),
        ("manoeuvre.rudder_split_deg", [-70, 0, 3.5, None], [71, "port", NAN, True]),
        ("manoeuvre.shaft_split", [-2, 2.0], [2.1, -ENDLESS]),
        ("captive.speed", [0.76, None], [0, -0.76, "slow", False, ENDLESS, 10**400]),
        ("captive", [{"file": None}], [None, 5, "x", []]),
        ("relative", [0.2, 1], [0, -0.2, None, "x", True, NAN]),
        ("score", ["default", ["zz20", {"zz5": {"duration": 50}}], []], [None, True, [["zz20"]], [{"zz5": 3}], [{}]]),
        ("candidates", ["all", ["current"]], [True, [None], None, {}]),
        ("held_out", ["auto", ["a", "b"]], [None, {"a": 1}, [{}]]),
        ("plugins", [None, [], "mine", ["mine"]], [True, [1.5, None], {"a": 1}]),
        ("inertia", [None, {"mx": 1}], [3, [1], "heavy"]),
        ("noise", [{}, {"u": 0.1}], [None, 0.1, [0.1]]),
        ("learning", [0.5], [0, None, "half", True]),
    ],
)  # fmt: skip
def test_what_a_setting_may_be(name, right, wrong):
    place, _, key = name.rpartition(".")

    def config(value):
        return OmegaConf.create({place: {key: value}} if place else {key: value})

    for value in right:
        check_settings(config(value))
    for value in wrong:
        with pytest.raises(InputError, match=f"^{name}=.*: expected "):
            check_settings(config(value))


def test_python_gets_no_config_of_a_wrong_kind_either():
    with pytest.raises(InputError, match="seed=1.5: expected a whole number, 0 or more"):
        compose("train", ["seed=1.5"])


def test_the_settings_beside_a_model_are_checked_too(tmp_path):
    (tmp_path / "config.yaml").write_text("format: 1\nseed: much\n")
    with pytest.raises(InputError, match=r"config.yaml: seed=much: expected a whole number"):
        config_beside(tmp_path / "checkpoints" / "best.ckpt", ())


def test_what_every_command_loads_first_loads_neither_figures_nor_torch():
    told = "print(sorted({'matplotlib', 'pandas', 'torch'} & set(sys.modules)))"
    code = f"import sys, manoeuvre_nn.commands.provenance; {told}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
