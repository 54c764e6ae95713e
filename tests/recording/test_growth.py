"""What is looked at sample by sample is looked at by arrays: more samples make no more calls."""

import cProfile
from functools import partial

import numpy as np
import pytest

from manoeuvre_nn.recording import local_cubics
from manoeuvre_nn.recording.check.samples import stuck
from manoeuvre_nn.recording.local_cubics import savgol_filter, smoothed
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
    assert many < 1.5 * few  # one call for each sample more than doubles them


@pytest.mark.parametrize("count", [2501, 6000])
def test_a_window_of_many_samples_smooths_as_its_sum_does(monkeypatch, count):
    time = np.arange(count) / 100.0
    values = 7 * time + 30 * np.sin(time / 3) + np.random.default_rng(0).standard_normal(count)
    fast = smoothed(time, values, 16.0)
    monkeypatch.setattr(local_cubics, "MAX_DIRECT", 10**6)
    for one, other, tolerance in zip(fast, smoothed(time, values, 16.0), (1e-7, 1e-7), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance)


def test_a_window_of_many_samples_is_summed_up_at_the_ends_alone(monkeypatch):
    given = []
    monkeypatch.setattr(
        local_cubics, "savgol_filter", lambda values, *rest, **more: given.append(len(values)) or savgol_filter(
            values, *rest, **more
        ),
    )  # fmt: skip
    smoothed(np.arange(20_000) / 100.0, np.zeros(20_000), 16.0)
    assert given and max(given) == 1601


@pytest.mark.filterwarnings("error")
def test_a_column_of_nothing_in_a_least_squares_fit_is_known_to_be_nothing_and_no_warning():
    x = np.column_stack([np.arange(9.0), np.zeros(9)])
    solution, covariance = least_squares(x, 2 * np.arange(9.0) + [0, 1, -1, 0, 1, -1, 0, 1, -1])
    assert solution[1] == 0.0 and np.isfinite(covariance).all() and covariance[0, 0] > 0
