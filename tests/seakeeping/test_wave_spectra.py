import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.seakeeping.spectra import WaveSpectrum, compose, significant_height

SEA = WaveSpectrum.ittc(5.0, 10.0)


@pytest.mark.parametrize("order", [-1, 0, 1, 2])
def test_moments_are_the_integrals_of_the_density(order):
    integral, _ = quad(lambda w: w**order * float(SEA.density(np.array(w))), 0.05, np.inf, limit=400)
    assert SEA.moment(order) == approx(integral, rel=1e-6)


def test_the_variance_is_a_quarter_of_a_over_b():
    a, b = SEA.level, SEA.decay
    assert SEA.moment(0) == approx(a / (4 * b), rel=1e-12)


def test_height_and_period_come_back_from_the_moments():
    assert significant_height(SEA.moment(0)) == approx(5.0, abs=0.005)
    assert 2 * np.pi * SEA.moment(0) / SEA.moment(1) == approx(10.0, abs=0.002)


def test_the_peak_lies_where_the_slope_of_the_density_is_zero():
    b = SEA.decay
    frequency = np.linspace(0.3, 1.0, 70001)
    assert frequency[np.argmax(SEA.density(frequency))] == approx((0.8 * b) ** 0.25, abs=2e-5)


def test_waves_four_times_as_high_have_sixteen_times_the_energy():
    frequency = np.array([0.4, 0.8])
    np.testing.assert_allclose(WaveSpectrum.ittc(20.0, 10.0).density(frequency), 16 * SEA.density(frequency))


def test_components_carry_the_energy_of_their_band():
    fine = compose(SEA, 0.2, 5.0, 4801, [0])
    tail, _ = quad(lambda w: float(SEA.density(np.array(w))), 5.0, np.inf)
    assert fine.moment(0) == approx(SEA.moment(0) - tail, rel=1e-4)


def test_twenty_components_as_in_the_source():
    waves = compose(SEA, 0.3, 1.25, 20, [0])
    np.testing.assert_allclose(np.diff(waves.frequency), 0.05)
    assert waves.amplitude[7] == approx(0.503, abs=5e-4)
    assert significant_height(waves.moment(0)) == approx(4.94, abs=0.005)


def test_a_record_has_the_variance_of_its_components():
    waves = compose(SEA, 0.3, 1.25, 20, [3])
    time = np.linspace(0, 2 * np.pi / 0.05, 4000, endpoint=False)  # all twenty close on themselves
    record = waves.record(time)[0]
    assert record.mean() == approx(0.0, abs=1e-10)
    assert record.var() == approx(waves.moment(0), rel=1e-10)


def test_a_record_is_the_sum_of_its_cosines():
    waves, time = compose(SEA, 0.3, 1.25, 5, [1, 2]), np.array([0.0, 1.3, 20.0])
    for row, phase in zip(waves.record(time), waves.phase, strict=True):
        each = waves.amplitude * np.cos(np.outer(time, waves.frequency) + phase)
        np.testing.assert_allclose(row, each.sum(1))


def test_what_answers_leads_by_the_phase_of_its_transfer_function_and_at_the_frequency_of_encounter():
    waves, time = compose(SEA, 0.3, 1.25, 5, [1]), np.array([0.0, 2.0])
    met = 1.2 * waves.frequency
    answer = waves.record(time, np.full(5, 3j), met)
    each = 3 * waves.amplitude * np.cos(np.outer(time, met) + waves.phase + np.pi / 2)
    np.testing.assert_allclose(answer[0], each.sum(1))


def test_a_seed_is_a_sea_of_its_own_whatever_stands_beside_it():
    both, alone = compose(SEA, 0.3, 1.25, 20, [4, 5]), compose(SEA, 0.3, 1.25, 20, [5])
    np.testing.assert_array_equal(both.phase[1], alone.phase[0])
    assert np.abs(both.phase[0] - both.phase[1]).max() > 0.5


def test_phases_fill_the_turn_evenly():
    phases = compose(SEA, 0.3, 1.25, 20, range(500)).phase
    counts, _ = np.histogram(phases, bins=8, range=(0, 2 * np.pi))
    assert counts.sum() == phases.size
    assert np.abs(counts / phases.size - 1 / 8).max() < 0.01


def test_what_is_no_sea_is_refused():
    with pytest.raises(InputError, match="write values above 0"):
        WaveSpectrum.ittc(0.0, 10.0)
    with pytest.raises(InputError, match="ask for 3 or less"):
        SEA.moment(4)
    with pytest.raises(InputError, match="2 waves or more"):
        compose(SEA, 0.3, 1.25, 1, [0])
    with pytest.raises(InputError, match="0 < low < high"):
        compose(SEA, 1.25, 0.3, 20, [0])


def test_bretschneider_s_sea_has_the_height_and_the_zero_crossing_period_that_were_asked_for():
    sea = WaveSpectrum.bretschneider(3.0, 8.5)
    assert significant_height(sea.moment(0)) == approx(3.0, rel=1e-12)
    assert 2 * np.pi * np.sqrt(sea.moment(0) / sea.moment(2)) == approx(8.5, rel=1e-12)


def test_both_spectra_are_one_where_their_periods_belong_together():
    # T_1 = 1.0864 T_z for this form, up to the ITTC's round numbers
    zero_crossing = WaveSpectrum.bretschneider(5.0, 10.0 / 1.0864)
    np.testing.assert_allclose(zero_crossing.level, SEA.level, rtol=2e-3)
    np.testing.assert_allclose(zero_crossing.decay, SEA.decay, rtol=2e-3)
