"""Hours of recordings fit into memory: what can be made again is not kept, and long runs are linearised by pieces."""

import numpy as np
import pytest
from trials import CALM, CIRCLE, runs

from manoeuvre_nn.estimation import data_set, linearised_run
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linearised_run import linearise
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood


@pytest.fixture(scope="module")
def levels():
    return whitened_data_set(CALM, runs([CIRCLE]))


def test_levels_of_noise_for_which_there_is_no_room_are_made_again_as_they_were(levels, monkeypatch):
    likelihood = MarginalLikelihood(levels)
    known = likelihood.evaluate(Hypothesis((), ()))
    assert len(levels._at) > 3
    kept = 2 * levels.at(0).bytes
    monkeypatch.setattr(data_set, "MAX_KEPT_BYTES", kept)
    again = likelihood.evaluate(Hypothesis((), ()))
    assert len(levels._at) == 2 and sum(level.bytes for level in levels._at.values()) <= kept
    assert again.evidence == known.evidence and (again.by_level == known.by_level).all()
    monkeypatch.setattr(data_set, "MAX_KEPT_BYTES", 1)
    assert levels.at(3) is levels.at(3)  # of the level in use there is always one


def test_a_data_set_that_was_released_says_the_same_when_it_is_asked_again(levels):
    known = MarginalLikelihood(levels).evaluate(Hypothesis((), ()))
    levels.release()
    assert not levels._at
    assert MarginalLikelihood(levels).evaluate(Hypothesis((), ())).evidence == known.evidence


def test_a_long_run_is_linearised_piece_by_piece_as_a_short_one_is_at_once(levels, monkeypatch):
    whole = levels.runs[0].linearised
    monkeypatch.setattr(linearised_run, "MAX_STEPS", 50)
    pieces = linearise(whole.run, whole.rate, whole.track)
    for name in ("transition", "defect", "rudder_push"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-9, atol=1e-9)
