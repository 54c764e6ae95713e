"""All channels at once: nearer to the truth than one by one, by as much as it says; late and shifted sensors; gaps."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.estimation.smoother import STATES, smoothed_jointly
from manoeuvre_nn.recording.noise import add_noise

RATES = ("udot", "vdot", "rdot")
SENSORS = {"u": 0.02, "v": 0.02, "r": 4e-4, "psi": 0.005, "x": 0.5, "y": 0.5}


@pytest.fixture(scope="module")
def noisy(zz35):
    return add_noise(zz35, SENSORS, seed=3)


def without(recording, *names):
    return replace(recording, channels={k: c for k, c in recording.channels.items() if k not in names})


def misses(found, truth, names=STATES):
    return {k: float(np.sqrt(np.mean((found[k] - truth[k]) ** 2))) for k in names}


def test_it_is_nearer_to_the_truth_than_a_filter_of_each_channel(zz35, noisy):
    joint, each = (misses(accelerations(noisy, m), zz35) for m in ("joint", "smoother"))
    assert all(joint[k] < 0.85 * each[k] for k in STATES)


def test_it_is_wrong_by_as_much_as_it_says(zz35):
    pulls = []
    for seed in range(6):
        found = accelerations(add_noise(zz35, SENSORS, seed), "joint")
        pulls.append([(found[k] - zz35[k]) / found[f"{k}_sd"] for k in STATES])
    scatter = np.sqrt(np.mean(np.square(pulls), axis=(0, 2)))
    assert scatter == approx(1.0, abs=0.3)


def test_noise_of_the_sensors_is_found(noisy):
    found = smoothed_jointly(noisy).meta["sensor_noise"]
    assert {k: found[k] / SENSORS[k] for k in SENSORS} == approx(dict.fromkeys(SENSORS, 1.0), abs=0.12)


@pytest.mark.parametrize("name", mainly(1, ["r", "psi"]))
def test_a_late_sensor_is_found_and_what_it_wrote_is_moved_back(zz35, noisy, name):
    late = noisy.with_channels(**{name: np.interp(zz35.time - 2.0, zz35.time, noisy[name])})
    found = accelerations(late, "joint", delays=[name])
    delay, error = found.meta["delays"][name]
    assert error < 0.1 and abs(delay - 2.0) < 4 * error
    moved_back, in_time = misses(found, zz35), misses(accelerations(noisy, "joint"), zz35)
    assert all(moved_back[k] < 1.1 * in_time[k] for k in ("psi", "r", "rdot"))
    assert misses(accelerations(late, "joint"), zz35)[name] > 1.3 * misses(found, zz35)[name]


def test_a_shifted_sensor_is_found(zz35, noisy):
    found = accelerations(noisy.with_channels(r=noisy["r"] + 5e-4), "joint", offsets=["r"])
    offset, error = found.meta["offsets"]["r"]
    assert error < 1e-4 and abs(offset - 5e-4) < 4 * error
    assert abs(np.mean(found["r"] - zz35["r"])) < 1e-4


def test_uneven_times_are_taken_as_they_are(zz35, noisy):
    kept = np.sort(np.random.default_rng(0).choice(len(zz35), 250, replace=False))
    thin, truth = (replace(r, time=r.time[kept], channels={k: c[kept] for k, c in r.channels.items()})
                   for r in (noisy, zz35))  # fmt: skip
    found = accelerations(thin, "joint")
    np.testing.assert_array_equal(found.time, thin.time)
    error = misses(found, truth)
    assert max(error[k] / truth[k].std() for k in RATES) < 0.12
    assert error["psi"] < 0.7 * SENSORS["psi"] and error["x"] < 0.7 * SENSORS["x"]


def test_fast_recordings_are_averaged_and_read_off_at_their_own_times(zz35):
    time = np.arange(0.0, 200.0, 0.1)
    fine = zz35.resampled(time)
    found = accelerations(add_noise(fine, SENSORS), "joint")
    assert len(found) == 2000 and max(misses(found, fine, RATES)[k] / fine[k].std() for k in RATES) < 0.06
    assert misses(found, fine, ("psi",))["psi"] < 0.3 * SENSORS["psi"]


def test_velocities_alone_are_enough(zz35, noisy):
    found = accelerations(without(noisy, "x", "y", "psi"), "joint")
    assert not {"x", "psi", "x_sd"} & set(found.channels) and "rdot_sd" in found.channels
    assert max(misses(found, zz35, RATES)[k] / zz35[k].std() for k in RATES) < 0.1


def test_what_was_derived_is_not_taken_for_a_measurement(zz35, noisy):
    """Rates of turn that were made of the heading would be counted twice, and be believed for it."""
    spoilt = noisy.with_channels(r=noisy["r"] + 0.01 * np.sin(zz35.time))
    told = replace(spoilt, meta={**spoilt.meta, "derived": ("r",)})
    found, error = accelerations(told, "joint"), misses(accelerations(without(noisy, "x", "y"), "joint"), zz35, ("r",))
    assert misses(found, zz35, ("r",))["r"] < 3 * error["r"]
    assert "r" not in found.meta["sensor_noise"]


def test_an_outlier_does_little(zz35, noisy):
    spoilt = noisy["r"].copy()
    spoilt[150] += 0.05
    found = accelerations(noisy.with_channels(r=spoilt), "joint")
    assert abs(found["r"][150] - zz35["r"][150]) < 5e-4


def test_the_rest_of_the_recording_is_left_as_it_is(noisy):
    found = accelerations(noisy, "joint")
    np.testing.assert_array_equal(found["delta"], noisy["delta"])
    assert found.meta["ship"] == noisy.meta["ship"] and found.name == noisy.name


def test_what_it_cannot_do_is_refused(noisy):
    with pytest.raises(InputError, match=r"L/U0 \(meta time_unit\), .* write accelerations=smoother"):
        accelerations(replace(noisy, meta={}), "joint")
    with pytest.raises(InputError, match=r"data.delays: recording zz35 has no sensor of psi: leave psi out"):
        accelerations(without(noisy, "psi"), "joint", delays=["psi"])
    with pytest.raises(
        InputError, match=r"data.offsets=\[r\] is estimated by data.accelerations=joint only, not by cen"
    ):
        accelerations(noisy, "central", offsets=["r"])
    with pytest.raises(InputError, match="data.offsets 'delta' is unknown"):
        accelerations(noisy, "joint", offsets=["delta"])
