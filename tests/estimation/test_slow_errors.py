"""How much slower averages of correlated errors get better than those of white noise."""

import numpy as np
import pytest
from pytest import approx
from scipy.signal import lfilter

from manoeuvre_nn.estimation.measurement_noise import MIN_SAMPLES
from manoeuvre_nn.estimation.smoothed_run import _long_run

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
