"""Tests run in several processes: one thread each, and in each of them shapes are checked."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from jaxtyping import TypeCheckError
from threadpoolctl import threadpool_info

from manoeuvre_nn.core.frames import body_to_earth


def test_a_process_computes_with_one_thread():
    assert os.environ["OMP_NUM_THREADS"] == "1" and torch.get_num_threads() == 1
    assert {pool["num_threads"] for pool in threadpool_info()} == {1}


def test_shapes_and_types_are_checked():
    with pytest.raises(TypeCheckError):
        body_to_earth("1", "2", "3")


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
    longest = next(Path(__file__).parent.rglob("test_four_concealed_cases.py")).name
    items = [SimpleNamespace(path=Path(name)) for name in ("test_a.py", "test_b.py", longest, longest, "test_c.py")]
    ours.pytest_collection_modifyitems(items)
    assert [i.path.name for i in items] == [longest, longest, "test_a.py", "test_b.py", "test_c.py"]
