"""The checks of shapes and types while tests run: what a function was checked with once is not checked again.

An annotation says something about an array's kind, type and shape and nothing about its numbers. To check it at each of
the thousands of calls of a simulation would take two thirds of the time.
"""

from collections.abc import Callable, Collection, Hashable
from typing import get_args

import numpy as np
import torch
from beartype import beartype
from jaxtyping import AbstractArray

REMEMBERED, LONG = 100, 20


def checked(function: Callable) -> Callable:
    """Beartype for ``jaxtyped``, which calls it on two stubs of each function: of arguments, and of the result too."""
    check = beartype(function)
    if not any(map(_has_shapes, function.__annotations__.values())):
        return check  # as fast as looking what it was called with
    seen: set[Hashable] = set()

    def sparing(*args, **kwargs) -> None:
        key = (*map(_kind, args), *kwargs, *map(_kind, kwargs.values()))
        if key not in seen:
            check(*args, **kwargs)
            if len(seen) < REMEMBERED:
                seen.add(key)

    return sparing


def _has_shapes(hint: object) -> bool:
    return (isinstance(hint, type) and issubclass(hint, AbstractArray)) or any(map(_has_shapes, get_args(hint)))


def _kind(value: object) -> Hashable:
    """All that an annotation could say of a value; long collections and those of other kinds are like no other."""
    kind = type(value)
    if isinstance(value, torch.Tensor | np.ndarray):
        return kind, value.dtype, value.shape
    if isinstance(value, Collection) and len(value) > LONG:
        return object()
    if isinstance(value, tuple | list):
        return kind, *map(_kind, value)
    if isinstance(value, dict):
        return kind, *value, *map(_kind, value.values())
    if isinstance(value, str | bool):
        return kind, value  # Literal
    return object() if isinstance(value, Collection) else kind
