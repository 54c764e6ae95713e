"""What noise tells: averages of correlated errors, and samples of noise with outliers."""

from unittest.mock import Mock

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student_t

from manoeuvre_nn.estimation import agreement
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.measurement_noise import GAUSSIAN, INFORMATION, MIN_SAMPLES, STUDENT_FREEDOM
from manoeuvre_nn.estimation.smoothed_run import _long_run, _mean_square

WHITE = np.random.default_rng(0).standard_normal((40_000, 2))


@pytest.mark.parametrize("correlation", [0.3, 0.6, 0.8])
def test_averages_of_a_first_order_process_scatter_by_its_closed_form(correlation):
    """The variance of its mean is (1 + c)/(1 - c) times that of white noise, Bartlett 1946."""
    slow = lfilter([1.0], [1.0, -correlation], WHITE, axis=0)
    assert _long_run(slow) == approx(np.full(2, (1 + correlation) / (1 - correlation)), rel=0.15)


def test_white_noise_counts_as_it_is_and_nothing_counts_more_than_twenty_times():
    assert _long_run(WHITE) == approx(np.ones(2), abs=0.01)
    assert _long_run(WHITE.cumsum(axis=0)).tolist() == [20.0, 20.0]


def test_a_channel_of_too_few_samples_counts_as_white():
    slow = np.cos(np.arange(200.0) / 20)[:, None] + [0.0, 1e-9]
    slow[MIN_SAMPLES:, 0] = slow[MIN_SAMPLES - 1 :, 1] = 0.0
    enough, few = _long_run(slow)
    assert enough > 5.0 and few == 1.0


def test_a_sample_of_students_t_tells_as_much_as_its_score_varies():
    score = lambda x: (STUDENT_FREEDOM + 1) * x / (STUDENT_FREEDOM + x**2)  # noqa: E731
    assert student_t(STUDENT_FREEDOM).expect(lambda x: score(x) ** 2) == approx(INFORMATION, rel=1e-6)


def test_the_scale_of_students_t_that_fits_gaussian_noise_best_is_where_its_likelihood_is_level():
    def slope(x: float) -> float:
        return (STUDENT_FREEDOM + 1) * x**2 / (STUDENT_FREEDOM + x**2) - 1

    assert norm(scale=GAUSSIAN).expect(slope) == approx(0.0, abs=1e-3)


def test_effects_that_are_joined_keep_the_campaigns_of_either():
    neither, either = Hypothesis((), ()), Hypothesis((), (), campaigns=(0, 0, 1))
    assert neither.joined(either).campaigns == either.joined(neither).campaigns == (0, 0, 1)
    assert neither.joined(neither).campaigns == ()


@pytest.mark.parametrize("ratio, share", [(4.0, 1.0), (0.25, 0.5), (1e-8, 0.03)])
def test_a_floor_that_binds_sinks_with_the_root_of_the_disagreement_to_three_hundredths(monkeypatch, ratio, share):
    floor = np.array([0.01, 0.01, 0.03, 0.02, 0.02, 0.03])
    monkeypatch.setattr(agreement, "birge_ratio", lambda problem, found: ratio)
    with unchecked():
        sunk = agreement.agreed_floor(Mock(floor=floor), Mock(floor=floor, noise=floor))
        free = agreement.agreed_floor(Mock(floor=floor), Mock(floor=0.5 * floor, noise=9.0 * floor))
    assert sunk == approx(share * floor) and free == approx(0.5 * floor), "what does not bind stays"


def test_a_channel_that_is_constant_counts_as_white():
    assert _long_run(np.full((4 * MIN_SAMPLES, 1), 0.25)).tolist() == [1.0]


@pytest.mark.parametrize("share, counted", [(0.97, 0), (1.03, 1)])
def test_a_stretch_has_a_say_where_it_tells_four_times_what_was_known_before(share, counted):
    information = 4.0 * share
    missed, allowed = agreement._told(np.eye(1) * information, np.array([2.0]), np.zeros((1, 1)))
    assert missed == approx(counted * 2.0**2 / information) and allowed == counted


def test_where_instruments_are_better_than_is_taken_for_granted_slow_errors_are_as_small_as_they_are():
    e = np.concatenate([np.full((50, 3), [1.1, 0.3, 0.0]), np.zeros((25, 3))])
    assert _mean_square(e) == approx([1.0, 0.09, 0.0])
