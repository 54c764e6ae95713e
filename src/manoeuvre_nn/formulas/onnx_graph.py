"""Programs as ONNX graphs in double precision: the rates of a ship's state, or the outputs of a response."""

import json
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
import sympy

from manoeuvre_nn import __version__
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.formulas.program import (
    Each,
    Program,
    Quantity,
    Single,
    Step,
    Weighted,
    arctan2,
    logistic,
    median,
    smallest,
)
from manoeuvre_nn.formulas.state import parameters_of, rate_of, state_of

try:
    import onnx
    from onnx import TensorProto, checker, helper, numpy_helper
except ImportError:  # an extra
    onnx = None  # type: ignore[assignment]

OPSET, IR_VERSION = 17, 8
"""Versions that runtimes since 2022 know."""
UNARY = {
    sympy.tanh: "Tanh", sympy.cos: "Cos", sympy.sin: "Sin", sympy.exp: "Exp", sympy.log: "Log", sympy.Abs: "Abs",
}  # fmt: skip
AXES = (
    "x north, y east, z down; body axes forward, to starboard; psi clockwise from north; delta > 0 turns to starboard"
)
INSTALL = "pip install 'manoeuvre-nn[onnx]'"


def onnx_bytes(program: Program) -> bytes:
    """A graph of a program.

    Of a ship: ``state`` (rows, states), ``inputs`` (rows, inputs) and, where effects have some, ``parameters`` (rows,
    parameters) to ``rates`` (rows, states). Of a response: ``inputs`` (rows, variables) to ``outputs`` (rows, 1). Which
    column is what, with unit and sign, stands in the metadata.

    Args:
        program: The program.

    Returns:
        The file.

    Raises:
        InputError: If the package onnx is not installed.
    """
    if onnx is None:
        raise InputError(f"format=onnx needs the packages onnx and onnxruntime: {INSTALL}")
    given = tables(program)
    graph = _Graph(next(iter(given)))
    for name, columns in given.items():
        for k, q in enumerate(columns):
            graph.bind(q.name, graph.columns(name, [k]))
    for section in program.sections:
        for step in section.steps:
            graph.step(step)
    made, outputs = [graph.known[sympy.Symbol(q.name, real=True)] for q in program.outputs], program.outputs
    if program.gives_rates:
        states = given["state"]
        outputs = [rate_of(q) for q in states]
        made = [graph.value(formula) for formula in _rates(program, states)]
    whole = "rates" if program.gives_rates else "outputs"
    graph.nodes.append(helper.make_node("Concat", [graph.in_all_rows(one) for one in made], [whole], axis=1))
    return _model(program, graph, given, (whole, outputs))


def tables(program: Program) -> dict[str, list[Quantity]]:
    """Tables that a graph takes, and their columns."""
    if not program.gives_rates:
        return {"inputs": list(program.inputs)}
    states, parameters = state_of(program), parameters_of(program)
    own = {q.name for q in (*states, *parameters)}
    found = {"state": states, "inputs": [q for q in program.inputs if q.name not in own]}
    return {**found, "parameters": parameters} if parameters else found


def _rates(program: Program, states: Sequence[Quantity]) -> list[sympy.Expr]:
    """Rates of u, v, r, x, y, psi and the own states, from the outputs and the kinematics."""
    at = {name: sympy.Symbol(name, real=True) for name in ("u", "v", "r", "psi")}
    names = {q.name for q in program.outputs}
    north, east = (sympy.Symbol(n, real=True) if n in names else sympy.Integer(0) for n in ("c_N", "c_E"))
    cos, sin = sympy.cos(at["psi"]), sympy.sin(at["psi"])
    kinematic = {
        "xdot": at["u"] * cos - at["v"] * sin + north,
        "ydot": at["u"] * sin + at["v"] * cos + east,
        "psidot": at["r"],
    }
    return [kinematic.get(f"{q.name}dot", sympy.Symbol(f"{q.name}dot", real=True)) for q in states]


def _model(
    program: Program, graph: "_Graph", given: Mapping[str, Sequence[Quantity]], result: tuple[str, Sequence[Quantity]]
) -> bytes:
    """The file: the graph, what its columns are, and where it is from."""
    whole, outputs = result
    taken = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, ["rows", len(qs)]) for n, qs in given.items()]
    made = helper.make_tensor_value_info(whole, TensorProto.DOUBLE, ["rows", len(outputs)])
    title = harmless(program.title)
    built = helper.make_graph(graph.nodes, program.name, taken, [made], graph.constants, doc_string=title)
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(built, opset_imports=opset, producer_name="manoeuvre-nn", producer_version=__version__)
    model.ir_version, model.doc_string = IR_VERSION, "\n".join(harmless(n) for n in (program.title, *program.notes))
    helper.set_model_props(model, {
        **{name: json.dumps(_described(columns)) for name, columns in given.items()},
        whole: json.dumps([{"name": q.name, "unit": q.unit, "meaning": harmless(q.meaning)} for q in outputs]),
        **({"axes": AXES} if program.gives_rates else {}),
    })  # fmt: skip
    checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)


def _described(columns: Sequence[Quantity]) -> list[dict[str, Any]]:
    """What the columns of an input are."""
    return [
        {
            "name": q.name,
            "unit": q.unit,
            "meaning": harmless(q.meaning),
            "low": q.low,
            "high": q.high,
            "usual": q.example,
        }
        for q in columns
    ]


class _Graph:
    """Nodes and constants as they come about; every value is a column for each row, or several side by side.

    Attributes:
        nodes: What is done.
        constants: Tables of numbers.
        known: Formula -> name of the value in the graph.
        places: Symbol -> the value that it is a column of, and which.
    """

    def __init__(self, given: str) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.known: dict[sympy.Expr, str] = {}
        self.places: dict[sympy.Symbol, tuple[str, int]] = {}
        self._constants: dict[bytes, str] = {}
        self._same: set[str] = set()  # values that are one for all rows
        count = self.add("Gather", self.add("Shape", given), self.constant(np.array([0])), axis=0)
        self._rows = self.add("Concat", count, self.constant(np.array([1])), axis=0)

    def add(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """A node; the name of what it gives."""
        name = f"v{len(self.nodes) + 1}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        if self._same.issuperset(inputs):
            self._same.add(name)
        return name

    def constant(self, values: np.ndarray) -> str:
        """A table of numbers; its name."""
        key = str(values.dtype).encode() + str(values.shape).encode() + values.tobytes()
        if key not in self._constants:
            self._constants[key] = f"c{len(self._constants) + 1}"
            self.constants.append(numpy_helper.from_array(values, self._constants[key]))
            self._same.add(self._constants[key])
        return self._constants[key]

    def in_all_rows(self, value: str) -> str:
        """A value that is the same in all rows, as a column of them; another one as it is."""
        return self.add("Expand", value, self._rows) if value in self._same else value

    def bind(self, name: str, value: str) -> None:
        """A name of the program for a value."""
        self.known[sympy.Symbol(name, real=True)] = value

    def columns(self, whole: str, places: Sequence[int]) -> str:
        """Some columns of a value."""
        return self.add("Gather", whole, self.constant(np.array(places)), axis=1)

    def step(self, step: Step) -> None:
        """The nodes of a step."""
        if isinstance(step, Single):
            self.known[step.target] = self.value(step.formula)
            return
        if isinstance(step, Each):
            self._share(step.targets, self._applied(step.formula, self.together(step.sources)))
            return
        total = self._distances(step) if step.distance else self._weighted(step)
        if step.factors is not None:
            total = self.add("Mul", total, self.constant(step.factors[None]))
        self._share(step.targets, total if step.outer is None else self._applied(step.outer, total))

    def _share(self, targets: Sequence[sympy.Symbol], whole: str) -> None:
        """Columns of a value by their names."""
        if len(targets) == 1:
            self.known[targets[0]] = whole
            return
        self.places |= {target: (whole, k) for k, target in enumerate(targets)}

    def _applied(self, formula: Any, whole: str) -> str:
        """A formula of one other value, done to all columns at once."""
        dummy = sympy.Dummy(real=True)
        self.known[dummy] = whole
        return self.value(formula(dummy))

    def together(self, values: Sequence[sympy.Expr]) -> str:
        """Values side by side."""
        places = [self.places.get(z) for z in values]
        wholes = {place[0] for place in places if place}
        if len(wholes) == 1 and all(places):
            return self.columns(wholes.pop(), [place[1] for place in places if place])
        parts = [self.in_all_rows(self.value(z)) for z in values]
        return parts[0] if len(parts) == 1 else self.add("Concat", *parts, axis=1)

    def _distances(self, step: Weighted) -> str:
        """``sum_j (z_j - a_ij)^2``."""
        row = self.add("Unsqueeze", self.together(step.inputs), self.constant(np.array([1])))
        apart = self.add("Sub", row, self.constant(step.numbers[None]))
        return self.add("ReduceSum", self.add("Mul", apart, apart), self.constant(np.array([2])), keepdims=0)

    def _weighted(self, step: Weighted) -> str:
        """``sum_j a_ij z_j`` as products of matrices: terms of one value and one common factor together."""
        groups: dict[tuple[str, sympy.Expr], list[tuple[int, np.ndarray]]] = {}
        alone: list[tuple[sympy.Expr, np.ndarray]] = []
        always = np.zeros(len(step.targets))
        for z, weights in zip(step.inputs, step.numbers.T, strict=True):
            for term in sympy.Add.make_args(sympy.expand(z) if z.is_Add or z.is_Mul else z):
                number, rest = term.as_coeff_Mul()
                own = weights * float(number)
                parts = sympy.Mul.make_args(rest)
                column = next((part for part in parts if part in self.places), None)
                if rest == 1:
                    always = always + own
                elif column is None:
                    alone.append((rest, own))
                else:
                    whole, place = self.places[column]
                    factor = sympy.Mul(*(part for part in parts if part != column))
                    groups.setdefault((whole, factor), []).append((place, own))
        sums = [self._product(whole, factor, members) for (whole, factor), members in groups.items()]
        if alone:
            side = self.together([z for z, _ in alone])
            sums.append(self.add("MatMul", side, self.constant(np.stack([own for _, own in alone]))))
        if always.any() or not sums:
            sums.append(self.constant(always[None]))
        return reduce(lambda a, b: self.add("Add", a, b), sums)

    def _product(self, whole: str, factor: sympy.Expr, members: Sequence[tuple[int, np.ndarray]]) -> str:
        """Columns of one value times numbers, times a common factor."""
        places = sorted({place for place, _ in members})
        numbers = np.zeros((len(places), len(members[0][1])))
        for place, own in members:
            numbers[places.index(place)] += own
        total = self.add("MatMul", self.columns(whole, places), self.constant(numbers))
        return total if factor == 1 else self.add("Mul", total, self.value(factor))

    def value(self, formula: sympy.Expr) -> str:
        """The value of a formula; the same formula is computed once."""
        if formula not in self.known:
            self.known[formula] = self._computed(formula)
        return self.known[formula]

    def _computed(self, formula: sympy.Expr) -> str:
        if formula in self.places:
            whole, place = self.places[formula]
            return self.columns(whole, [place])
        if formula.is_number:
            return self.constant(np.array([[float(formula)]]))
        if isinstance(formula, sympy.Pow):
            return self._power(*formula.as_base_exp())
        if isinstance(formula, sympy.exp):
            return self.add("Exp", self.value(formula.args[0]))
        if isinstance(formula, median):
            return self._median(formula.args)
        if isinstance(formula, smallest):
            return self.add("ReduceMin", self.together(formula.args), axes=[1], keepdims=1)
        if isinstance(formula, arctan2):
            return self._angle(*formula.args)
        parts = [self.value(part) for part in formula.args]
        if isinstance(formula, logistic):
            return self.add("Sigmoid", *parts)
        if isinstance(formula, sympy.Add | sympy.Mul):
            kind = "Add" if formula.is_Add else "Mul"
            return reduce(lambda a, b: self.add(kind, a, b), parts)
        if isinstance(formula, sympy.Max | sympy.Min):
            return self.add(type(formula).__name__, *parts)
        return self.add(UNARY[formula.func], *parts)

    def _power(self, base: sympy.Expr, power: sympy.Expr) -> str:
        value = self.value(base)
        if power.is_Integer and abs(int(power)) <= 4:
            value = reduce(lambda a, b: self.add("Mul", a, b), [value] * abs(int(power)))
        elif abs(power) == sympy.Rational(1, 2):
            value = self.add("Sqrt", value)
        else:
            return self.add("Pow", value, self.value(power))
        return value if power > 0 else self.add("Reciprocal", value)

    def _median(self, values: Sequence[sympy.Expr]) -> str:
        """The value in the middle, of an even number the mean of the two there."""
        count = len(values)
        ordered, places = f"v{len(self.nodes) + 1}_sorted", f"v{len(self.nodes) + 1}_places"
        side = self.together(values)
        size = self.constant(np.array([count]))
        self.nodes.append(helper.make_node("TopK", [side, size], [ordered, places], axis=1, largest=0, sorted=1))
        low, high = (self.columns(ordered, [k]) for k in ((count - 1) // 2, count // 2))
        return self.add("Mul", self.add("Add", low, high), self.constant(np.array([[0.5]])))

    def _angle(self, y: sympy.Expr, x: sympy.Expr) -> str:
        """The angle of (x, y): runtimes know the arc tangent in single precision only, which one step corrects.

        ``a + sin(b - a)`` with the angle b and its approximation a is b to (b - a)^3/6, here 1e-20.

        Returns:
            The angle [rad].
        """
        rise, run = self.value(y), self.value(x)
        radius = self.add("Sqrt", self.add("Add", self.add("Mul", rise, rise), self.add("Mul", run, run)))
        half = self.add("Div", rise, self.add("Add", radius, run))  # tan(b/2), b not pi
        arc = self.add("Atan", self.add("Cast", half, to=TensorProto.FLOAT))
        single = self.add("Mul", self.add("Cast", arc, to=TensorProto.DOUBLE), self.constant(np.array([[2.0]])))
        sin, cos = self.add("Sin", single), self.add("Cos", single)
        error = self.add("Sub", self.add("Mul", rise, cos), self.add("Mul", run, sin))
        return self.add("Add", single, self.add("Div", error, radius))
