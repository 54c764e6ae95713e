"""The checks of shapes and types while tests run: what a function was checked with once is not checked again.

An annotation says something about an array's kind, type and shape and nothing about its numbers. To check it at each of
the thousands of calls of a simulation would take two thirds of the time, and to look whether it was checked already a
tenth: in each test the first calls of a function count. To make the checks of functions that no test calls would take
most of the time of an import.
"""

from collections.abc import Callable, Collection, Hashable
from functools import cache, wraps
from types import FunctionType
from typing import Any, get_args, get_type_hints

import jaxtyping
import numpy as np
import torch
from beartype import beartype
from jaxtyping import AbstractArray, config

REMEMBERED, LONG, CALLS = 100, 20, 100
"""Kinds of arguments that are remembered; length from which a collection is like no other; calls that count."""
test = 0
"""Number of the test that runs."""
complete = jaxtyping.jaxtyped


def checked(function: Callable) -> Callable:
    """The typechecker that jaxtyping is told to use."""
    return beartype(function)


def jaxtyped(fn: Any = None, **how: Any) -> Any:
    """What ``jaxtyping.jaxtyped`` makes of classes, which comes back here with their functions, and of functions."""
    if isinstance(fn, FunctionType):
        return _spared(fn)
    return complete(**how) if fn is None else complete(fn, **how)


def _spared(function: Callable) -> Callable:
    """The function with checks that are made at its first call."""
    checks, calls, within = cache(lambda: _checks(function)), 0, -1

    @wraps(function)
    def sparing(*args, **kwargs):
        nonlocal calls, within
        if within != test:
            calls, within = 0, test
        calls += 1
        if calls > CALLS or config.jaxtyping_disable:
            return function(*args, **kwargs)
        return checks()(*args, **kwargs)

    return sparing


def begin() -> None:
    """Count calls anew: another test begins."""
    global test
    test += 1


def _checks(function: Callable) -> Callable:
    """The function with its checks: without shapes, beartype's are as fast as looking what it was called with."""
    try:
        hints = get_type_hints(function)
    except (NameError, TypeError):  # names that are there for the type checker alone
        return complete(function, typechecker=checked)
    return _remembering(function) if any(map(_has_shapes, hints.values())) else checked(function)


def _remembering(function: Callable) -> Callable:
    """The function, checked when it is called with, or returns, what it was not called with before."""
    whole = complete(function, typechecker=checked)
    check_result = cache(lambda: _check_of_result(function))
    seen: dict[Hashable, set[Hashable]] = {}

    def remembering(*args, **kwargs):
        key = (*map(_kind, args), *kwargs, *map(_kind, kwargs.values()))
        if key not in seen:
            result = whole(*args, **kwargs)
            if len(seen) < REMEMBERED:
                seen[key] = {_kind(result)}
            return result
        result = function(*args, **kwargs)
        if (kind := _kind(result)) not in seen[key]:
            check_result()(result, args, kwargs)
            seen[key].add(kind)
        return result

    return remembering


def _check_of_result(function: Callable) -> Callable:
    """A check of a result beside the arguments that led to it: a function that returns what it is given, checked."""
    results = []

    def give(*_, **__):
        return results.pop()

    stub = FunctionType(give.__code__, function.__globals__, closure=give.__closure__)  # annotations are read in there
    check = complete(wraps(function)(stub), typechecker=checked)

    def check_result(result: Any, args: tuple, kwargs: dict) -> None:
        results.append(result)
        check(*args, **kwargs)

    return check_result


def _has_shapes(hint: object) -> bool:
    return (isinstance(hint, type) and issubclass(hint, AbstractArray)) or any(map(_has_shapes, get_args(hint)))


def _kind(value: Any) -> Hashable:
    """All that an annotation could say of a value; long collections and those of other kinds are like no other."""
    kind = type(value)
    sort = _sort(kind)
    if sort == "plain":
        return kind
    if sort == "array":
        return kind, value.dtype, value.shape
    if sort != "truth" and len(value) > LONG:
        return object()
    if sort == "sequence":
        return kind, *map(_kind, value)
    if sort == "table":
        return kind, *value, *map(_kind, value.values())
    return object() if sort == "others" else (kind, value)  # Literal


@cache
def _sort(kind: type) -> str:
    """What is looked at of values of a type: asked once a type, for to ask each value takes longer than all else."""
    sorts = {
        "array": (torch.Tensor, np.ndarray), "sequence": (tuple, list), "table": dict, "word": str, "truth": bool,
        "others": Collection,
    }  # fmt: skip
    return next((sort for sort, kinds in sorts.items() if issubclass(kind, kinds)), "plain")


# All functions of the package are decorated with it: this file is imported before any of them.
jaxtyping.jaxtyped = jaxtyping._decorator.jaxtyped = jaxtyped
