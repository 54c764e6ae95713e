"""Cases of a test that are run by default, and those that are slow."""

import pytest
from tiers import mainly, only


def names(cases: list) -> list[str]:
    """Marks of each case."""
    return [" ".join(mark.name for mark in getattr(case, "marks", ())) for case in cases]


def test_the_first_few_are_run_by_default_and_none_is_lost():
    cases = mainly(1, ["a", ("b", 2), pytest.param("c", id="third", marks=pytest.mark.recordings)])
    assert cases[0] == "a" and names(cases) == ["", "slow", "recordings slow"]
    assert [case.values for case in cases[1:]] == [("b", 2), ("c",)] and cases[2].id == "third"
    assert mainly(0, [("wind",)])[0].values == (("wind",),), "a tuple of one is a value"


def test_those_that_are_kept_are_run_by_default_and_none_is_lost():
    cases = only({"b"}, ["a", "b", "c"])
    assert cases[1] == "b" and names(cases) == ["slow", "", "slow"]
