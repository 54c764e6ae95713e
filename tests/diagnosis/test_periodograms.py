"""Amplitudes of waves over time and place: those of the plain sum, in memory that does not grow with their number."""

import tracemalloc

import numpy as np
import pytest

from manoeuvre_nn.diagnosis.recurring import OVERSAMPLED, _over_place, _over_time


def plain(force, place, waves):
    return np.exp(-2j * np.pi * place @ waves.T).T @ force / len(force)


def beats(longest, step):
    return np.arange(1.5, longest / (4 * step), 1 / OVERSAMPLED) / longest


@pytest.mark.parametrize("step", [1.0, 0.7, 1 / 3])
def test_amplitudes_over_time_of_several_runs_are_those_of_the_sum(step):
    clock = np.concatenate([step * np.arange(count) for count in (250, 401, 90)])
    force = np.random.default_rng(0).standard_normal((len(clock), 3))
    waves = beats(400 * step, step)
    np.testing.assert_allclose(
        _over_time(force, clock, waves), plain(force, clock[:, None], waves[:, None]), atol=1e-12
    )
    for few in (waves[:0], waves[:1]):
        np.testing.assert_allclose(
            _over_time(force, clock, few), plain(force, clock[:, None], few[:, None]), atol=1e-12
        )


def test_amplitudes_over_place_are_those_of_the_sum(monkeypatch):
    monkeypatch.setattr("manoeuvre_nn.diagnosis.recurring.AT_ONCE", 64)
    random = np.random.default_rng(0)
    force, place = random.standard_normal((300, 3)), random.uniform(-3, 3, (300, 2))
    north, east = np.arange(5) / 7, np.arange(-4, 5) / 7
    waves = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    found = _over_place(force, (place[:, 0], place[:, 1]), (north, east))
    np.testing.assert_allclose(found, plain(force, place, waves), atol=1e-12)


def test_memory_grows_with_the_samples_and_not_with_samples_times_waves():
    count = 20_000
    clock, force = np.arange(float(count)), np.ones((count, 3))
    waves = beats(count - 1.0, 1.0)
    side = np.arange(40) / 10
    tracemalloc.start()
    try:
        _over_time(force, clock, waves)
        _over_place(force, (clock, clock), (side, np.r_[-side[:0:-1], side]))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(waves) * count * 16 > 1e9 and peak < 6e7
