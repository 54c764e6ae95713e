"""A random force, whose greatest push looks like an event, and an event: each is told for what it is."""

import pytest
from strangers import asked, strange_runs
from trials import CALM, SHIP

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.decision import Decision, decide
from manoeuvre_nn.diagnosis.search import search
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.estimation.data_set import whitened_data_set

pytestmark = pytest.mark.usefixtures("unchecked_types")


def decided(seed: int, *acting: Effect, random=()) -> Decision:
    """What is decided of one run with a side force as the one candidate."""
    question = asked(strange_runs(seed, *acting, random=random), [SideForce(SHIP)])
    return decide(search(whitened_data_set(CALM, question.case.fitted[1:]), question.effects))


def test_a_random_sway_force_is_not_the_event_that_it_looks_like():
    d = decided(3, random=[(0.6, "Y", 60.0)])
    assert d.bayes["side_force"] > 20, "or nothing was asked"
    assert d.strange and d.unknown > 0.9 and d.lead > 5


def test_a_push_is_no_random_force():
    d = decided(3, SideForce(SHIP, force_kN=300.0, lever_m=10.0, start_s=120.0, end_s=260.0))
    assert d.named and d.effects["side_force"] > 0.9
