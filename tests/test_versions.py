"""What is installed: locks hold what pyproject.toml asks for, what is imported is asked for, licences are listed."""

import ast
import importlib
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from importlib.util import find_spec
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from benchmarks.licences import HARMLESS, PAGE, RECIPROCAL, licence, needed
from benchmarks.versions import LOCKS, OF_TORCH

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
OF_TESTS = ("test", "notebook", "onnx", "search")
TESTED = [Requirement(r) for r in (*PROJECT["dependencies"], *(r for extra in OF_TESTS for r in EXTRAS[extra]))]
DIRECT = {canonicalize_name(r.name): r.specifier for r in TESTED if r.name != PROJECT["name"]}
"""What the package and its tests name, and the versions of it that they admit."""


def pins(path: Path) -> dict[str, Version]:
    """Normalised name -> version; every line after the first is a pin."""
    pairs = [line.split("==") for line in path.read_text().splitlines()[1:]]
    return {canonicalize_name(name): Version(version) for name, version in pairs}


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_pins_all_that_is_asked_for_in_versions_that_are_admitted(lock):
    pinned = pins(LOCKS[lock].path)
    assert set(DIRECT) - set(pinned) == set()
    assert [name for name, admitted in DIRECT.items() if not admitted.contains(pinned[name])] == []
    assert [name for name in pinned if name.startswith(OF_TORCH)] == []
    assert f"Python {LOCKS[lock].python}" in LOCKS[lock].path.read_text().splitlines()[0] or lock == "py311"


def test_the_lowest_lock_pins_the_lowest_releases_that_are_admitted():
    pinned = pins(LOCKS["py311-lowest"].path)
    lowest = {n: Version(s.version) for n, all_of in DIRECT.items() for s in all_of if s.operator == ">="}
    assert set(lowest) == set(DIRECT)
    assert [name for name, version in lowest.items() if _three_numbers(pinned[name]) != _three_numbers(version)] == []


def _three_numbers(version: Version) -> tuple[int, int, int]:
    return version.major, version.minor, version.micro


def test_every_python_that_is_named_has_a_lock():
    named = [c.rpartition(" :: ")[2] for c in PROJECT["classifiers"] if c.startswith("Programming Language :: Python")]
    assert sorted(named) == sorted({lock.python for lock in LOCKS.values()})


def test_the_package_imports_what_it_asks_for_alone():
    extras = (EXTRAS[name] for name in ("excel", "mat", "mlflow", "onnx", "parquet", "ros", "seakeeping"))
    asked = {canonicalize_name(Requirement(r).name) for part in (PROJECT["dependencies"], *extras) for r in part}
    providers = packages_distributions()
    for top in _imported() - set(sys.stdlib_module_names) - {"manoeuvre_nn"}:
        assert asked & {canonicalize_name(name) for name in providers.get(top, [top])}, f"{top} is not asked for"


def test_the_libraries_that_mutation_loads_beforehand_are_installed_with_the_tests(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    libraries = importlib.import_module("mutation_tests").LIBRARIES
    assert [name for name in libraries if find_spec(name.partition(".")[0]) is None] == []


def _imported() -> set[str]:
    """First parts of the names of modules that the package imports."""
    nodes = [n for p in (ROOT / "src").rglob("*.py") for n in ast.walk(ast.parse(p.read_text()))]
    names = [alias.name for n in nodes if isinstance(n, ast.Import) for alias in n.names]
    return {name.partition(".")[0] for name in [*names, *(n.module for n in nodes if isinstance(n, ast.ImportFrom))]}


def test_every_package_that_is_needed_has_a_licence_that_mit_goes_with_or_a_remark():
    unclear = {name: licence(part) for name, part in needed().items() if not name.startswith(OF_TORCH)}
    assert [name for name, said in unclear.items() if not said] == []
    assert [name for name, said in unclear.items() if RECIPROCAL.search(said) and name not in HARMLESS] == []


@pytest.mark.parametrize("said", ["GPL-3.0-or-later", "GNU General Public License v2", "LGPLv2+", "MPL-2.0 AND MIT"])
def test_a_licence_that_asks_more_is_seen(said):
    assert RECIPROCAL.search(said) and not RECIPROCAL.search("Apache-2.0 WITH LLVM-exception AND BSL-1.0")


def test_what_constraints_txt_installs_is_all_pinned_and_listed():
    pinned, own = pins(ROOT / "constraints.txt"), needed()
    if any(n in pinned and Version(p.version).public != pinned[n].public for n, p in own.items()):
        pytest.skip("other versions are installed here")
    assert {name for name in own if not name.startswith(OF_TORCH)} - set(pinned) == set()
    listed = dict(re.findall(r"^\| ([\w.-]+) \| ([\w.]+) \|", PAGE.read_text(), re.MULTILINE))
    assert {n: v.version for n, v in own.items() if Version(v.version).public != listed.get(n)} == {}
