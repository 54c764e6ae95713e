"""The rules of the house that no linter knows: which way imports run, how long things are, what they may be called."""

import ast
import runpy
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import house_rules
import pytest
import yaml

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "manoeuvre_nn"
SHELVES = {"ship", "manoeuvre", "effect", "network"}
FLOORS: list[set[str]] = [
    {"core"},
    {"numerics"},
    {"seakeeping"},
    SHELVES,
    {"dynamics"},
    {"recording"},
    {"estimation"},
    {"scoring"},
    {"training"},
    {"diagnosis", "design"},
    {"report", "formulas"},
    {"commands"},
    {"api.py", "__main__.py"},
]
"""Rooms from the ground up: each imports from lower floors only, and shelves not from each other."""
RANK = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
HOME = {"hydra": {"commands"}, "lightning": {"training"}, "torchdiffeq": {"dynamics"}}
SOURCES = sorted(PACKAGE.rglob("*.py"))
STUDIES = sorted((ROOT / "studies").rglob("*.py"))
ENTRIES = sorted([*ROOT.glob("*.py"), *(ROOT / "scripts").rglob("*.py")])
LONGEST_FILE, LONGEST_BODY = 400, 60
OF_ALL = tuple(f"manoeuvre_nn.{room}." for room in ("core.ending", "core.errors", "core.writing", "report.html"))
"""How commands end, and how files and pages are written: no physics, so that the referee may use it."""


class Told(NamedTuple):
    """What a source says: names that it imports, functions with long bodies, calls that write a file by themselves."""

    imports: list[str]
    long: list[str]
    writes: list[str]


@cache
def told(source: str) -> Told:
    """Read once, for all rules."""
    nodes = list(ast.walk(ast.parse(source)))
    return Told(imported(nodes), long_functions(nodes), writes(nodes))


def imported(nodes: list[ast.AST]) -> list[str]:
    found = []
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "write imports in full"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def breaches(source: str, folder: str) -> list[str]:
    """What a file in a folder of the package imports that it must not."""
    wrong = []
    for name in told(source).imports:
        top, *rest = name.split(".")
        if name.endswith(".*"):
            wrong.append(f"star import {name}")
        if top == "pytorch_lightning" or folder not in HOME.get(top, {folder}):
            wrong.append(f"{top} outside {HOME.get(top, 'lightning')}")
        if top == "manoeuvre_nn" and rest and rest[0] in RANK and rest[0] != folder:
            if RANK[rest[0]] >= RANK[folder]:
                wrong.append(f"{folder} imports {name}")
    return wrong


def study_breaches(source: str, folder: str) -> list[str]:
    """What a file in a folder of the studies imports that it must not: another study, or, the referee, the package."""
    wrong = []
    for name in told(source).imports:
        top, *rest = name.split(".")
        if top == "studies" and rest and rest[0] not in {folder.split("/")[0], "reproduction"}:
            wrong.append(f"{folder} imports {name}")
        if folder == "concealed_trial" and (
            (top == "manoeuvre_nn" and not name.startswith(OF_ALL))
            or (top == "studies" and rest[:2] == ["concealed_trial", "rivals"])
        ):
            wrong.append(f"the referee imports {name}")
    return wrong


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def offending(paths: Iterable[Path], wrong: Callable[[Path, str], list[str]]) -> dict[str, list[str]]:
    """What is wrong with files, given as path and text, by their names; nothing of a file with which nothing is."""
    found = {name_of(path): wrong(path, path.read_text()) for path in paths}
    return {name: told for name, told in found.items() if told}


def test_imports_run_one_way():
    def wrong(path: Path, text: str) -> list[str]:
        folder = path.relative_to(PACKAGE).parts[0]
        if folder == "__init__.py":  # what a person uses is loaded when it is first used
            return [ast.unparse(n) for n in ast.parse(text).body if isinstance(n, ast.Import | ast.ImportFrom)]
        return breaches(text, folder) if folder in RANK else [f"{folder} has no place in the order of imports"]

    assert offending(SOURCES, wrong) == {}


def test_entry_points_leave_lightning_and_solvers_to_the_package():
    def wrong(path: Path, text: str) -> list[str]:
        return [n for n in told(text).imports if n.split(".")[0] in {"lightning", "torchdiffeq"}]

    assert offending(ENTRIES, wrong) == {}


def test_studies_do_not_import_each_other_and_the_referee_does_not_use_the_package():
    def wrong(path: Path, text: str) -> list[str]:
        return study_breaches(text, path.relative_to(ROOT / "studies").parent.as_posix())

    assert offending(STUDIES, wrong) == {}


@pytest.mark.parametrize(
    "source, folder",
    [
        ("from studies.wang1996.networks import case", "rajesh2009"),
        ("from studies.wang1996 import networks", "reproduction"),
        ("from manoeuvre_nn.core.units import KNOT", "concealed_trial"),
        ("from studies.concealed_trial.rivals.result import judge", "concealed_trial"),
        ("from studies.rajesh2009 import ship", "concealed_trial/rivals"),
    ],
)
def test_a_breach_of_a_study_is_seen(source, folder):
    assert study_breaches(source, folder)


def test_the_package_and_its_config_know_nothing_of_studies():
    assert [name_of(p) for p in SOURCES if any(n.startswith("studies") for n in told(p.read_text()).imports)] == []
    assert [name_of(p) for p in (ROOT / "conf").rglob("*.yaml") if "studies." in p.read_text()] == []


def test_the_wheel_holds_the_package_and_its_conf_alone(monkeypatch):
    monkeypatch.chdir(ROOT)
    with patch("setuptools.setup") as made:
        runpy.run_path("setup.py")
    packages = made.call_args.kwargs["packages"]
    assert {name.partition(".")[0] for name in packages} == {"manoeuvre_nn"}
    assert {"manoeuvre_nn.core", "manoeuvre_nn.recording.sample", "manoeuvre_nn.conf.ship"} <= set(packages)
    assert [p.name for p in (ROOT / "src").iterdir() if p.is_dir() and (p / "__init__.py").exists()] == ["manoeuvre_nn"]


@pytest.mark.parametrize(
    "source, folder",
    [
        ("from manoeuvre_nn.ship.mariner import mariner", "core"),
        ("from manoeuvre_nn.ship.mariner import mariner", "manoeuvre"),
        ("from manoeuvre_nn.manoeuvre.criteria import criteria", "ship"),
        ("from manoeuvre_nn.scoring.score import score", "dynamics"),
        ("import manoeuvre_nn.report.html", "training"),
        ("def late():\n    from manoeuvre_nn.training.fits import fit", "recording"),
        ("import hydra", "training"),
        ("from hydra.utils import instantiate", "dynamics"),
        ("import lightning as L", "report"),
        ("import pytorch_lightning", "training"),
        ("from torchdiffeq import odeint", "training"),
        ("from math import *", "core"),
    ],
)
def test_a_breach_is_seen(source, folder):
    assert breaches(source, folder)


def test_what_is_allowed_is_not_a_breach():
    assert breaches("from manoeuvre_nn.core.errors import InputError\nimport torchdiffeq", "dynamics") == []
    assert breaches("from manoeuvre_nn.manoeuvre.criteria import criteria", "manoeuvre") == []


def test_files_and_functions_are_short():
    def wrong(path: Path, text: str) -> list[str]:
        lines = text.count("\n")
        return [*([f"{lines} lines"] if lines > LONGEST_FILE else []), *told(text).long]

    assert offending([*SOURCES, *ENTRIES, *STUDIES, *sorted((ROOT / "tests").rglob("*.py"))], wrong) == {}


def long_functions(nodes: list[ast.AST]) -> list[str]:
    """Functions whose bodies are too long, by name."""
    found = []
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) and len(node.body) > 1 else node.body
            if node.end_lineno - body[0].lineno >= LONGEST_BODY:
                found.append(node.name)
    return found


def test_a_long_function_is_seen():
    lines = "".join(f"    a = {k}\n" for k in range(LONGEST_BODY))
    assert told(f"def f():\n{lines}").long == [] and told(f"def f():\n{lines}    a = 0\n").long == ["f"]


def test_package_inits_are_empty():
    assert [name_of(p) for p in PACKAGE.rglob("*/__init__.py") if p.read_text().strip()] == []


OFFENDERS = yaml.safe_load((ROOT / "tests" / "offenders.yaml").read_text())
"""Rule -> what still breaks it. Lists only get shorter: ``python tests/house_rules.py`` takes out what was mended."""


@pytest.mark.parametrize("rule", ["classes", "constants", "parameters", "subclasses", "words"])
def test_the_rules_of_the_house_are_kept(rule):
    found, known = set(house_rules.offences()[rule]), set(OFFENDERS.get(rule, []))
    assert found - known == set(), f"breaks the rule on {rule}, see tests/house_rules.py"
    assert known - found == set(), "is mended: run python tests/house_rules.py, which takes it off the list"


def rule_breakers(source: str) -> dict[str, list[str]]:
    tree = ast.parse(source)
    return {
        "constants": [n for n in house_rules.constants(tree) if n in house_rules.VAGUE_CONSTANTS],
        "parameters": list(house_rules.long_signatures(tree)),
        "words": sorted(house_rules.private_words(tree, "diagnosis")),
        "subclasses": list(house_rules.subclasses_of(tree, house_rules.concrete_classes([tree]))),
    }


@pytest.mark.parametrize(
    "rule, source, culprit",
    [
        ("constants", "MOST = 3", "MOST"),
        ("constants", "WORTH, REACH = 1, 2", "WORTH"),
        ("constants", "ENOUGH: float = 1", "ENOUGH"),
        ("parameters", "def f(a, b, c, d, e, f, g, h): ...", "f"),
        ("parameters", "class A:\n    def f(self, a, b, c, d, *, e, f, g, h): ...", "f"),
        ("words", "class FastCourt: ...", "court"),
        ("words", "bench_of_a_run = 3", "bench"),
        ("words", "def f(doubts): ...", "doubts"),
        ("subclasses", "class A: ...\nclass B(A): ...", "B"),
        ("subclasses", "class A(ABC):\n    @abstractmethod\n    def f(self): ...\n"
                       "class B(A):\n    def f(self): ...\nclass C(B): ...", "C"),
    ],
)  # fmt: skip
def test_a_broken_rule_is_seen(rule, source, culprit):
    assert rule_breakers(source)[rule] == [culprit]


@pytest.mark.parametrize(
    "source",
    [
        "MAX_GAP_S = 3",
        "class A:\n    def f(self, a, b, c, d, *, e, f, g): ...",
        "from elsewhere import court\nprint(court.judge)",
        "class A(ABC):\n    @abstractmethod\n    def f(self): ...\nclass B(A): ...\nclass C(B):\n    def f(self): ...",
        "class A(nn.Module): ...",
    ],
)
def test_what_keeps_the_rules_is_no_offence(source):
    assert not any(rule_breakers(source).values())


def writes(nodes: list[ast.AST]) -> list[str]:
    """Calls that write a file by themselves, and not a draft or a stream, by line."""
    found = []
    for node in nodes:
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
            continue
        name, given = node.func.attr, {ast.unparse(one) for one in node.args}
        tables = name == "to_csv" and any(keyword.arg == "index" for keyword in node.keywords)  # a recording's is ours
        others = name in {"write_text", "write_bytes", "dump", "savefig", "savez"}
        if (tables or others or ast.unparse(node.func) == "torch.save") and not given & {
            "draft",
            "file",
            "buffer",
            "content",
        }:
            found.append(f"{node.lineno} {name}")
    return found


def test_files_are_written_whole_or_not_at_all():
    allowed = {PACKAGE / "core" / "writing.py", PACKAGE / "formulas" / "check.py"}  # which writes to a scratch
    paths = [p for p in (*SOURCES, *ENTRIES, *STUDIES) if p not in allowed]
    wrong = offending(paths, lambda path, text: told(text).writes)
    assert wrong == {}, "write with manoeuvre_nn.core.writing"


@pytest.mark.parametrize(
    "source",
    ["p.write_text('a')", "t.to_csv(path, index=False)", "f.savefig(p)", "json.dump(a, f)", "torch.save(a, path)"],
)
def test_a_file_that_is_written_by_itself_is_seen(source):
    assert told(source).writes
    assert not told("frame.to_csv(draft, index=False)\ntorch.save(a, content)").writes
