"""The rules of the house that no linter knows: which way imports run, and how long things are."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "manoeuvre_nn"
SHELVES = {"ship", "manoeuvre", "effect", "network", "optimizer"}
RANK = {"core": 0, **dict.fromkeys(SHELVES, 1), "dynamics": 2, "recording": 3}
RANK |= {"training": 4, "identification": 4, "seakeeping": 4, "diagnosis": 5, "reproduction": 5}
RANK |= {"report": 6, "entry": 7}
RANK |= {"peers": 6}  # other methods, for comparison: only scripts use them
RANK |= {"trial": 1}  # the referee: it shares no physics with what it judges
HOME = {"hydra": {"entry"}, "lightning": {"training"}, "torchdiffeq": {"dynamics"}}
SOURCES = sorted(PACKAGE.rglob("*.py"))
ENTRIES = sorted([*ROOT.glob("*.py"), *(ROOT / "scripts").rglob("*.py")])
LONGEST_FILE, LONGEST_BODY = 400, 60


def imported(tree: ast.AST) -> list[str]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "write imports in full"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def breaches(source: str, folder: str) -> list[str]:
    """What a file in a folder of the package imports that it must not."""
    wrong = []
    for name in imported(ast.parse(source)):
        top, *rest = name.split(".")
        if name.endswith(".*"):
            wrong.append(f"star import {name}")
        if top == "pytorch_lightning" or folder not in HOME.get(top, {folder}):
            wrong.append(f"{top} outside {HOME.get(top, 'lightning')}")
        if top == "manoeuvre_nn" and rest and rest[0] in RANK and rest[0] != folder:
            same_shelf_level = {rest[0], folder} <= SHELVES | {"trial"}
            if RANK[rest[0]] >= RANK[folder] or same_shelf_level:
                wrong.append(f"{folder} imports {name}")
    return wrong


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_imports_run_one_way(path):
    folder = path.relative_to(PACKAGE).parts[0]
    if folder == "__init__.py":
        assert imported(ast.parse(path.read_text())) == []
    else:
        assert folder in RANK, f"{folder} has no place in the order of imports"
        assert breaches(path.read_text(), folder) == []


@pytest.mark.parametrize("path", ENTRIES, ids=name_of)
def test_entry_points_leave_lightning_and_solvers_to_the_package(path):
    wrong = [n for n in imported(ast.parse(path.read_text())) if n.split(".")[0] in {"lightning", "torchdiffeq"}]
    assert wrong == []


@pytest.mark.parametrize(
    "source, folder",
    [
        ("from manoeuvre_nn.ship.mariner import mariner", "core"),
        ("from manoeuvre_nn.ship.mariner import mariner", "manoeuvre"),
        ("from manoeuvre_nn.manoeuvre.criteria import criteria", "ship"),
        ("from manoeuvre_nn.recording.score import score", "dynamics"),
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
    assert breaches("from manoeuvre_nn.manoeuvre.trace import trace", "manoeuvre") == []


@pytest.mark.parametrize("path", [*SOURCES, *ENTRIES, *sorted((ROOT / "tests").rglob("*.py"))], ids=name_of)
def test_files_and_functions_are_short(path):
    text = path.read_text()
    assert text.count("\n") <= LONGEST_FILE
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) and len(node.body) > 1 else node.body
            assert node.end_lineno - body[0].lineno < LONGEST_BODY, f"{node.name} is too long"


def test_package_inits_are_empty():
    assert [name_of(p) for p in PACKAGE.rglob("*/__init__.py") if p.read_text().strip()] == []
