"""Lines whose tests can tell a slip: its own, or, of what is computed on import, those of the functions that use it."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache

from mutation_source import OWNERS, ROOT, Mutant

DEEPEST = 3
"""Constants of constants that are followed."""


def lines_of(mutant: Mutant) -> set[tuple[str, int]]:
    """File and number of the lines whose tests are asked."""
    first, last = mutant.lines
    own = {(mutant.file, line) for line in range(first, last + 1)}
    functions = {line for file, line in _function_lines() if file == mutant.file}
    if not mutant.imported or any(line in functions for _, line in own):
        return own
    names, found = _names_at(mutant), set()
    for _ in range(DEEPEST):
        found |= {place for name in names for place in _uses()[name]}
        names = {n for name in names for n in _constants().get((mutant.file, name), ())}
    return found & _function_lines() or {(mutant.file, line) for line in functions}


def _names_at(mutant: Mutant) -> set[str]:
    """Names that a statement of a module or class gives a value, with the class's."""
    tree, names = _tree(mutant.file), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.lineno <= mutant.line <= (node.end_lineno or 0):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}
    if mutant.inside:
        names.add(mutant.inside.split(".")[0])
    return names


@cache
def _tree(file: str) -> ast.Module:
    return ast.parse((ROOT / file).read_text())


@cache
def _files() -> tuple[str, ...]:
    """Of package, studies and tests: a test that reads a constant by its name may execute no line beside it."""
    paths = [path for folder in ("src", "studies", "tests") for path in sorted((ROOT / folder).rglob("*.py"))]
    return tuple(str(path.relative_to(ROOT)) for path in paths)


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    yield from (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))


@cache
def _function_lines() -> frozenset[tuple[str, int]]:
    """Lines that are in the body of a function."""
    found = set()
    for file in _files():
        for function in _functions(_tree(file)):
            found |= {(file, line) for line in range(function.body[0].lineno, (function.end_lineno or 0) + 1)}
    return frozenset(found)


@cache
def _uses() -> dict[str, set[tuple[str, int]]]:
    """Name -> lines in functions where it is read, as a name or an attribute; of a class, its methods as well."""
    found: dict[str, set[tuple[str, int]]] = defaultdict(set)
    for file in _files():
        imported = [alias for n in _tree(file).body if isinstance(n, ast.ImportFrom) for alias in n.names]
        elsewhere = {alias.asname: alias.name for alias in imported if alias.asname}
        for node in ast.walk(_tree(file)):
            if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
                name = node.id if isinstance(node, ast.Name) else node.attr
                found[elsewhere.get(name, name)].add((file, node.lineno))
            elif isinstance(node, ast.Constant) and file.startswith("tests/"):
                for name in _constants_named(node.value, file):
                    found[name] |= _around(file, node.lineno)
            elif isinstance(node, ast.FunctionDef):  # what its defaults and cases are made of acts in its body
                given = [*node.args.defaults, *filter(None, node.args.kw_defaults), *node.decorator_list]
                for name in (n.id for d in given for n in ast.walk(d) if isinstance(n, ast.Name)):
                    lines = range(node.body[0].lineno, (node.end_lineno or 0) + 1)
                    found[name] |= {(file, line) for line in lines}
            elif isinstance(node, ast.ClassDef):
                for function in _functions(node):
                    lines = range(function.body[0].lineno, (function.end_lineno or 0) + 1)
                    found[node.name] |= {(file, line) for line in lines}
    return found


def _constants_named(value: object, file: str) -> list[str]:
    """The constant that a word of a test names, or those that a table beside it lists."""
    if not isinstance(value, str):
        return []
    table = (ROOT / file).with_name(value) if value.endswith(".txt") and "/" not in value else None
    words = re.findall(r"\w+", table.read_text()) if table and table.is_file() else [value]
    return [word for word in words if word.isidentifier() and word.isupper() and len(word) > 2]


def _around(file: str, line: int) -> set[tuple[str, int]]:
    """Lines of the function that a line is in; of all functions of the file if it is in none."""
    bodies = [range(f.body[0].lineno, (f.end_lineno or 0) + 1) for f in _functions(_tree(file))]
    return {(file, k) for body in ([b for b in bodies if line in b] or bodies) for k in body}


@cache
def _constants() -> dict[tuple[str, str], set[str]]:
    """File and name -> names of module or class whose values are computed from it."""
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    for file in _files():
        for node in _tree(file).body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}
                for read in (n for n in ast.walk(node.value) if isinstance(n, ast.Name)):
                    found[file, read.id] |= names
            elif isinstance(node, OWNERS):
                for read in (n for s in node.body for n in ast.walk(s) if isinstance(n, ast.Name)):
                    found[file, read.id].add(node.name)
    return found
