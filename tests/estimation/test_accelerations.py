from dataclasses import replace

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.accelerations import accelerations, taken_away
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.noise import add_noise

RATES = ("udot", "vdot", "rdot")


def wave(time):
    values = {"u": np.sin(time / 10), "v": time**2 / 100, "r": 0.1 * time}
    return Recording("wave", time, values)


def known_to_be_of(ship, record):
    return replace(record, meta={**record.meta, "time_unit": ship.time_unit})


def errors(found, truth):
    return [np.sqrt(np.mean((found[k] - truth[k]) ** 2)) / truth[k].std() for k in RATES]


def test_exact_accelerations_are_those_of_the_simulation(zz35):
    assert accelerations(zz35, "exact") is zz35


def test_exact_accelerations_must_be_there(zz35):
    bare = replace(zz35, channels={k: zz35[k] for k in ("u", "v", "r")})
    with pytest.raises(InputError, match="no exact accelerations, only simulations do: write accelerations=smoother"):
        accelerations(bare, "exact")


def test_an_unknown_method_is_refused(zz35):
    with pytest.raises(Exception, match="spline"):
        accelerations(zz35, "spline")


def test_central_differences_are_exact_for_a_parabola_at_uneven_times_and_at_the_ends():
    time = np.array([0.0, 1.0, 1.5, 3.0, 3.2, 5.0])
    found = accelerations(wave(time), "central")
    np.testing.assert_allclose(found["vdot"], time / 50, atol=1e-12)
    np.testing.assert_allclose(found["rdot"], 0.1, atol=1e-12)


def test_central_differences_converge_with_the_square_of_the_interval():
    def worst(step):
        time = np.arange(0, 60, step)
        return np.abs(accelerations(wave(time), "central")["udot"] - np.cos(time / 10) / 10)[2:-2].max()

    assert worst(0.5) / worst(0.25) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("even", [True, False])
def test_the_smoother_leaves_a_cubic_as_it_is(even):
    time = np.linspace(0, 40, 201)
    if not even:
        time[1:-1] += 0.01 * np.random.default_rng(0).uniform(-1, 1, 199)
    value, slope = smoothed(time, 1 + 0.2 * time - 0.01 * time**3, 4.0)
    tolerance = 1e-9 if even else 2e-2
    np.testing.assert_allclose(value, 1 + 0.2 * time - 0.01 * time**3, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(slope, 0.2 - 0.03 * time**2, rtol=tolerance, atol=5 * tolerance)


def test_times_far_from_even_are_smoothed_all_the_same():
    time = np.sort(np.random.default_rng(0).uniform(0, 60, 600))
    value, slope = smoothed(time, np.sin(time / 10), 4.0)
    assert np.abs(value - np.sin(time / 10)).max() < 0.005
    assert np.abs(slope - np.cos(time / 10) / 10).max() < 0.01


def test_the_smoother_beats_central_differences_tenfold_on_a_noisy_zigzag_at_10_hz(zz35, ship):
    fine = zz35.resampled(np.arange(0, 360, 0.1))
    noisy = known_to_be_of(ship, add_noise(fine, {k: 0.005 * zz35[k].std() for k in ("u", "v", "r")}))
    smooth, plain = errors(accelerations(noisy), fine), errors(accelerations(noisy, "central"), fine)
    assert max(smooth) < 0.05
    assert min(np.array(plain) / smooth) > 10


def test_the_smoother_does_little_harm_to_a_clean_zigzag(zz35, ship):
    assert max(errors(accelerations(known_to_be_of(ship, zz35)), zz35)) < 0.03


@pytest.mark.slow
def test_without_a_known_ship_cross_validation_adapts_to_the_noise(zz35):
    zz35 = replace(zz35, meta={})
    noisy = add_noise(zz35, {k: 0.005 * zz35[k].std() for k in ("u", "v", "r")})
    assert max(errors(accelerations(zz35), zz35)) < 0.01
    assert max(errors(accelerations(noisy), zz35)) < 0.07


def test_smoothed_velocities_are_nearer_to_the_truth_and_belong_to_the_heading(zz35, ship):
    noisy = add_noise(zz35, {"u": 0.05, "v": 0.05, "r": 2e-4, "psi": 0.005, "x": 1.0, "y": 1.0}, seed=1)
    found = accelerations(known_to_be_of(ship, noisy))
    for name in ("u", "v", "r", "psi", "x", "y"):
        assert np.std(found[name] - zz35[name]) < 0.7 * np.std(noisy[name] - zz35[name])
    clean = accelerations(known_to_be_of(ship, zz35))
    slope = np.gradient(clean["psi"], clean.time)[2:-2]
    np.testing.assert_allclose(slope, clean["r"][2:-2], atol=0.01 * np.abs(zz35["r"]).max())


def test_the_rudder_is_left_as_it_is(zz35, ship):
    np.testing.assert_array_equal(accelerations(known_to_be_of(ship, zz35))["delta"], zz35["delta"])


def test_what_smoothing_takes_away_is_most_of_the_noise(zz35, ship):
    raw = known_to_be_of(ship, add_noise(zz35, {"v": 0.1, "r": 0.002}, seed=2))
    found = taken_away([raw, raw], [accelerations(raw), accelerations(raw)])
    assert found["v"] == pytest.approx(0.1, rel=0.15) and found["r"] == pytest.approx(0.002, rel=0.15)
    assert found["u"] < 0.02
