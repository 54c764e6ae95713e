"""Of many cases a few are run by default, the others with the slow tests: ``pytest -m slow``."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def mainly(count: int, cases: Iterable[Any]) -> list[Any]:
    """All cases, those after the first few as slow ones."""
    return [case if k < count else _slow(case) for k, case in enumerate(cases)]


def only(kept: Collection[Any], cases: Iterable[Any]) -> list[Any]:
    """All cases, those that are not kept as slow ones."""
    return [case if case in kept else _slow(case) for case in cases]


def _slow(case: Any) -> Any:
    if hasattr(case, "marks"):  # a pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.slow], id=case.id)
    several = isinstance(case, tuple) and len(case) > 1  # one value that is a tuple stands for itself
    return pytest.param(*(case if several else (case,)), marks=pytest.mark.slow)
