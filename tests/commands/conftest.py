"""The command line in this process: an import of torch costs more than a tiny run."""

import copy
import logging
import pickle
import runpy
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import lightning  # noqa: F401  before the package, see tests/conftest.py
import omegaconf._utils
import omegaconf.base
import pytest
import yaml
from fleet import unchecked
from hydra import compose, initialize_config_dir
from hydra._internal import config_loader_impl, defaults_list
from hydra._internal.config_repository import ConfigRepository
from hydra._internal.core_plugins import file_config_source, importlib_resources_config_source
from hydra.core.default_element import InputDefault
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf._utils import get_yaml_loader
from omegaconf.grammar_parser import parse
from remembered import simulations_remembered
from rich.console import Console
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser
from yaml.resolver import Resolver

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.groups import register_resolvers
from manoeuvre_nn.commands.settings import check_settings
from manoeuvre_nn.commands.train import train
from manoeuvre_nn.core import data_files

ROOT = Path(__file__).parents[2]
CONF = ROOT / "conf"
TINY = (
    "network=wang", "fit=levenberg_marquardt",
    "trainer.max_epochs=4", "scoring.every=2", "scoring.solver=rollout", "data.length=60", "network.hidden=3",
    "score=[{zz20: {duration: 60}}]", "fit.iterations_per_epoch=2",
)  # fmt: skip
SHORT = (*TINY, "data.length=45", "score=[{zz20: {duration: 30}}]")
TINY_ENSEMBLE = (
    "data.length=45", "score=[{zz20: {duration: 60}}]", "network.members=2", "network.hidden=4", "fit.epochs=3",
    "scoring.solver=rollout", "scoring.every=1",
)  # fmt: skip


@pytest.fixture(autouse=True)
def typed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test begins as if train had been typed, whatever ran in this process before."""
    monkeypatch.setattr(guard, "command", "train")


@pytest.fixture(autouse=True)
def log_as_before() -> Generator[None]:
    """Hydra's help opens a log on the terminal of its test and leaves it to the end of the process."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    yield
    for handler in [h for h in root.handlers if h not in before and type(h) is logging.StreamHandler]:
        root.removeHandler(handler)
    root.setLevel(level)


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str


def code_of(end: SystemExit) -> int:
    """Exit code; a fault of the program, whose traceback is in a file, fails the test with it."""
    if isinstance(end.__cause__, Exception):
        raise end.__cause__
    return int(end.code or 0)


@pytest.fixture(autouse=True)
def as_people_run_it() -> Generator[None]:
    """Without checks of types: a config gives 35 where an annotation says float, which Python takes."""
    with unchecked():
        yield


@pytest.fixture(autouse=True, scope="session")
def _simulated_once() -> Generator[None]:
    with simulations_remembered():
        yield


@pytest.fixture
def cli(monkeypatch, capsys, tmp_path) -> Callable[..., Ended]:
    """``cli("ship=mariner", ...)`` runs train.py in an empty folder."""
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")  # so that what the program sets is undone
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> Ended:
        capsys.readouterr()
        code = _run(words)
        told = capsys.readouterr()
        return Ended(code, told.out, told.err)

    return run


@pytest.fixture
def fast(monkeypatch) -> None:
    """Leaves figures out, which take most of a tiny run's time; one run with them is ``done``."""
    monkeypatch.setattr("manoeuvre_nn.commands.results.figures", lambda outcome: {})


def _run(words) -> int:
    GlobalHydra.instance().clear()
    guard.failed_jobs.clear()
    before = sys.argv
    sys.argv = ["train.py", *words]
    try:
        runpy.run_path(str(ROOT / "train.py"), run_name="__main__")
    except SystemExit as end:
        return code_of(end)
    finally:
        sys.argv = before
        GlobalHydra.instance().clear()
    return 0


@pytest.fixture(scope="session")
def typed_train() -> Callable[[list[str]], int]:
    """What ``train.py`` with some words ends with, for fixtures that last for longer than a test."""
    return _run


@pytest.fixture(scope="session")
def done(tmp_path_factory) -> Path:
    """The folder of a complete tiny run."""
    out = tmp_path_factory.mktemp("done") / "run"
    with unchecked():
        assert _run([*TINY, f"out={out}"]) == 0
    return out


@cache
def quick_loader() -> type:
    """Omegaconf's reader of yaml on libyaml, which parses ten times as fast; hydra reads twenty files for a command."""

    class Quick(CParser, get_yaml_loader()):
        def __init__(self, stream):
            CParser.__init__(self, stream)
            SafeConstructor.__init__(self)
            Resolver.__init__(self)

    return Quick


def quick_choices(overrides, defaults: list[InputDefault], self_added: bool) -> DictConfig:
    """What interpolations in a list of defaults may name, which hydra makes for each file and few have any."""
    return every_choice(overrides, defaults, self_added) if any(d.is_interpolation() for d in defaults) else NO_CHOICE


class QuickReading(OmegaConf):
    """Omegaconf as hydra's sources use it, which make a config of each text once: reading a pickle is much faster."""

    made: dict[str, bytes] = {}

    @classmethod
    def load(cls, file) -> DictConfig:
        text = file.read()
        if text not in cls.made:
            file.seek(0)
            cls.made[text] = pickle.dumps(OmegaConf.load(file))
        return pickle.loads(cls.made[text])


class QuickYaml(ModuleType):
    """Yaml as the package reads it, which makes content of each text once: a command looks at forty effects."""

    made: dict[str, bytes] = {}

    @classmethod
    def load(cls, text: str, loader: type) -> Any:
        if text not in cls.made:
            cls.made[text] = pickle.dumps(yaml.load(text, loader))  # noqa: S506 - the package's own loader
        return pickle.loads(cls.made[text])

    def __getattr__(self, name: str) -> Any:
        return getattr(yaml, name)


class QuickRepository(config_loader_impl.CachingConfigRepository):
    """Hydra's, without a deep copy of where files are: the copy only gets a list of its own."""

    def __init__(self, delegate: ConfigRepository) -> None:
        self.delegate, self.cache = copy.copy(delegate), {}


data_files.yaml = QuickYaml("yaml")
omegaconf._utils.get_yaml_loader = quick_loader
omegaconf._utils.parse = omegaconf.base.parse = cache(parse)  # the same few interpolations in each of these files
every_choice, NO_CHOICE = defaults_list._create_interpolation_map, OmegaConf.create()
defaults_list._create_interpolation_map = quick_choices
config_loader_impl.CachingConfigRepository = QuickRepository
file_config_source.OmegaConf = importlib_resources_config_source.OmegaConf = QuickReading


@contextmanager
def _composing() -> Generator[None]:
    register_resolvers()
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        yield


@pytest.fixture
def composed() -> Callable[..., DictConfig]:
    """``composed("ship=mariner")`` is the config of that command."""

    return lambda *words: copy.deepcopy(_config(*words))


@cache
def _config(*words: str) -> DictConfig:
    with _composing():
        cfg = compose("train", list(words), return_hydra_config=True)
    check_settings(cfg)
    with open_dict(cfg):
        del cfg["hydra"]
        cfg.name = "test"
    OmegaConf.set_struct(cfg, True)
    return cfg


@pytest.fixture
def attempt(composed, capsys) -> Callable[..., Ended]:
    """``attempt(out, "ship=mariner", ...)`` is the command without hydra's own work, which takes twice as long."""

    def run(out: Path, *words: str) -> Ended:
        code = 0
        try:
            with guard.one_line():
                train(composed(*words), out, Console(quiet=True))
        except SystemExit as end:
            code = code_of(end)
        told = capsys.readouterr()
        return Ended(code, told.out, told.err)

    return run
