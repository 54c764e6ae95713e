"""One thread a process, a process a core; two zigzags of the Mariner that several rooms look at."""

import gc
import os
import signal

os.environ["OMP_NUM_THREADS"] = "1"  # the processes that share out the tests start with it

# Libraries are imported before the package: what a module imports while jaxtyping's hook loads it is compiled anew;
# and tests/sparing.py sees to how its functions are checked.
import pandas  # noqa: F401
import pytest
import sparing
import torch
import torchdiffeq  # noqa: F401
from hypothesis import HealthCheck, settings
from threadpoolctl import threadpool_limits

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner

# Property tests draw the same few inputs each time; pytest --hypothesis-profile=long draws many, others each time.
COMMON = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("short", max_examples=20, derandomize=True, **COMMON)
settings.register_profile("long", max_examples=1000, **COMMON)
settings.load_profile("short")

torch.set_num_threads(1)
threadpool_limits(1)  # where numpy was loaded before this file


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process for one file, whose start takes longer than its tests; otherwise one for each of two cores."""
    files = {name.split("::")[0] for name in config.args}
    return 0 if len(files) == 1 and files.pop().endswith(".py") else min(2, os.cpu_count() or 1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take minutes are begun first: last, they would keep one process busy and the other waiting."""
    items.sort(key=lambda item: item.path.name not in {"test_concealed_cases.py", "test_notebooks.py"})


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    sparing.begin()


def pytest_collection() -> None:
    """What is imported and collected stays: it need not be looked through for garbage, now or during the tests."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)  # simulations make many small objects that go by themselves, and few circles
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_interrupts() -> None:
    """A shell that starts the tests in the background has them ignore ctrl-C, which some of them press."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def ship() -> Particulars:
    return mariner().particulars


@pytest.fixture(scope="session")
def zz20() -> Recording:
    return simulate(CalmWater(mariner()), zigzag(20.0))


@pytest.fixture(scope="session")
def zz35() -> Recording:
    return simulate(CalmWater(mariner()), zigzag(35.0))
