import numpy as np
import pytest
from pytest import approx
from scipy.linalg import expm

from manoeuvre_nn.core.errors import InputError
from studies.wang1996.free_decay import (
    autocorrelation,
    correlations,
    decay_rate,
    free_modes,
    motion_matrix,
    random_decrement,
)

MATRIX = np.array([[-0.037, -2.4], [-0.00107, -0.109]])
START = np.array([1.0, -0.02])
STEP = 0.5


def free(matrix, start, count):
    return np.stack([expm(matrix * STEP * k) @ start for k in range(count)])


def noise(seed, shape):
    return np.random.default_rng(seed).standard_normal(shape)


def test_correlations_are_the_sums_of_their_definition():
    motion = noise(0, (3, 40, 2))
    for window in ("whole", "common"):
        ours = correlations(motion, 7, window)
        for row, k, i, j in ((0, 0, 0, 0), (1, 3, 0, 1), (2, 7, 1, 0)):
            count = 33 if window == "common" else 40 - k
            products = sum(motion[row, t + k, i] * motion[row, t, j] for t in range(count))
            assert ours[row, k, i, j] == approx(products / (33 if window == "common" else 40))


def test_autocorrelation_is_the_diagonal_of_the_correlations():
    motion = noise(1, (60, 2))
    np.testing.assert_allclose(autocorrelation(motion[:, 1], 9), correlations(motion, 9)[:, 1, 1], atol=1e-14)


def test_the_autocorrelation_of_a_cosine_is_a_cosine():
    time = 0.1 * np.arange(20_000)
    ours = autocorrelation(3 * np.cos(time), 100)
    np.testing.assert_allclose(ours, 4.5 * np.cos(0.1 * np.arange(101)), atol=0.05)


@pytest.mark.parametrize("rate", [-0.03728, -0.107, 0.02])
def test_an_exact_exponential_gives_its_rate_however_short_the_record(rate):
    decay = -2.0 * np.exp(rate * STEP * np.arange(60))
    assert decay_rate(decay, STEP) == approx(rate, rel=1e-12)
    assert decay_rate(autocorrelation(decay, 40, "common"), STEP) == approx(rate, rel=1e-10)


def test_the_source_s_window_bends_a_record_that_ends_before_its_decay_and_not_a_longer_one():
    errors = []
    for count in (60, 400):
        decay = np.exp(-0.05 * STEP * np.arange(count))
        errors.append(abs(float(decay_rate(autocorrelation(decay, 30), STEP)) + 0.05))
    assert errors[0] > 0.01
    assert errors[1] < 1e-6


def test_batches_give_what_each_record_gives():
    records = np.exp(-np.outer([0.05, 0.1], STEP * np.arange(200)))
    rates = decay_rate(autocorrelation(records, 30), STEP)
    for record, rate in zip(records, rates, strict=True):
        assert decay_rate(autocorrelation(record, 30), STEP) == approx(rate)


@pytest.mark.parametrize("stride", [1, 8])
def test_a_free_motion_gives_the_matrix_of_its_equations(stride):
    motion = free(MATRIX, START, 200)
    np.testing.assert_allclose(
        motion_matrix(correlations(motion, 80, "common"), STEP, stride), MATRIX, rtol=1e-6, atol=1e-9
    )


def test_a_swinging_free_motion_gives_its_matrix_too():
    matrix = np.array([[-0.05, -0.4], [0.3, -0.02]])
    motion = free(matrix, START, 200)
    np.testing.assert_allclose(motion_matrix(correlations(motion, 80, "common"), STEP), matrix, rtol=1e-8)


def test_the_unit_of_a_channel_does_not_matter():
    correlation = correlations(free(MATRIX, START, 200) + 0.003 * noise(2, (200, 2)), 80, "common")
    unit = np.array([1.0, 180 / np.pi])
    degrees = motion_matrix(correlation * unit[:, None] * unit, STEP, 8)
    np.testing.assert_allclose(degrees * unit / unit[:, None], motion_matrix(correlation, STEP, 8), rtol=1e-6)


def test_in_white_noise_the_correlations_give_the_matrix():
    motion, push = [np.zeros(2)], noise(3, (400_000, 2)) * [0.1, 0.002]
    step = expm(MATRIX * STEP)
    for kick in push:
        motion.append(step @ motion[-1] + kick)
    ours = motion_matrix(correlations(np.array(motion), 40), STEP, 4)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(ours)), np.sort(np.linalg.eigvals(MATRIX)), rtol=0.06)


def test_where_no_system_decays_like_that_there_is_no_number():
    flips = (-0.9) ** np.arange(60)
    motion = np.stack([flips, 0.5 ** np.arange(60)], axis=-1)
    assert np.isnan(motion_matrix(correlations(motion, 20, "common"), STEP)).all()


def test_modes_are_the_free_motion():
    modes = free_modes(MATRIX, START)
    np.testing.assert_allclose(modes.motion(STEP * np.arange(50)).T, free(MATRIX, START, 50), rtol=1e-10)
    assert modes.rates[0] < modes.rates[1] < 0


def test_modes_meet_value_and_rate_at_the_start():
    modes = free_modes(MATRIX, START)
    np.testing.assert_allclose(modes.amplitudes.sum(1), START)
    np.testing.assert_allclose(modes.amplitudes @ modes.rates, MATRIX @ START)


def test_the_closed_form_of_the_autocorrelation_is_the_limit_of_the_sum():
    modes, step, duration = free_modes(MATRIX, START), 0.02, 800.0
    motion = modes.motion(step * np.arange(int(duration / step)))
    ours = autocorrelation(motion, 1000)[:, ::250]
    formula = modes.autocorrelation(250 * step * np.arange(5), duration)
    np.testing.assert_allclose(ours, formula, rtol=5e-3)


def test_one_exponential_has_the_autocorrelation_of_the_source():
    modes = free_modes(np.array([[-0.04]]), np.array([2.0]))
    lag = np.array([0.0, 10.0])
    np.testing.assert_allclose(modes.autocorrelation(lag, 100.0)[0], 4.0 / (2 * 0.04 * 100) * np.exp(-0.04 * lag))


def test_modes_of_a_swinging_motion_are_refused():
    with pytest.raises(InputError, match="modes are for real roots"):
        free_modes(np.array([[0.0, -1.0], [1.0, 0.0]]), START)


def test_the_signature_of_a_gaussian_record_is_its_autocorrelation():
    kernel = np.exp(-0.05 * np.arange(200)) * np.cos(0.3 * np.arange(200))
    record = np.convolve(noise(5, 400_000), kernel, "valid")
    level = float(record.std())
    signature, count = random_decrement(record, level, 40)
    relation = autocorrelation(record, 40)
    assert count > 10_000
    np.testing.assert_allclose(signature, level * relation / relation[0], atol=0.03 * level)


def test_the_signature_in_white_noise_is_the_free_decay():
    decay = 0.95
    record = [0.0]
    for push in noise(6, 300_000):
        record.append(decay * record[-1] + push)
    level = float(np.std(record))
    signature, _ = random_decrement(np.array(record), level, 30)
    np.testing.assert_allclose(signature, level * decay ** np.arange(31), atol=0.06 * level)


def test_the_signature_begins_at_the_level_and_takes_both_directions():
    time = 0.1 * np.arange(2000)
    signature, count = random_decrement(np.sin(time), 0.5, 5)
    assert signature[0] == approx(0.5)
    assert count in (62, 63, 64)
    # One piece in two rises and one falls: only the even part stays.
    np.testing.assert_allclose(signature, 0.5 * np.cos(0.1 * np.arange(6)), atol=0.02)


def test_records_that_do_not_serve_are_refused():
    with pytest.raises(InputError, match="write 1 to 9"):
        autocorrelation(np.ones(10), 10)
    with pytest.raises(InputError, match="write a level between 0 and 1"):
        random_decrement(np.linspace(0, 1, 50), 2.0, 5)
