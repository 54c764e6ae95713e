"""What would not fit into memory is refused in a line that says what to do, before anything is computed."""

import numpy as np
import pytest
from fleet import unchecked

from manoeuvre_nn.core import memory
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.estimation import data_set
from manoeuvre_nn.estimation.closed_loop import first
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.problem import EstimationProblem
from manoeuvre_nn.ship.mariner import mariner


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 1e6)


def test_a_diagnosis_that_is_too_long_says_so_first(zz20, small, monkeypatch):
    monkeypatch.setattr(data_set, "prepared_run", lambda *given: pytest.fail("it was begun"))
    with pytest.raises(InputError, match=r"samples to be diagnosed need about .* GB of memory.*write fewer files"):
        whitened_data_set(CalmWater(mariner()), [zz20])


def test_a_fit_that_is_too_long_says_so_first(zz20, monkeypatch):
    problem = EstimationProblem([zz20], None, np.zeros(62), np.ones(62))
    monkeypatch.setattr(memory, "free_memory", lambda: 1e9)
    with unchecked():
        assert len(first(problem).states[0]) == len(zz20)
    monkeypatch.setattr(memory, "free_memory", lambda: 1e6)
    with pytest.raises(InputError, match=r"samples to be fitted need about .* GB of memory.*shorter data.length="):
        first(problem)


def test_where_the_system_does_not_say_what_is_free_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: None)
    memory.check_memory("ten samples", 1e20, "nothing")
