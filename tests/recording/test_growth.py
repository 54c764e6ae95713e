"""What is looked at sample by sample is looked at by arrays: more samples make no more calls."""

import cProfile
from functools import partial

import numpy as np
import pytest
from scipy.signal import savgol_filter

from manoeuvre_nn.recording import local_cubics
from manoeuvre_nn.recording.check.samples import stuck
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.outliers import least_squares


def calls(work) -> int:
    """Python functions and built-in ones that are called."""
    profile = cProfile.Profile()
    profile.runcall(work)
    return sum(entry.callcount for entry in profile.getstats())


def noisy(run, count):
    stream = np.random.default_rng(0)
    dense = run.resampled(np.linspace(0.0, run.duration, count))
    return dense.with_channels(**{k: dense[k] + 1e-4 * stream.standard_normal(count) for k in ("u", "v", "r", "psi")})


def test_channels_that_stand_still_are_looked_for_with_as_many_calls_in_a_long_record(zz20, ship):
    few, many = (calls(partial(stuck, noisy(zz20, count), ship)) for count in (2_000, 8_000))
    assert many < few + 1000  # of 6,000 samples more; noise changes how often some are looked at


@pytest.mark.parametrize("count", [2501, 6000])
def test_a_window_of_many_samples_smooths_as_its_sum_does(monkeypatch, count):
    time = np.arange(count) / 100.0
    values = 7 * time + 30 * np.sin(time / 3) + np.random.default_rng(0).standard_normal(count)
    fast = smoothed(time, values, 16.0)
    monkeypatch.setattr(local_cubics, "MAX_DIRECT", 10**6)
    for one, other, tolerance in zip(fast, smoothed(time, values, 16.0), (1e-7, 1e-7), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance)


def test_a_window_of_many_samples_is_summed_up_by_a_transform_at_once(monkeypatch):
    given, transform = [], local_cubics.oaconvolve
    monkeypatch.setattr(local_cubics, "oaconvolve", lambda *a, **how: given.append(len(a[1])) or transform(*a, **how))
    smoothed(np.arange(20_000) / 100.0, np.zeros(20_000), 4.0)
    assert not given
    smoothed(np.arange(20_000) / 100.0, np.zeros(20_000), 16.0)
    assert given == [1601, 1601]


@pytest.mark.parametrize("n, window", [(5, 5), (200, 17), (201, 201), (1500, 499), (1500, 501), (1501, 1501)])
def test_local_cubics_are_those_of_savitzky_and_golay_at_the_ends_too(n, window):
    step = 0.1
    values = 50 + np.random.default_rng(n).standard_normal(n)
    for derivative, found in enumerate(smoothed(step * np.arange(n), values, step * (window - 1))):
        second_route = savgol_filter(values, window, 3, deriv=derivative, delta=step)
        np.testing.assert_allclose(found, second_route, rtol=0, atol=1e-8)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_of_few_samples_the_polynomial_goes_through_as_many_as_are_odd(n):
    value, slope = smoothed(np.arange(float(n)), 3.0 * np.arange(n) + 1, 100.0)
    assert value == pytest.approx(3.0 * np.arange(n) + 1)
    assert slope == pytest.approx(np.full(n, 0.0 if n == 2 else 3.0))


@pytest.mark.filterwarnings("error")
def test_a_column_of_nothing_in_a_least_squares_fit_is_known_to_be_nothing_and_no_warning():
    x = np.column_stack([np.arange(9.0), np.zeros(9)])
    solution, covariance = least_squares(x, 2 * np.arange(9.0) + [0, 1, -1, 0, 1, -1, 0, 1, -1])
    assert solution[1] == 0.0 and np.isfinite(covariance).all() and covariance[0, 0] > 0
