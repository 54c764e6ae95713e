"""What comes again over time and place: found, by amplitudes of the plain sum, in memory that does not grow with it."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from pytest import approx
from trials import SHIP

from manoeuvre_nn.diagnosis import recurring
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


def missing(monkeypatch, *forces) -> list[recurring.SpectralPeak]:
    """Peaks in a force over 500 s that a ship lacks on a round of 2 by 2 km, beside its mean, in one run or several."""
    time = np.arange(0.0, 500.0)
    north, east = (1000.0 + 1000.0 * f(2 * np.pi * time / 500.0) for f in (np.cos, np.sin))
    s = SimpleNamespace(**{k: torch.tensor(v) for k, v in {"time": time, "x": north, "y": east}.items()})
    monkeypatch.setattr(
        recurring, "missing_accelerations", lambda data_set: [f(time, north / 1000, east / 1000) for f in forces]
    )
    monkeypatch.setattr(recurring, "_of_the_motion", lambda data_set, s: np.ones((500, 1)))
    run = SimpleNamespace(linearised=SimpleNamespace(situation=s))
    return recurring.recurring(
        SimpleNamespace(runs=[run] * len(forces), dynamics=SimpleNamespace(particulars=SHIP.particulars))
    )


@pytest.mark.usefixtures("unchecked_types")
def test_a_periodic_force_is_found_at_its_period_with_its_phase_among_all_that_could_be(monkeypatch):
    period = 499.0 / (1.5 + 25 / 3)  # one of those that are tried

    def force(time, north, east):
        y = np.zeros((500, 3))
        y[:, 1] = 3.0 + np.cos(2 * np.pi * time / period - np.radians(60.0))
        return y

    found = [p for p in missing(monkeypatch, force) if (p.equation, p.mark) == ("Y", "periodic")]
    assert len(found) == recurring.PEAKS and found[0].scales["period_s"] == approx(period)
    assert found[0].shares[0] == approx((0.5, 3**0.5 / 2), abs=0.02)
    fastest = 0.5 * SHIP.particulars.time_unit  # half the time in which she sails her length
    assert found[0].tried == approx(499.0 / fastest, abs=1.5)
    assert abs(found[1].scales["period_s"] - period) > 3.0, "the flanks of a peak are no second one"


@pytest.mark.usefixtures("unchecked_types")
def test_a_periodic_force_of_another_phase_in_each_run_is_found_with_each_phase(monkeypatch):
    """Of opposite phase in two runs: nothing of it is alike. Twice as large in one, with 2 and 1 over their rms."""
    period = 499.0 / (1.5 + 25 / 3)

    def run(size, phase):
        return lambda time, north, east: np.stack(
            [0 * time, size * np.cos(2 * np.pi * time / period - np.radians(phase)), 0 * time], axis=-1
        )

    peaks = [p for p in missing(monkeypatch, run(2.0, 60.0), run(2.0, 240.0), run(1.0, 0.0)) if p.equation == "Y"]
    of_runs = next(p for p in peaks if p.mark == "periodic_by_run")
    assert of_runs.scales["period_s"] == approx(period) and of_runs.tried > 1
    rms = np.sqrt((4.0 + 4.0 + 1.0) / 3)
    expected = np.array([[1.0, 3**0.5], [-1.0, -(3**0.5)], [1.0, 0.0]]) / rms
    assert np.array(of_runs.shares) == approx(expected, abs=0.03)
    alone = missing(monkeypatch, run(2.0, 60.0))
    assert not [p for p in alone if p.mark == "periodic_by_run"], "one run has one phase"


@pytest.mark.usefixtures("unchecked_types")
def test_stripes_are_found_at_their_spacing_and_across_which_way_they_lie(monkeypatch):
    def force(time, north, east):
        n = np.zeros((500, 3))
        n[:, 2] = np.sin(2 * np.pi * (1.5 * north - 2.0 * east))
        return n

    found = [p for p in missing(monkeypatch, force) if (p.equation, p.mark) == ("N", "stripes")]
    assert found[0].scales == {"north_per_km": approx(1.5, abs=0.1), "east_per_km": approx(-2.0, abs=0.1)}
    assert found[0].shares[0] == approx((0.0, 1.0), abs=0.1)
    side = 40  # numbers a side; numbers near none are no waves
    assert found[0].tried == approx((side + 1) * (2 * side + 1) / 9, rel=0.02)
