"""What a short formula is chosen from, and that there is none where no term is worth its choice."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from searches import fitted

from manoeuvre_nn.diagnosis import formula
from manoeuvre_nn.effect.formula import LAG, in_time, mark_of

pytestmark = pytest.mark.usefixtures("unchecked_types")


@pytest.mark.parametrize("durations, longest", [((600.0, 900.0), 200.0), ((21.0, 600.0), 10.0)])
def test_forces_that_follow_late_are_tried_with_memories_of_five_seconds_to_a_third_of_the_shortest_run(
    monkeypatch, durations, longest
):
    """But of ten seconds at least, however short it is."""
    monkeypatch.setattr(formula, "recurring", lambda data_set: [])
    runs = [SimpleNamespace(linearised=SimpleNamespace(run=SimpleNamespace(duration=d))) for d in durations]
    late = [c for c in formula._candidates(SimpleNamespace(runs=runs)) if c.scales]
    assert {c.terms for c in late} == {(term,) for term in in_time() if mark_of(term) == LAG}
    for term in {c.terms for c in late}:
        memories = [c.scales["memory_s"] for c in late if c.terms == term]
        assert memories == approx(np.geomspace(5.0, longest, 7).tolist())


def test_there_is_no_formula_where_no_term_explains_anything(monkeypatch):
    monkeypatch.setattr(formula, "_candidates", lambda data_set: [formula._Candidate(("N |v|",))])
    monkeypatch.setattr(formula, "_columns", lambda *_: (None, np.ones(1)))
    gram = np.diag([9.0, 1.0, 4.0])  # the data, a coefficient, the term: nothing of one is in another
    data_set = Mock(size=2, runs=[0], nuisance_sd=lambda scatter, runs: np.ones(1), gram=lambda *_: gram)
    assert formula.short_formula(Mock(data_set=data_set), fitted(0.0)) is None
