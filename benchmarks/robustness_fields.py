"""Stored content changed field by field: every place in nested lists and dicts, and what is put there."""

import copy
from collections.abc import Iterator
from typing import Any

import torch

GONE = object()
"""Stands for a field that is taken away."""
SPOILT = (
    None, "x", -1, [], {}, float("nan"), True, {"a": 1}, [None], torch.zeros(2), 10**30, torch.tensor(torch.nan), GONE,
)  # fmt: skip
Place = tuple[Any, ...]
"""Keys and numbers that lead to a field."""


def places(value: Any, before: Place = ()) -> Iterator[Place]:
    """All fields of nested dicts and lists, outer ones before inner ones."""
    if before:
        yield before
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inner:
        yield from places(part, (*before, key))


def changed(content: dict[str, Any], place: Place, value: Any) -> dict[str, Any]:
    """A copy with another value in one field; :data:`GONE` takes it away."""
    made = copy.deepcopy(content)
    inner = made
    for key in place[:-1]:
        inner = inner[key]
    if value is GONE:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    return made
