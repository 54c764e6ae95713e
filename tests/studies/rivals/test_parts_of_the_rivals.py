"""Parts of the rivals by themselves: the middle of a posterior, drawn values, a fit of nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.effect import Parameter
from studies.concealed_trial.rivals.neural_result import _middle
from studies.concealed_trial.rivals.search import fitted
from studies.concealed_trial.rivals.simulated import _value


@pytest.fixture(autouse=True)
def quick():
    with unchecked():
        yield


def test_the_middle_of_directions_is_on_the_circle_and_of_numbers_on_the_line():
    drawn = np.random.default_rng(0).normal(0.0, 10.0, 20_000)
    assert _middle((drawn - 5.0) % 360.0, 360.0) == approx((355.0, 10.0), abs=0.3)
    assert _middle(drawn - 5.0, None) == approx((-5.0, 10.0), abs=0.3)
    assert _middle(355.0 + drawn, None)[0] == approx(355.0, abs=0.3)


@pytest.mark.parametrize("size, over_draught", [(1.0, 2.0), (4.0, 1.25)])
def test_a_depth_comes_near_the_draught_as_its_effect_grows(size, over_draught):
    depth = Parameter("depth", "m", 1.15 * 8.0, 500.0, None, 10.0, (20.0,))
    assert _value(np.random.default_rng(0), depth, size) == approx(8.0 * over_draught)


def test_drawn_values_go_from_the_null_with_their_size_and_directions_all_round():
    rng = np.random.default_rng(0)
    speed = Parameter("speed", "m/s", -3.0, 3.0, 0.0, 0.5, (0.5,))
    assert _value(rng, speed, 1.0) == 0.5 and _value(rng, speed, 3.0) == 1.5
    factor = Parameter("factor", "-", 0.1, 2.0, 1.0, 0.2, (0.5,))
    assert [_value(rng, factor, size) for size in (1.0, 3.0)] == approx([0.5, 0.25]), "as a share of what it leaves"
    around = [_value(rng, Parameter("from", "deg", 0.0, 360.0, None, 60.0, (0.0,), period=360.0), 1.0)
              for _ in range(400)]  # fmt: skip
    assert np.histogram(around, bins=4, range=(0.0, 360.0))[0].min() > 70


def test_a_hypothesis_with_nothing_free_is_left_as_it_is():
    left = np.ones((2, 3))
    data = SimpleNamespace(evaluate=lambda h: (left, np.zeros((0, 2, 3))))
    fit = fitted(data, SimpleNamespace(unknowns=list))
    assert fit.left is left and fit.spread.shape == (0, 0)
