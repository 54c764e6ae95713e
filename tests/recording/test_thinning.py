"""Records with more samples than motion needs are averaged for the checks, and these say the same of them."""

import numpy as np
import pytest

from manoeuvre_nn.recording.check.axes import rudder_effect
from manoeuvre_nn.recording.check.sensor_faults import measure_faults
from manoeuvre_nn.recording.thinning import SAMPLES_PER_TIME_UNIT, thinned


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


def test_a_delay_and_the_rudders_effect_are_those_of_the_whole_record(dense, ship):
    fewer = thinned(dense, ship)
    whole, part = ({m.name: m for m in measure_faults(r, ship)}["delay of r"] for r in (dense, fewer))
    assert part.found and part.value[0] == pytest.approx(1.0, abs=4 * part.error[0])
    assert part.value[0] == pytest.approx(whole.value[0], abs=part.error[0])
    effects = [rudder_effect(r, ship)[0] for r in (dense, fewer)]
    assert effects[1] == pytest.approx(effects[0], rel=0.05) and effects[1] > 0
