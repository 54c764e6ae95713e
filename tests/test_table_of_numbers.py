"""Thresholds, priors, grids, ranges and defaults of the package: results were measured with those of a table.

Most have a test of what they do; a change of any is a decision, after which results are measured again. To write the
table anew: ``python tests/test_table_of_numbers.py``.
"""

import ast
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Annotated, get_args, get_origin

import numpy as np

import manoeuvre_nn
from manoeuvre_nn.core.effect import Parameter

TABLE = Path(__file__).with_name("declared_numbers.txt")
PACKAGE = Path(manoeuvre_nn.__file__).parent


def in_figures(value: object) -> str:
    """A number, or a list of numbers in brackets; empty for anything else."""
    if isinstance(value, bool | str) or value is None:
        return ""
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if isinstance(value, np.ndarray):
        return in_figures(value.tolist())
    if get_origin(value) is Annotated:  # a number and its limits
        return in_figures(get_args(value)[1])
    if isinstance(value, dict):
        value = list(value.values())
    if is_dataclass(value) and not isinstance(value, type):  # what is no number has no place in the table
        said = (in_figures(getattr(value, field.name)) for field in fields(value))
        numbers_said = ", ".join(filter(None, said))
        return f"({numbers_said})" if numbers_said else ""
    parts = [in_figures(v) for v in value] if isinstance(value, tuple | list) else []
    return f"({', '.join(parts)})" if parts and all(parts) else ""


def of_parameter(parameter: Parameter) -> str:
    """Its range, null, spread, starts and what else is not as usual."""
    values = ((field.name, getattr(parameter, field.name)) for field in fields(parameter))
    said = ((name, in_figures(value) or value) for name, value in values)
    return ", ".join(f"{name} {value}" for name, value in said if value)


def of_class(name: str, kind: type) -> Iterator[tuple[str, str]]:
    """Numbers that a class is declared with: defaults of its attributes, and parameters of an effect."""
    declared = {} if kind.__module__ == "builtins" else vars(kind)
    for word, value in declared.items():
        if word in declared.get("__annotations__", ()) and (said := in_figures(value)):
            yield f"{name}.{word}", said
    own = declared.get("declared", ())
    yield from ((name, of_parameter(p)) for p in own if isinstance(p, Parameter))


def declared_in(source: Path, module: ModuleType) -> Iterator[tuple[str, str]]:
    """Names and numbers of a module: what it calls in capitals, limits, defaults and parameters of its classes."""
    for statement in ast.parse(source.read_text()).body:
        if isinstance(statement, ast.ClassDef):
            yield from of_class(statement.name, getattr(module, statement.name))
        elif isinstance(statement, ast.Assign):
            targets = [e for t in statement.targets for e in (t.elts if isinstance(t, ast.Tuple) else [t])]
            for name in (t.id for t in targets if isinstance(t, ast.Name) and t.id[0].isupper()):
                if said := in_figures(getattr(module, name)):
                    yield name, said


def numbers() -> list[str]:
    """What every module declares, one a line."""
    lines = []
    for source in sorted(PACKAGE.rglob("*.py")):
        words = source.relative_to(PACKAGE).with_suffix("").parts
        if words[-1].startswith("__"):
            continue
        module = import_module(".".join(("manoeuvre_nn", *words)))
        lines += [f"{'/'.join(words)} {name} = {said}" for name, said in declared_in(source, module)]
    return lines


def test_numbers_are_those_that_results_were_measured_with():
    now, table = numbers(), TABLE.read_text().splitlines()
    assert sorted(set(now) ^ set(table)) == []


if __name__ == "__main__":
    TABLE.write_text("\n".join(numbers()) + "\n")
