"""A network trained on what physics leaves: it learns a force that acted, and nothing from noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from trials import CALM, CIRCLE, NOISE, PORT, SHIP, STEP, ZIGZAG, run_of, runs, sailed, values

from manoeuvre_nn.diagnosis.remainder import is_left, with_remainder
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import prepared_run
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.manoeuvre.turning import turning_circle

pytestmark = pytest.mark.usefixtures("unchecked_types")
OFFSET = RudderOffset(SHIP, offset_deg=2.0)
FOUND = FittedHypothesis(Hypothesis((OFFSET,), (values(OFFSET, 2),)), 0.0, np.zeros((1, 1)), np.eye(2))
STRANGE = Formula(SHIP, ("Y |v||r|", "N |v|"), w1=2.0, w2=-0.3)


def trained(*effects):
    likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG, PORT], effects, step=2 * STEP)))
    none = likelihood.evaluate(Hypothesis((), ()))
    return likelihood, none, with_remainder(likelihood, none)


def test_it_learns_the_force_that_acted_and_meets_it_in_a_turn_that_it_has_not_seen():
    likelihood, none, found = trained(STRANGE)
    assert is_left(likelihood, none) and found.names == ("remainder",)
    assert found.evidence > none.evidence + 100
    seen = prepared_run(CALM, run_of(sailed([turning_circle(20.0, duration=240.0)], [STRANGE])[0], NOISE, 9))
    s = seen.linearised.situation
    learned = Remainder(SHIP).at(torch.tensor(found.hypothesis.values[0][0])).acceleration(s, s.nu[..., :0])
    true = STRANGE.acceleration(s, s.nu[..., :0])
    for equation in (1, 2):
        difference = (learned - true)[60:, equation]  # coefficients take their share
        assert float(difference.norm()) < 0.6 * float(true[60:, equation].norm())


@pytest.mark.parametrize("surge, beside, left", [(0.0, 0.0095, False), (0.0, 0.0105, True), (0.0105, 0.0, True)])
def test_something_is_left_where_runs_ask_for_more_than_a_hundredth_in_surge_or_beside(surge, beside, left):
    levels = np.array([[0.0, 0.0], [surge, beside]])
    likelihood = SimpleNamespace(data_set=SimpleNamespace(levels=levels))
    assert is_left(likelihood, SimpleNamespace(best=(1, 0))) is left


@pytest.mark.parametrize("scatter, used", [(0, 0), (1, 1), (4, 1)])
def test_it_is_trained_at_low_noise_beside_what_was_found_which_would_take_its_place(scatter, used):
    """Twelve steps, coefficients off by no more than the second level of their standard deviation."""
    asked, data_set = [], SimpleNamespace(dynamics=CALM, runs=[1, 2], levels=PROCESS_LEVELS)
    likelihood = SimpleNamespace(
        data_set=data_set,
        improve=lambda h, *how, rounds: asked.append((h, *how, rounds)) or (h, 0.0),
        evaluate=lambda h, around: (h, around),
    )
    point = PROCESS_LEVELS.point
    for fitted in (FOUND, replace(FOUND, hypothesis=Hypothesis((), ()))):
        found = with_remainder(likelihood, replace(fitted, best=(point(9, 1), scatter)))
        ((trained, *how),) = asked
        assert found == (trained, point(4, 1)) and how == [point(4, 1), used, 12]
        assert trained.names == (*fitted.names, "remainder") and len(trained.values[-1]) == 2
        asked.clear()


def test_in_calm_water_it_learns_next_to_nothing():
    likelihood, none, found = trained()
    assert found.evidence < none.evidence
    for place in likelihood.data_set.runs:
        s = place.linearised.situation
        learned = Remainder(SHIP).at(torch.tensor(found.hypothesis.values[0][0])).acceleration(s, s.nu[..., :0])
        assert (np.abs(learned.numpy()).mean(axis=0) < 0.05 * likelihood.data_set.unit).all()
