"""Records with more samples than motion needs are averaged for the checks, and these say the same of them."""

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.recording import Recording, followed
from manoeuvre_nn.recording import thinning
from manoeuvre_nn.recording.check.axes import rudder_effect
from manoeuvre_nn.recording.check.sensor_faults import measure_faults
from manoeuvre_nn.recording.thinning import SAMPLES_PER_TIME_UNIT, averaged, samples_apart, thinned


@pytest.fixture(scope="module")
def dense(zz20):
    """The zigzag at 50 Hz, its rate 1 s late, with noise."""
    times, stream = np.arange(0.0, zz20.duration, 0.02), np.random.default_rng(0)
    run = zz20.resampled(times)
    noise = {"u": 0.05, "v": 0.05, "r": 2e-4, "x": 0.5, "y": 0.5, "psi": 2e-3}
    late = np.interp(times - 1.0, times, run["r"])
    return run.with_channels(**{
        k: (late if k == "r" else run[k]) + s * stream.standard_normal(len(times)) for k, s in noise.items()
    })


def test_a_record_that_is_not_dense_is_left_as_it_is(zz20, ship):
    assert thinned(zz20, ship) is zz20


def test_averages_are_those_of_as_many_samples_as_are_not_needed(dense, ship):
    count = int(ship.time_unit / (SAMPLES_PER_TIME_UNIT * 0.02))
    fewer = thinned(dense, ship)
    assert count == 2 and len(fewer) == len(dense) // count
    assert fewer["u"][7] == pytest.approx(dense["u"][14:16].mean()) and fewer.time[7] == pytest.approx(0.29)
    assert ship.time_unit / np.diff(fewer.time).max() >= SAMPLES_PER_TIME_UNIT * (1 - 1e-9)
    assert fewer.meta == dense.meta


def test_uneven_times_and_gaps_stay_what_they_are(dense, ship):
    """Averages of neighbours, whatever lies between them: nothing is moved or made up of what is checked."""
    shaken = np.sort(dense.time + 0.009 * np.random.default_rng(5).uniform(-1, 1, len(dense)))
    gaps = dense["r"].copy()
    gaps[14] = np.nan
    fewer = thinned(Recording("uneven", shaken, {**dense.channels, "r": gaps}), ship)
    assert fewer.time[7] == approx(shaken[14:16].mean()) and np.flatnonzero(np.isnan(fewer["r"])).tolist() == [7]
    assert fewer["delta"][7] == approx(dense["delta"][14:16].mean())


def test_a_delay_and_the_rudders_effect_are_those_of_the_whole_record(dense, ship):
    fewer = thinned(dense, ship)
    whole, part = ({m.name: m for m in measure_faults(r, ship)}["delay of r"] for r in (dense, fewer))
    assert part.found and part.value[0] == pytest.approx(1.0, abs=4 * part.error[0])
    assert part.value[0] == pytest.approx(whole.value[0], abs=part.error[0])
    effects = [rudder_effect(r, ship)[0] for r in (dense, fewer)]
    assert effects[1] == pytest.approx(effects[0], rel=0.05) and effects[1] > 0


def record(**channels):
    """Channels of one sample a second, the rudder amidships without orders if nothing else is said."""
    longest = max(map(len, channels.values()))
    given = dict.fromkeys(("delta", "delta_order", "order_lead"), np.zeros(longest)) | channels
    return Recording("made", np.arange(float(longest)), {k: np.asarray(v, dtype=float) for k, v in given.items()})


def test_of_a_straight_line_averages_lie_on_it_whatever_samples_lack():
    """Where the line is left for more than five samples nothing is made up."""
    line = 3.0 + 0.7 * np.arange(60.0)
    gaps = line.copy()
    gaps[[4, 11, 12, 20, 21, 22]], gaps[40:52] = np.nan, np.nan
    sparse = np.where(np.arange(60) % 5 == 0, line, np.nan)
    few = averaged(record(x=gaps, y=sparse), 3)
    at = 3.0 + 0.7 * few.time
    there = np.isfinite(few["x"])
    assert few["x"][there] == approx(at[there]) and list(np.flatnonzero(~there)) == [13, 14, 15, 16]
    seen = np.isfinite(few["y"])
    assert few["y"][seen] == approx(at[seen]) and seen.sum() == 12


def test_samples_that_are_moved_keep_their_noise():
    """A receiver every 2 s beside a gyro every second; along lines from sample to sample .79 of it would be left."""
    noise = np.random.default_rng(3).standard_normal(60_000)
    few = averaged(record(x=np.where(np.arange(len(noise)) % 2 == 0, noise, np.nan), r=noise), 2)
    assert few.time[0] == 0.5 and few["x"].std() == approx(1.0, rel=0.02)
    assert np.corrcoef(few["x"][1:], few["x"][:-1])[0, 1] == approx(0.0, abs=0.03)
    curved = np.where(np.arange(240) % 2 == 0, np.sin(2 * np.pi * np.arange(240) / 120), np.nan)
    few = averaged(record(x=curved, r=noise[:240]), 2)
    assert few["x"][2:-2] == approx(np.sin(2 * np.pi * few.time[2:-2] / 120), abs=1e-3)


def test_a_slope_is_of_samples_that_are_near():
    time, values = np.array([0.0, 1.0, 2.0, 3.0, 30.0, 31.0, 60.0]), np.array([0.0, 1.0, 3.0, 6.0, 5.0, 3.0, 9.0])
    assert thinning._slopes(time, values, 5.5) == approx([1.5, 2.0, 2.0, 2.5, -2.0, -2.0, 0.0])


@pytest.mark.parametrize("apart, count, offset", [(2, 2, 0), (2, 2, 1), (4, 2, 1), (6, 3, 2), (4, 4, 3), (1, 1, 0)])
def test_samples_rarer_than_times_stay_as_they_were_taken_and_when(apart, count, offset):
    """Here and there one lacks, and the shaft, which is always known, tells nothing of that."""
    noise = np.random.default_rng(4).standard_normal(120)
    noise[(np.arange(120) % apart != offset) | (np.arange(120) // apart == 7)] = np.nan
    run = record(r=noise, shaft=np.ones(120))
    few, taken = averaged(run, count), np.isfinite(noise)
    seen = np.isfinite(few["r"])
    assert samples_apart(run) == apart
    assert few["r"][seen].tolist() == noise[taken].tolist() and few.time[seen].tolist() == run.time[taken].tolist()


def test_noise_of_averages_is_that_of_their_mean():
    noise = np.random.default_rng(3).standard_normal(30_000)
    few = averaged(record(r=noise), 2)
    assert few["r"].std() == approx(np.sqrt(0.5), rel=0.02)
    assert np.corrcoef(few["r"][1:], few["r"][:-1])[0, 1] == approx(0.0, abs=0.03)


def test_the_rudder_of_fewer_samples_moves_a_slow_ship_as_the_whole_one_does():
    """Behind a first-order lag of ten steps, ``T v' + v = d``; averages miss it three times as much."""
    time = np.arange(241.0)
    order = np.select([time < 31, time < 74, time < 125, time < 168], [0.0, 0.35, -0.35, 0.2], 0.0)
    delta = followed(time, order, 0.043)
    run = record(delta=delta, delta_order=order)

    def behind(at, angle):
        fine = np.arange(0.0, 240.0, 0.05)
        d, v = np.interp(fine, at, angle), np.zeros(len(fine))
        for k in range(1, len(fine)):
            v[k] = v[k - 1] + 0.05 / 20.0 * (0.5 * (d[k] + d[k - 1]) - v[k - 1])
        return v

    few = averaged(run, 2)
    means = delta[:240].reshape(-1, 2).mean(axis=1)
    whole = behind(time, delta)
    missed = [np.abs(behind(few.time, angle) - whole)[:4700].max() for angle in (few["delta"], means)]
    assert missed[0] < 0.34 * missed[1] and missed[0] < 3e-4
    assert few["delta"] == approx(means, abs=0.02)


def test_an_order_is_in_force_from_when_it_was_given():
    order = np.where(np.arange(40) < 13, 0.0, 0.3)
    lead = np.where(np.arange(40) == 13, 0.25, 0.0)  # a quarter of a second before sample 13
    few = averaged(record(delta=0.0 * order, delta_order=order, order_lead=lead), 2)
    (came,) = np.flatnonzero(np.diff(few["delta_order"])) + 1
    step = few.time[1] - few.time[0]
    assert step == 2.0 and few.time[came] - few["order_lead"][came] * step == approx(12.75)
    assert np.count_nonzero(few["order_lead"]) == 1


def test_too_few_samples_are_left_as_they_are():
    run = record(r=np.arange(7.0))
    assert averaged(run, 2) is run and averaged(run, 1) is run
