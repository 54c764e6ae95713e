"""Puts this folder on the import path, so that tests share fleet.py; one thread a process, a process a core."""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # the processes that share out the tests start with it

import pytest
import torch
from threadpoolctl import threadpool_limits

torch.set_num_threads(1)
threadpool_limits(1)  # where numpy was loaded before this file


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process for one file, whose start takes longer than its tests; otherwise one for each of two cores."""
    files = {name.split("::")[0] for name in config.args}
    return 0 if len(files) == 1 and files.pop().endswith(".py") else min(2, os.cpu_count() or 1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The file that takes minutes is begun first: last, it would keep one process busy and the other waiting."""
    items.sort(key=lambda item: item.path.name != "test_four_concealed_cases.py")
