"""Formulas of what a piece of torch computes: it is run once, and every operation on inputs is written down."""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np
import sympy
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_map
from torch.utils.weak import WeakTensorKeyDictionary

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.formulas.program import Builder, arctan2, logistic

MAX_OPERATIONS = 12
"""Operations in a formula; a longer one is given a name and used by that."""
Element = Any
"""A formula, or a number."""
MOVING = frozenset(
    "alias cat clone constant_pad_nd detach diag_embed diagonal expand index_select permute reshape select slice split "
    "split_with_sizes squeeze stack t transpose unbind unsqueeze view _reshape_alias _to_copy _unsafe_view".split()
)
"""Operations that put values elsewhere and leave them as they are."""
FILLING = frozenset("empty_like full_like new_empty new_full new_ones new_zeros ones_like zeros_like".split())
"""Operations whose values do not depend on those that they are given."""


class Trace(TorchDispatchMode):
    """While it is active, results of operations on its variables are formulas in them.

    Attributes:
        build: What formulas are named with.
    """

    def __init__(self, build: Builder) -> None:
        """Begin without variables."""
        super().__init__()
        self.build, self._known, self._count = build, WeakTensorKeyDictionary(), 0

    def variable(self, example: Tensor, formulas: Sequence[Element]) -> Tensor:
        """A tensor that stands for formulas.

        Args:
            example: Its shape, and values by which branches of the code are taken.
            formulas: What its values are, a constant as a number.

        Returns:
            The tensor.
        """
        made = example.clone()
        self._known[made] = _objects(list(formulas)).reshape(tuple(made.shape))
        return made

    def formulas(self, tensor: Tensor) -> list[sympy.Expr]:
        """What the values of a tensor are, one after the other."""
        return [sympy.sympify(one) for one in self._values(tensor).flatten()]

    def __torch_dispatch__(self, func: Any, types: Any, args: tuple = (), kwargs: dict | None = None) -> Any:  # noqa: D105, PLW3201  # torch's name
        kwargs = kwargs or {}
        found = func(*args, **kwargs)
        name = func._schema.name.removeprefix("aten::")
        if name in FILLING or not any(self._is_variable(one) for one in _flat((args, kwargs))):
            return found
        settings = {key: value for key, value in kwargs.items() if value is not None}
        if name in MOVING:
            made = self._moved(func, args, kwargs)
        elif name in COMPUTED and set(settings) <= {"alpha", "min", "value"}:
            arrays = tree_map(lambda one: self._values(one) if isinstance(one, Tensor) else one, args)
            made = COMPUTED[name](self, *arrays, **settings)
        else:
            raise InputError(f"uses {name} of torch, which has no formula here")
        for tensor, values in zip(_flat(found), _flat(made), strict=True):
            self._known[tensor] = values
        return found

    def _is_variable(self, one: Any) -> bool:
        """Whether any value of a tensor is a formula; constants are computed, not written down."""
        known = self._known.get(one) if isinstance(one, Tensor) else None
        return known is not None and any(isinstance(value, sympy.Basic) for value in known.flat)

    def _values(self, tensor: Tensor) -> np.ndarray:
        """Formulas of a variable, or the numbers of a constant."""
        known = self._known.get(tensor)
        return _objects(tensor.flatten().tolist()).reshape(tuple(tensor.shape)) if known is None else known

    def _moved(self, func: Any, args: tuple, kwargs: dict) -> Any:
        """Where an operation puts values: it is done with their numbers instead."""
        store: list[np.ndarray] = [_objects([0.0])]
        count = 1

        def numbered(one: Any) -> Any:
            nonlocal count
            if not isinstance(one, Tensor) or not one.is_floating_point():
                return one  # a place, as in index_select
            store.append(self._values(one).flatten())
            count += one.numel()
            return torch.arange(count - one.numel(), count, dtype=torch.float64).reshape(one.shape)

        places = func(*tree_map(numbered, args), **kwargs)
        values = np.concatenate(store)
        return tree_map(lambda place: values[place.long().numpy()], places)

    def named(self, value: Element) -> Element:
        """A formula by a name of its own, unless it is a name or a number already."""
        if isinstance(value, float | bool) or value.is_Symbol:
            return value
        self._count += 1
        return self.build.let(f"t_{self._count}", value)

    def short(self, value: Any) -> Any:
        """A number as such, and a formula by a name where it is long."""
        if isinstance(value, sympy.Expr):
            if value.is_Number:
                return float(value)
            if value.count_ops() > MAX_OPERATIONS:
                return self.named(value)
        return value


def _flat(tree: Any) -> list[Any]:
    """Tensors or arrays of a nest of lists."""
    if isinstance(tree, dict):
        tree = list(tree.values())
    return [leaf for part in tree for leaf in _flat(part)] if isinstance(tree, list | tuple) else [tree]


def _objects(values: Sequence[Any]) -> np.ndarray:
    """Values as an array of objects."""
    made = np.empty(len(values), dtype=object)
    made[:] = values
    return made


def _each(rule: Callable[..., Any], *, named: bool = False) -> Callable[..., np.ndarray]:
    """An operation that is done to each value; with ``named`` what it is done to has a name or is a number."""

    def done(trace: Trace, *arrays: Any, **more: Any) -> np.ndarray:
        def one(*values: Any) -> Any:
            known = [float(v) if isinstance(v, int) and not isinstance(v, bool) else v for v in values]
            return trace.short(rule(*(trace.named(v) for v in known) if named else known, **more))

        return np.asarray(np.frompyfunc(one, len(arrays), 1)(*arrays), dtype=object)

    return done


def _sum(a: Element, b: Element, alpha: float = 1.0) -> Element:
    b = _product(b, float(alpha))
    return b if _is(a, 0.0) else a if _is(b, 0.0) else a + b


def _product(a: Element, b: Element) -> Element:
    if _is(a, 0.0) or _is(b, 0.0):
        return 0.0
    return b if _is(a, 1.0) else a if _is(b, 1.0) else a * b


def _power(a: Element, b: Element) -> Element:
    if isinstance(a, float) and isinstance(b, float):
        return a**b
    if isinstance(b, float):
        b = sympy.Rational(b) if (2 * b).is_integer() else sympy.Float(b)
    return sympy.sympify(a) ** b


def _is(a: Any, number: float) -> bool:
    return isinstance(a, float) and a == number


def _function(of_numbers: Callable[..., float], of_formulas: Callable[..., sympy.Expr]) -> Callable[..., Element]:
    """A function of mathematics, of numbers as a number."""
    return lambda *x: float(of_numbers(*x)) if all(isinstance(v, float) for v in x) else of_formulas(*x)


LARGER = _function(np.maximum, sympy.Max)


def _clamped(z: Element, min: float) -> Element:  # noqa: A002  # torch's name
    """The larger of a value and an end; no effect has an upper one."""
    return LARGER(z, float(min))


def _softplus(z: Element, beta: float = 1.0) -> Element:
    """``log(1 + exp(beta z)) / beta``, which does not overflow so."""
    if isinstance(z, float):
        return float(np.logaddexp(0.0, beta * z)) / beta
    rest = sympy.log(1 + sympy.exp(-sympy.Abs(_product(z, float(beta)))))
    return sympy.Max(z, sympy.Float(0.0)) + rest / float(beta)


def _norm(trace: Trace, a: np.ndarray, order: Any = 2, along: Any = None, keep: bool = False) -> np.ndarray:
    """Length of vectors that stand along the last dimension."""
    if order != 2 or along not in ([-1], [a.ndim - 1]):
        raise InputError("uses a norm of torch other than the length of rows, which has no formula here")
    squares = [trace.short(reduce(_sum, (_product(z, z) for z in map(trace.named, row)))) for row in _lines(a)]
    lengths = [_function(np.sqrt, sympy.sqrt)(trace.named(square)) for square in squares]
    return _objects(lengths).reshape(*a.shape[:-1], *([1] if keep else []))


def _matrix(trace: Trace, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A product of matrices, or of stacks of them."""
    rows, columns = np.broadcast_arrays(a[..., :, None, :], np.swapaxes(b, -1, -2)[..., None, :, :])
    made = [trace.short(reduce(_sum, map(_product, x, y))) for x, y in zip(*map(_lines, (rows, columns)), strict=True)]
    return _objects(made).reshape(rows.shape[:-1])


def _lines(stack: np.ndarray) -> np.ndarray:
    return stack.reshape(-1, stack.shape[-1])


COMPUTED: dict[str, Callable[..., Any]] = {
    "add": _each(_sum),
    "sub": _each(lambda a, b, alpha=1.0: _sum(a, b, -float(alpha))),
    "rsub": _each(lambda a, b, alpha=1.0: _sum(b, a, -float(alpha))),
    "mul": _each(_product),
    "div": _each(lambda a, b: _product(a, 1.0 / b)),
    "reciprocal": _each(lambda a: 1.0 / a),
    "neg": _each(lambda a: -a),
    "addcmul": _each(lambda a, b, c, value=1.0: _sum(a, _product(_product(b, c), float(value)))),
    "linalg_vector_norm": _norm,
    "pow": _each(_power),
    "sqrt": _each(_function(np.sqrt, sympy.sqrt), named=True),
    "sin": _each(_function(np.sin, sympy.sin), named=True),
    "cos": _each(_function(np.cos, sympy.cos), named=True),
    "tanh": _each(_function(np.tanh, sympy.tanh), named=True),
    "exp": _each(_function(np.exp, sympy.exp), named=True),
    "abs": _each(_function(np.abs, sympy.Abs), named=True),
    "sigmoid": _each(_function(lambda z: 0.5 + 0.5 * np.tanh(0.5 * z), logistic), named=True),
    "softplus": _each(_softplus, named=True),
    "relu": _each(lambda z: LARGER(z, 0.0), named=True),
    "atan2": _each(_function(np.arctan2, arctan2), named=True),
    "clamp": _each(_clamped, named=True),
    "mm": _matrix,
    "bmm": _matrix,
}
"""Operations of torch, and what they do to formulas."""
