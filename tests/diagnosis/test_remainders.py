"""A network trained on what physics leaves: it learns a force that acted, and nothing from noise."""

import numpy as np
import pytest
import torch
from trials import CALM, CIRCLE, NOISE, PORT, SHIP, ZIGZAG, run_of, runs, sailed

from manoeuvre_nn.diagnosis.remainder import is_left, with_remainder
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import prepared_run
from manoeuvre_nn.manoeuvre.turning import turning_circle

pytestmark = pytest.mark.usefixtures("unchecked_types")
STRANGE = Formula(SHIP, ("Y |v||r|", "N |v|"), w1=2.0, w2=-0.3)


def trained(*effects):
    likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG, PORT], effects)))
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


def test_in_calm_water_it_learns_next_to_nothing():
    likelihood, none, found = trained()
    assert found.evidence < none.evidence
    for place in likelihood.data_set.runs:
        s = place.linearised.situation
        learned = Remainder(SHIP).at(torch.tensor(found.hypothesis.values[0][0])).acceleration(s, s.nu[..., :0])
        assert (np.abs(learned.numpy()).mean(axis=0) < 0.05 * likelihood.data_set.unit).all()
