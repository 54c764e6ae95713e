"""A recording made ready: the rudder freed of noise, the time of orders, the shaft speed."""

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.preparation import order_lead, smooth_rudder, smooth_shaft

RATE = 2.5 * DEGREE
NOISE = 0.1 * DEGREE
TIME = np.arange(0.0, 200.0)


def gear(given: list[tuple[float, float]], time=TIME, rate=RATE) -> tuple[np.ndarray, np.ndarray]:
    """Orders (time, angle in degrees) and what a perfect indicator shows, in closed form between orders."""
    order, shown = np.zeros_like(time), np.zeros_like(time)
    angle, began, now = 0.0, 0.0, 0.0
    for start, degrees in [*given, (np.inf, 0.0)]:
        here = (time >= began) & (time < start)
        order[here] = now
        shown[here] = angle + np.clip(now - angle, -rate * (time[here] - began), rate * (time[here] - began))
        if np.isfinite(start):
            angle += float(np.clip(now - angle, -rate * (start - began), rate * (start - began)))
        began, now = start, degrees * DEGREE
    return order, shown


ZIGZAG = [(20.4, 20.0), (60.7, -20.0), (120.2, 20.0), (160.5, 0.0)]


def noisy(shown: np.ndarray, seed: int = 0) -> np.ndarray:
    return shown + NOISE * np.random.default_rng(seed).standard_normal(len(shown))


def test_a_rudder_at_rest_is_averaged_and_a_turning_one_is_left_as_recorded():
    order, shown = gear(ZIGZAG)
    recorded = noisy(shown)
    smooth, noise = smooth_rudder(recorded, order, 1.0, RATE)
    # Twenty degrees need 8 s, forty 16 s.
    turning = np.zeros(len(TIME), dtype=bool)
    for start, length in ((20.4, 8.0), (60.7, 16.0), (120.2, 16.0), (160.5, 8.0)):
        turning |= (start - 0.4 <= TIME) & (start + length >= TIME)
    assert np.array_equal(smooth[turning], recorded[turning])
    rests = np.r_[0:19, 32:59, 81:119, 141:159, 173:200]
    assert (smooth - shown)[rests].std() < 0.4 * NOISE < 0.8 * NOISE < (recorded - shown)[rests].std()
    assert noise == approx(NOISE, rel=0.2)


@pytest.mark.parametrize("late", [12.0, 30.0])
def test_an_indicator_that_is_late_is_left_where_it_moves(late):
    """Long after the nominal gear has arrived: no outliers of a rudder at rest."""
    order, shown = gear([(20.0, 20.0), (90.0, -20.0)])
    shown = np.interp(TIME - late, TIME, shown)
    smooth, _ = smooth_rudder(noisy(shown), order, 1.0, RATE)
    assert np.abs(smooth - shown).max() < 4 * NOISE


def test_the_noise_of_the_indicator_is_found_over_many_recordings():
    order, shown = gear(ZIGZAG)
    found = [smooth_rudder(noisy(shown, seed), order, 1.0, RATE)[1] for seed in range(20)]
    # Means of some fifteen samples take a thirtieth of the noise with them.
    assert np.mean(found) == approx(NOISE, rel=0.08)


def test_a_perfect_indicator_is_left_as_it_is():
    order, shown = gear(ZIGZAG)
    smooth, noise = smooth_rudder(shown, order, 1.0, RATE)
    assert smooth == approx(shown, abs=1e-12) and noise == approx(0.0, abs=1e-12)


def test_a_rudder_that_turns_from_the_first_sample_on_is_not_blurred():
    """A recording that begins with the order: the indicator is not yet where the order is."""
    order, shown = gear([(0.0, 20.0), (60.7, -20.0)])
    recorded = noisy(shown)
    smooth, noise = smooth_rudder(recorded, order, 1.0, RATE)
    assert np.array_equal(smooth[:8], recorded[:8]) and noise == approx(NOISE, rel=0.2)


def test_a_spike_at_rest_does_not_move_the_mean():
    order, shown = gear(ZIGZAG)
    recorded = noisy(shown)
    spiked = recorded.copy()
    spiked[100] += 10 * DEGREE
    assert smooth_rudder(spiked, order, 1.0, RATE)[0][94:107] == approx(
        smooth_rudder(recorded, order, 1.0, RATE)[0][94:107], abs=0.3 * NOISE
    )


def test_a_rudder_that_never_rests_is_kept_and_has_no_noise():
    order = 0.1 * np.sin(TIME)
    recorded = noisy(order)
    smooth, noise = smooth_rudder(recorded, order, 1.0, RATE)
    assert np.array_equal(smooth, recorded) and noise == 0.0


@pytest.mark.parametrize("step", [0.5, 1.0])
@pytest.mark.parametrize("start", [20.1, 20.3, 20.55, 20.8])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_time_of_an_order_is_found_to_a_tenth_of_a_second(start, side, step):
    time = np.arange(0.0, 60.0, step)
    order, shown = gear([(start, 15.0 * side)], time)
    k = int(np.flatnonzero(time >= start)[0])
    exact = order_lead(shown, order, step, RATE)
    assert exact[k] * step == approx(time[k] - start, abs=1e-9)
    rough = np.array([order_lead(noisy(shown, seed), order, step, RATE)[k] for seed in range(40)])
    errors = rough * step - (time[k] - start)
    assert np.sqrt(np.mean(errors**2)) < 0.1
    assert np.flatnonzero(exact).tolist() == [k], "0 where no order was given"


def test_orders_that_the_gear_follows_within_a_sample_have_no_time():
    order = np.where(TIME >= 20, 2.0 * DEGREE, 0.0)
    assert not order_lead(order, order, 1.0, RATE).any()


def test_a_shaft_that_stays_nominal_is_nominal():
    g = np.random.default_rng(0)
    assert (smooth_shaft(1 + 0.004 * g.standard_normal(300)) == 1).all()
    assert (smooth_shaft(np.full(300, np.nan)) == 1).all()


def test_a_shaft_that_slows_down_is_followed_through_noise_gaps_and_spikes():
    g = np.random.default_rng(0)
    true = 1 - 0.2 * (1 - np.exp(-np.clip(TIME - 50, 0, None) / 40))
    recorded = true + 0.004 * g.standard_normal(len(TIME))
    recorded[80:90] = np.nan
    recorded[[30, 120]] = 0.2, 3.0
    smooth = smooth_shaft(recorded)
    assert np.isfinite(smooth).all() and np.abs(smooth - true).max() < 0.012
    assert (smooth - true).std() < 0.003
