"""Thresholds, priors and grids of the diagnosis and the estimation: results were measured with those of a table.

Most have a test of what they do; a change of any is a decision, after which results are measured again. To write the
table anew: ``python tests/diagnosis/test_declared_thresholds.py``.
"""

import ast
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np

import manoeuvre_nn

TABLE = Path(__file__).with_name("declared_thresholds.txt")
PACKAGE = Path(manoeuvre_nn.__file__).parent


def in_figures(value: object) -> str:
    """A number, or a list of numbers in brackets; empty for anything else."""
    if isinstance(value, bool | str) or value is None:
        return ""
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if isinstance(value, np.ndarray):
        return in_figures(value.tolist())
    parts = [in_figures(v) for v in value] if isinstance(value, tuple | list) else []
    return f"({', '.join(parts)})" if parts and all(parts) else ""


def names_in(source: Path) -> Iterator[str]:
    """Names in capitals that a module gives a value to."""
    for statement in ast.parse(source.read_text()).body:
        if isinstance(statement, ast.Assign):
            targets = [e for t in statement.targets for e in (t.elts if isinstance(t, ast.Tuple) else [t])]
            yield from (t.id for t in targets if isinstance(t, ast.Name) and t.id.upper() == t.id)


def thresholds() -> list[str]:
    """Of every module its numbers in capitals, one a line."""
    lines = []
    for source in sorted(file for room in ("diagnosis", "estimation") for file in (PACKAGE / room).rglob("*.py")):
        module = source.relative_to(PACKAGE).with_suffix("")
        values = vars(import_module(".".join(("manoeuvre_nn", *module.parts))))
        lines += [f"{module} {n} = {said}" for n in names_in(source) if (said := in_figures(values[n]))]
    return lines


def test_thresholds_are_those_that_results_were_measured_with():
    now, table = thresholds(), TABLE.read_text().splitlines()
    assert sorted(set(now) ^ set(table)) == []


if __name__ == "__main__":
    TABLE.write_text("\n".join(thresholds()) + "\n")
