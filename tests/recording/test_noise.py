from dataclasses import replace

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.recording.noise import add_noise, resample


def test_the_noise_has_the_standard_deviation_that_was_asked_for(zz20):
    fine = zz20.resampled(np.arange(0, 360, 0.05))
    noise = add_noise(fine, {"u": 0.2})["u"] - fine["u"]
    assert noise.std() == pytest.approx(0.2, rel=0.05)
    assert abs(noise.mean()) < 0.01
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.05


def test_noise_on_one_channel_does_not_change_that_of_another(zz20):
    alone, both = add_noise(zz20, {"u": 0.1}, seed=4), add_noise(zz20, {"v": 0.1, "u": 0.1}, seed=4)
    np.testing.assert_array_equal(alone["u"], both["u"])
    noises = [both[k] - zz20[k] for k in ("u", "v")]
    assert abs(np.corrcoef(*noises)[0, 1]) < 0.2


def test_the_same_seed_gives_the_same_noise_and_another_another(zz20):
    first, again, other = (add_noise(zz20, {"r": 0.01}, seed=s)["r"] for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.001


def test_no_noise_changes_nothing(zz20):
    np.testing.assert_array_equal(add_noise(zz20, {"u": 0.0})["u"], zz20["u"])


@pytest.mark.parametrize(
    ("sd", "message"), [({"u": -1.0}, "0 or more"), ({"yaw": 1.0}, "noise of yaw: recording zz20 has no such channel")]
)
def test_noise_that_makes_no_sense_is_refused(zz20, sd, message):
    with pytest.raises(InputError, match=message):
        add_noise(zz20, sd)


def test_resampling_keeps_the_samples_that_both_rates_share(zz20):
    half = resample(zz20, 0.5)
    np.testing.assert_allclose(half.time, zz20.time[::2])
    np.testing.assert_allclose(half["psi"], zz20["psi"][::2])


def test_a_record_whose_last_time_was_rounded_down_keeps_its_last_sample(zz20):
    times = np.append(zz20.time[:-1], zz20.time[-1] - 2e-7)  # as a file with nine digits has it
    again = resample(replace(zz20, time=times), 1.0)
    assert len(again) == len(zz20) and again.time[-1] == times[-1]


@pytest.mark.parametrize("rate", [0.0, -1.0, 2.0])
def test_a_rate_that_the_recording_does_not_have_is_refused(zz20, rate):
    with pytest.raises(InputError, match="has 1 samples a second: write that or less"):
        resample(zz20, rate)


def test_a_rate_that_leaves_nothing_is_refused(zz20):
    with pytest.raises(InputError, match="write a higher rate"):
        resample(zz20, 0.001)


def test_velocities_over_ground_carry_the_noise_of_u_and_v_and_the_log_has_its_own(zz20):
    sailed = zz20.with_channels(
        **dict(zip(("vn", "ve"), body_to_earth(zz20["u"], zz20["v"], zz20["psi"]), strict=True))
    )
    noisy = add_noise(sailed.with_channels(u_log=zz20["u"]), {"u": 0.1, "v": 0.05})
    u, v = earth_to_body(noisy["vn"], noisy["ve"], noisy["psi"])
    np.testing.assert_allclose(u, noisy["u"])
    np.testing.assert_allclose(v, noisy["v"])
    own = noisy["u_log"] - zz20["u"]
    assert 0.07 < own.std() < 0.13
    assert abs(np.corrcoef(own, noisy["u"] - zz20["u"])[0, 1]) < 0.3
