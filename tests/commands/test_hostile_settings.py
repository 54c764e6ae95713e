"""Every setting of every command is given what cannot be meant: one line that names it, or the command goes on to work.

What a command does before it computes is done here, in this process.
"""

import copy
from collections.abc import Iterator
from itertools import product
from math import inf, nan
from typing import Any

import pytest
from omegaconf import OmegaConf
from rich.console import Console

from manoeuvre_nn.commands import check, coefficients, diagnose, excite, export, guard, simulate, train
from manoeuvre_nn.commands.groups import GROUPS, accept, compose
from manoeuvre_nn.commands.settings import SETTINGS
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.training.data import ManoeuvreData

HOSTILE: tuple[Any, ...] = (
    inf, -inf, nan, 1e300, 1e-308, -1, 0, "", {}, [], [1, 2], ["a"], [None], [nan], {"a": 1}, "a", 10**30, 2**62, True,
    None, "/", "../x", "x" * 300, [[1]], {"_target_": "os.system"}, [{"_target_": "os.system"}],
)  # fmt: skip
ALWAYS = (nan, 1e300, 10**30, {"_target_": "os.system"}, [{"_target_": "os.system"}])
"""What no setting may be."""
NAMES = {"config_dir", "plugins", "name", "out"}
"""Settings that are read before a config is made, or that only name things."""
SHORT = ("data.length=60", "score=[{tc25: {duration: 60}}]")
TASKS = {
    "train": lambda cfg, out: train.train(cfg, out, QUIET),
    "task/pitch": lambda cfg, out: train.train(cfg, out, QUIET),
    "simulate": lambda cfg, out: simulate.simulate(cfg, out, QUIET),
    "diagnose": lambda cfg, out: diagnose.diagnose_all(cfg, out, QUIET),
    "check": lambda cfg, out: check.check(cfg, out, QUIET),
    "coefficients": lambda cfg, out: coefficients.tell(cfg, out, QUIET),
    "excite": lambda cfg, out: excite.excite(cfg, out, QUIET),
    "export": lambda cfg, out: export.export(cfg, out, QUIET),
}
USUAL = [
    ("train", "network=wang", *SHORT),
    ("simulate", "effect=[current,tow]", "manoeuvre.zz20.duration=60"),
    ("diagnose", "recordings=sample", "candidates=[heading_bias]"),
    ("check", "data.folder=sample"),
    ("coefficients", "network=cubic", *SHORT),
    ("excite", "candidates=[zz20]", "score=[zz10]", *SHORT[:1]),
    ("export", "run=."),
]
MORE = [
    ("train", *SHORT),
    ("train", "network=wang", "fit=backprop", *SHORT),
    ("train", "network=modulus", *SHORT),
    ("train", "ship=container_twin", "network=recursive", *SHORT),
    *(("task/pitch", "data.method=closed_form", f"network={name}") for name in ("mlp", "rbf", "grnn")),
]
QUIET = Console(quiet=True)


class Computes(BaseException):
    """A command has checked what it was given and begins its work."""


@pytest.fixture(autouse=True)
def nothing_is_computed(monkeypatch, tmp_path):
    def begin(*_: Any, **__: Any) -> None:
        raise Computes

    for module in (train, diagnose, excite):
        monkeypatch.setattr(module, "check_same_run", begin)
    monkeypatch.setattr(check, "write_provenance", begin)
    monkeypatch.setattr(simulate, "solve", begin)
    monkeypatch.setattr(ManoeuvreData, "remarks", begin)
    monkeypatch.setattr(export, "program_of", begin)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "best.ckpt").touch()
    (tmp_path / "config.yaml").write_text("format: 1\n")


@pytest.mark.parametrize("words", USUAL, ids=lambda words: words[0])
def test_a_setting_that_cannot_be_meant_is_refused_by_its_name(words, tmp_path):
    others = set() if words[0] in {"train", "simulate"} else set(GROUPS)  # whose settings those two have, too
    for number, (plain, key) in enumerate(one for one in settings(words) if one[1].partition(".")[0] not in others):
        for value in {repr(v): v for v in (HOSTILE[number % len(HOSTILE)], ALWAYS[number % len(ALWAYS)])}.values():
            attempt(words[0], changed(plain, key, value), key, value, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("words", [*USUAL, *MORE], ids=" ".join)
def test_each_setting_that_cannot_be_meant_is_refused_by_its_name(words, tmp_path):
    for (plain, key), value in product(list(settings(words)), HOSTILE):
        attempt(words[0], changed(plain, key, value), key, value, tmp_path)


def settings(words: tuple[str, ...]) -> Iterator[tuple[dict[str, Any], str]]:
    """The config of a command, and the name of each of its settings and groups."""
    plain = OmegaConf.to_container(compose(words[0], words[1:]))
    plain.pop("hydra", None)
    plain["name"] = "x"
    yield from ((plain, key) for key in below(plain) if key not in NAMES)


def below(settings: dict[str, Any], before: str = "") -> Iterator[str]:
    for key, value in settings.items():
        yield f"{before}{key}"
        if isinstance(value, dict):
            yield from below(value, f"{before}{key}.")


def changed(plain: dict[str, Any], key: str, value: Any) -> dict[str, Any]:
    """The settings with another value of one of them."""
    made = inner = copy.deepcopy(plain)
    *above, last = key.split(".")
    for name in above:
        inner = inner[name]
    inner[last] = value
    return made


def attempt(command: str, plain: dict[str, Any], key: str, value: Any, out: Any) -> None:
    """Do what a command does before it computes."""
    told, named = f"{key}={value!r}", (*key.split("."), str(value) or "''")
    try:
        cfg = OmegaConf.create(plain)
        OmegaConf.set_struct(cfg, True)
        accept(cfg)
        TASKS[command](cfg, out)
    except Computes:
        name = key in SETTINGS and SETTINGS[key].accepts(2026)  # a file may be called 1e300
        assert name or not any(value is one for one in ALWAYS), f"{told} was taken"
    except InputError as error:
        line = str(error)
        assert "\n" not in line and len(line) < 900, f"{told}: {line}"
        assert any(part in line for part in named), f"{told} is not named: {line}"
    except Exception as error:
        line = guard.explain(error)
        if line is None:
            raise AssertionError(f"{told}: a fault of the program") from error
        assert any(part in line for part in named), f"{told} is not named: {line}"
    else:
        raise AssertionError(f"{told}: nothing was computed")
