"""Slips of a physicist or a statistician, made in the syntax tree of a file: what :mod:`mutation` breaks."""

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMPARED = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
COMPUTED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
PAIRS = (
    "min max,minimum maximum,nanmin nanmax,argmin argmax,fmin fmax,any all,floor ceil,sin cos,sinh cosh,sum mean,"
    "std var,median mean,eigvalsh eigvals,prod sum,log log1p,exp expm1,cumsum cumprod,atan tan,arctan tan,sqrt square"
)
NAMES = {a: b for pair in PAIRS.split(",") for a, b in [pair.split(), pair.split()[::-1]]} | {"sum": "mean"}
"""Functions and methods, and what is written for them by mistake."""
DROPPED = frozenset("abs sqrt clip sorted reversed maximum minimum max min nan_to_num fabs exp log log1p".split())
"""Functions that may be forgotten: their first argument stays."""
EITHER_WAY = frozenset("isinstance hasattr max min maximum minimum hypot allclose logaddexp".split())
"""Functions whose arguments may change places, or end in an error at once."""
SKIPPED_FLAGS = frozenset(
    "strict keepdim keepdims frozen slots kw_only repr compare check exist_ok parents axis dim".split()
)
"""Keywords whose values decide nothing, or whose slips end in an error at once."""
SMALLEST = 1e-6
"""Smaller numbers keep a division from zero or bound a rounding error: not broken."""
OWNERS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


@dataclass(frozen=True)
class Mutant:
    """One slip.

    Attributes:
        file: Relative to the repository.
        kind: Of the slip.
        line: Where it is.
        lines: First and last line of the statement (of a compound one: of its head).
        before: What is written there.
        after: What the slip makes of it.
        inside: Function or class that it is in, with dots; empty in the module itself.
        imported: Whether it is computed when the module is imported.
        decision: Whether it is a threshold, a bound, a prior or a veto.
        number: Of equal slips of the same function.
        path: Of the node in the tree: fields and places in lists.
        node: What takes its place.
    """

    file: str
    kind: str
    line: int
    lines: tuple[int, int]
    before: str
    after: str
    inside: str
    imported: bool
    decision: bool
    number: int
    path: tuple[str | int, ...]
    node: ast.AST

    @cached_property
    def id(self) -> str:
        """Stays the same while other lines of the file change."""
        words = f"{self.file} {self.inside} {self.kind} {self.before} {self.after} {self.number}"
        return hashlib.sha1(words.encode()).hexdigest()[:8]

    def code(self) -> object:
        """The whole file with the slip in it, compiled."""
        path = ROOT / self.file
        tree = ast.parse(path.read_text())
        parent = tree
        for step in self.path[:-1]:
            parent = _at(parent, step)
        old = _at(parent, self.path[-1])
        new = copy.deepcopy(self.node)
        for inner in ast.walk(new):
            if not hasattr(inner, "lineno"):
                ast.copy_location(inner, old)
        if isinstance(self.path[-1], str):
            setattr(parent, self.path[-1], new)
        else:
            parent[self.path[-1]] = new  # type: ignore[index]
        return compile(ast.fix_missing_locations(tree), str(path), "exec", dont_inherit=True)


def _at(parent: object, step: str | int) -> ast.AST:
    """A child of a node or of a list of nodes."""
    return getattr(parent, step) if isinstance(step, str) else parent[step]  # type: ignore[index]


def mutants(file: str) -> list[Mutant]:
    """Every slip of a file, in the order of its lines."""
    return list(_File(file).found())


class _File:
    """Walk through a file's tree that knows where it is."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.tree = ast.parse((ROOT / file).read_text())
        self.seen: Counter[tuple[str, ...]] = Counter()

    def found(self) -> Iterator[Mutant]:
        """Slips of every node."""
        yield from self._walk(self.tree, (), [], self.tree)

    def _walk(self, node: ast.AST, path: tuple[str | int, ...], above: list[ast.AST], statement: ast.AST) -> Iterator:
        """Slips of a node and of what is in it."""
        if _passed_over(node, above):
            return
        if isinstance(node, ast.stmt):
            statement = node
        for kind, new in _slips(node, above):
            yield self._mutant(node, path, above, statement, (kind, new))
        for field, value in ast.iter_fields(node):
            if field in {"annotation", "returns", "decorator_list", "type_params", "type_comment", "bases"}:
                continue
            if isinstance(value, ast.AST):
                yield from self._walk(value, (*path, field), [*above, node], statement)
            elif isinstance(value, list):
                for k, item in enumerate(value):
                    if isinstance(item, ast.AST) and not (k == 0 and _is_docstring(item)):
                        yield from self._walk(item, (*path, field, k), [*above, node], statement)

    def _mutant(self, node: ast.AST, path: tuple, above: list, statement: ast.AST, slip: tuple[str, ast.AST]) -> Mutant:
        """The slip with its place and its words."""
        kind, new = slip
        shown = node if isinstance(node, ast.expr) else getattr(node, "test", node)
        context = above[-1] if isinstance(node, ast.Constant) and isinstance(above[-1], ast.expr) else shown
        before, after = _text(context), _text(new)
        if context is not shown:
            before, after = f"{_text(shown)} in {before}", after
        inside = ".".join(n.name for n in above if isinstance(n, OWNERS))
        key = (inside, kind, before, after)
        self.seen[key] += 1
        function = next((k for k, n in enumerate(above) if isinstance(n, ast.FunctionDef | ast.Lambda)), None)
        imported = function is None or isinstance((*above, node)[function + 1], ast.arguments)  # defaults
        decides = _decides(kind, node, function is not None, statement)
        line = getattr(node, "lineno", statement.lineno)  # type: ignore[attr-defined]
        lines = _head(statement)
        words = (before, after, inside, imported, decides, self.seen[key])
        return Mutant(self.file, kind, line, lines, *words, path, new)


def _head(statement: ast.AST) -> tuple[int, int]:
    """First and last line of a statement without what stands indented below it; of a function, of its body."""
    first, last = statement.lineno, statement.end_lineno  # type: ignore[attr-defined]
    body = getattr(statement, "body", None)
    if not body:
        return first, last
    return (body[0].lineno, last) if isinstance(statement, OWNERS) else (first, max(first, body[0].lineno - 1))


def _text(node: ast.AST) -> str:
    """Source of a node in one line."""
    text = " ".join(ast.unparse(node).split())
    return text if len(text) < 90 else f"{text[:60]} ... {text[-25:]}"


def _is_docstring(node: ast.AST) -> bool:
    """Whether a statement is a string alone."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _passed_over(node: ast.AST, above: list[ast.AST]) -> bool:
    """Messages, assertions, texts and types: nothing is decided there."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom) or _is_docstring(node):
        return True
    if isinstance(node, ast.FunctionDef) and node.name in {"__repr__", "__str__"}:
        return True
    if isinstance(node, ast.Call):
        called = ast.unparse(node.func)
        return called.split(".")[0] in {"log", "logging", "warnings", "print", "cast", "TypeVar", "field_validator"}
    module_level = not any(isinstance(n, OWNERS) for n in above)
    if module_level and isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript | ast.BinOp):
        return "|" in ast.unparse(node.value) or ast.unparse(node.value).startswith(("Callable", "Float", "Mapping"))
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _decides(kind: str, node: ast.AST, in_function: bool, statement: ast.AST) -> bool:
    """Whether a slip changes a constant of the module, a declared bound or prior, a comparison with one, or a veto."""
    if kind == "veto":
        return True
    if in_function:
        names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        return kind == "comparison" and any(n.strip("_").isupper() and len(n) > 2 for n in names)
    return kind in {"number", "sign"} and isinstance(statement, ast.Assign | ast.AnnAssign)


def _slips(node: ast.AST, above: list[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
    """What may be written by mistake for a node: kind and replacement."""
    match node:
        case ast.Constant():
            yield from _numbers(node, above)
        case ast.Compare():
            for k, op in enumerate(node.ops):
                for other in COMPARED[type(op)]:
                    ops = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                    yield "comparison", ast.Compare(node.left, ops, node.comparators)
        case ast.BinOp():
            yield from _sums(node)
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert()):
            if not (isinstance(node.operand, ast.Constant) and _is_index(above[-1], node)):
                yield ("sign" if isinstance(node.op, ast.USub) else "logic"), node.operand
        case ast.BoolOp():
            other_op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield "logic", ast.BoolOp(other_op, node.values)
            for k in range(len(node.values)):
                left = [v for n, v in enumerate(node.values) if n != k]
                yield "condition", left[0] if len(left) == 1 else ast.BoolOp(node.op, left)
        case ast.If():
            yield from _branches(node)
        case ast.IfExp():
            yield "branch", node.body
            yield "branch", node.orelse
        case ast.comprehension(ifs=[_, *_]):
            for k in range(len(node.ifs)):
                ifs = [v for n, v in enumerate(node.ifs) if n != k]
                yield "condition", ast.comprehension(node.target, node.iter, ifs, node.is_async)
        case ast.AugAssign(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div()) if not _is_text(node.value):
            yield "arithmetic", ast.AugAssign(node.target, COMPUTED[type(node.op)](), node.value)
        case ast.Return(value=ast.expr()) if not isinstance(node.value, ast.Constant):
            functions = [n for n in above if isinstance(n, ast.FunctionDef)]
            if functions and functions[-1].returns is not None and "None" in ast.unparse(functions[-1].returns):
                yield "none", ast.Return(ast.Constant(None))
        case ast.Call():
            yield from _calls(node)


def _numbers(node: ast.Constant, above: list[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
    """A number off by a tenth, by a factor of two, by one; a switch the other way."""
    value, parent = node.value, above[-1]
    if isinstance(parent, ast.keyword) and parent.arg in SKIPPED_FLAGS:
        return
    if isinstance(value, bool):
        yield "flag", ast.Constant(not value)
    elif isinstance(value, int):
        index = _is_index(parent, node) or (isinstance(parent, ast.UnaryOp) and _is_index(above[-2], parent))
        yield ("index" if index else "number"), ast.Constant(value + 1)
        if not index and value > 1:
            yield "number", ast.Constant(value - 1)
    elif isinstance(value, float) and not 0 < abs(value) < SMALLEST:
        yield "number", ast.Constant(value * 1.1 if value else 0.1)
        if value:
            yield "number", ast.Constant(value * 2.0)


def _is_index(parent: ast.AST, node: ast.AST) -> bool:
    """Whether a node says which place of a sequence is taken."""
    return isinstance(parent, ast.Slice) or (isinstance(parent, ast.Subscript) and parent.slice is node)


def _is_text(node: ast.AST) -> bool:
    """Whether a node is a text or a sequence, which are joined by a plus as well."""
    return isinstance(node, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    )


def _sums(node: ast.BinOp) -> Iterator[tuple[str, ast.AST]]:
    """Another sign or operation, and a term left out."""
    if _is_text(node.left) or _is_text(node.right) or type(node.op) not in COMPUTED:
        return
    yield "arithmetic", ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    if isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
        yield "term", node.left
    if isinstance(node.op, ast.Add | ast.Mult):
        yield "term", node.right


def _branches(node: ast.If) -> Iterator[tuple[str, ast.AST]]:
    """A way out of a function or loop that is never taken, or always; any other condition that never holds."""
    leaves = isinstance(node.body[-1], ast.Return | ast.Continue | ast.Break)
    yield ("veto" if leaves else "branch"), _If(ast.Constant(False), node)
    if leaves:
        yield "veto", _If(ast.Constant(True), node)


def _If(test: ast.expr, node: ast.If) -> ast.If:  # noqa: N802
    """The statement with another test."""
    return ast.If(test, node.body, node.orelse)


def _calls(node: ast.Call) -> Iterator[tuple[str, ast.AST]]:
    """A function for another, a function forgotten, two arguments swapped."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if other := NAMES.get(name):
        if isinstance(node.func, ast.Attribute):
            yield "function", ast.Call(ast.Attribute(node.func.value, other, ast.Load()), node.args, node.keywords)
        elif name != "sum":
            yield "function", ast.Call(ast.Name(other, ast.Load()), node.args, node.keywords)
    if name in DROPPED and node.args and not isinstance(node.args[0], ast.Starred | ast.GeneratorExp):
        yield "function", node.args[0]
    if len(node.args) >= 2 and all(isinstance(a, ast.Name | ast.Attribute) for a in node.args[:2]):
        first, second, *others = node.args
        if ast.unparse(first) != ast.unparse(second) and name not in EITHER_WAY:
            yield "arguments", ast.Call(node.func, [second, first, *others], node.keywords)
