"""Tests run in several processes: one thread each, and in each of them shapes are checked."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sparing
import torch
from beartype.roar import BeartypeCallHintViolation
from fleet import unchecked
from jaxtyping import Float, TypeCheckError, jaxtyped
from threadpoolctl import threadpool_info

from manoeuvre_nn.core.frames import kinematics


def test_a_process_computes_with_one_thread():
    assert os.environ["OMP_NUM_THREADS"] == "1" and torch.get_num_threads() == 1
    assert {pool["num_threads"] for pool in threadpool_info()} == {1}


def test_shapes_and_types_are_checked():
    with pytest.raises(TypeCheckError):
        kinematics("1")


@jaxtyped(typechecker=sparing.checked)
def product(
    a: Float[torch.Tensor, " n"], b: Float[torch.Tensor, " n"] | Float[np.ndarray, " n"], more: tuple[Path, ...] = ()
) -> Float[torch.Tensor, " n"]:
    return torch.cat([a * b, torch.zeros(int(a[0]))])


def test_what_was_checked_once_is_refused_all_the_same_where_shape_type_or_result_differ():
    one, two = torch.ones(3), torch.zeros(3)
    for _ in range(2):
        assert product(two, two).shape == (3,)
        assert product(two, two, more=(Path(),)).shape == (3,)
        for wrong in ((two, torch.zeros(4)), (two, two.long()), (two, two.numpy().astype(int)), (two, "b")):
            with pytest.raises(TypeCheckError, match="parameters"):
                product(*wrong)
        with pytest.raises(TypeCheckError, match="parameters"):
            product(two, two, more=("a",))
        with pytest.raises(TypeCheckError, match="return value"):
            product(one, two)


def test_arguments_of_kinds_that_were_seen_are_not_checked_again(monkeypatch):
    checks = []
    monkeypatch.setattr(sparing, "beartype", lambda function: lambda *args, **kwargs: checks.append((args, kwargs)))

    @jaxtyped(typechecker=sparing.checked)
    def scaled(a: Float[torch.Tensor, " n"], by: float): ...

    for a, by in ((torch.zeros(2), 1.0), (torch.ones(2), 2.0), (torch.ones(3), 2.0), (torch.ones(2), 2)):
        scaled(a, by)
    assert [(len(a), by) for (a, by), _ in checks] == [(2, 1.0), (3, 2.0), (2, 2)]


def test_of_thousands_of_calls_the_first_are_checked_in_every_test():
    def fails() -> bool:
        try:
            product(torch.zeros(2), torch.zeros(3).long())
        except TypeCheckError:
            return True
        except RuntimeError:  # what torch says of it
            return False
        return False

    sparing.begin()
    assert [fails() for _ in range(sparing.CALLS + 2)] == [True] * sparing.CALLS + [False] * 2
    sparing.begin()
    assert fails()


def test_a_function_without_shapes_is_checked_at_each_call_in_arguments_and_result():
    @jaxtyped(typechecker=sparing.checked)
    def named(number: int, name: str = "a") -> str | None:
        return name * number if number else number

    assert named(2) == "aa" and named(1, name="b") == "b"
    for wrong in ((1.5,), (2, 3)):
        with pytest.raises(BeartypeCallHintViolation, match="parameter"):
            named(*wrong)
    with pytest.raises(BeartypeCallHintViolation, match="return"):
        named(0)
    with unchecked():
        assert named(0) == 0


def test_one_file_is_tested_in_one_process_and_all_in_two(pytestconfig):
    hook = pytestconfig.hook.pytest_xdist_auto_num_workers
    before, two = pytestconfig.args, min(2, os.cpu_count() or 1)
    wanted = {("tests/a.py::b", "tests/a.py::c"): 0, ("tests",): two, ("tests/a.py", "tests/b.py"): two}
    try:
        for args, count in wanted.items():
            pytestconfig.args = list(args)
            assert hook(config=pytestconfig) == count
    finally:
        pytestconfig.args = before


def test_the_longest_file_is_begun_first(pytestconfig):
    ours = pytestconfig.pluginmanager.get_plugin(str(Path(__file__).parent / "conftest.py"))
    longest = next(Path(__file__).parent.rglob("test_concealed_cases.py")).name
    items = [SimpleNamespace(path=Path(name)) for name in ("test_a.py", "test_b.py", longest, longest, "test_c.py")]
    ours.pytest_collection_modifyitems(items)
    assert [i.path.name for i in items] == [longest, longest, "test_a.py", "test_b.py", "test_c.py"]
