"""Delays, offsets and scales: their errors are honest, and stories that say the same are told the simplest way."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.check.identities import Identities
from manoeuvre_nn.recording.check.sensor_faults import fewest_delays, measure_faults, possible_faults
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.ship.mariner import mariner_corrected

NOISE = {"u": 0.05, "v": 0.05, "r": 0.02 * DEGREE, "x": 0.7, "y": 0.7, "psi": 0.1 * DEGREE}
SHIP = mariner_corrected()
FAULTS = (
    "delay of r", "delay of u, v", "delay of x, y", "offset of r", "scale of r", "offset of psi", "scale of u",
    "current north",
)  # fmt: skip


@pytest.fixture(scope="module")
def clean():
    with unchecked():
        (run,) = roll_out(CalmWater(SHIP), [zigzag(20.0, duration=300.0)], step=0.5)
    return run.resampled(np.arange(0.0, 300.1, 1.0))


def late(run, seconds, *names):
    return run.with_channels(**{k: np.interp(run.time - seconds, run.time, run[k]) for k in names})


def spoilt(run):
    """Truth -> what is measured of it, one fault at a time."""
    drift = 0.3 * run.time
    return {
        "delay of r": (late(run, 0.7, "r"), 0.7),
        "delay of u, v": (late(run, 1.5, "u", "v"), 1.5),
        "delay of x, y": (late(run, 0.8, "x", "y"), 0.8),
        "offset of r": (run.with_channels(r=run["r"] + 0.05 * DEGREE), 0.05 * DEGREE),
        "scale of r": (run.with_channels(r=run["r"] / 1.05), 0.05),
        "offset of psi": (run.with_channels(psi=run["psi"] + 2 * DEGREE), 2 * DEGREE),
        "scale of u": (run.with_channels(u=run["u"] / 1.05), 0.05),
        "current north": (run.with_channels(x=run["x"] + drift), 0.3),
    }


def pulls(run, name, value, count):
    """Errors over standard errors, one a noisy record."""
    found = []
    for seed in range(count):
        identities = Identities(add_noise(run, NOISE, seed=seed), SHIP.particulars)
        first = identities.estimate([name], identities.noise([name]))
        one = identities.estimate([name], identities.noise([name], first.values))
        found.append((one.values[name] - value) / one.errors[name])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_standard_errors_are_honest_over_many_records(clean, name):
    run, value = spoilt(clean)[name]
    with unchecked():
        found = pulls(run, name, value, 150)
    assert 0.7 < found.std() < 1.3 and abs(found.mean()) < 0.4


def test_standard_errors_are_honest_over_a_few_records(clean):
    for name in ("delay of r", "current north"):
        run, value = spoilt(clean)[name]
        with unchecked():
            found = pulls(run, name, value, 25)
        assert 0.6 < found.std() < 1.5 and abs(found.mean()) < 0.6


def test_three_late_sensors_are_told_as_one_early_one(clean):
    """Heading, rate and log that are all late are positions that are early."""
    run = add_noise(late(clean, 1.5, "u", "v", "r", "psi"), NOISE, seed=1)
    with unchecked():
        found = [m for m in measure_faults(run, SHIP.particulars) if m.found]
    assert [m.name for m in found] == ["delay of x, y"]
    assert found[0].size == pytest.approx(-1.5, abs=4 * found[0].size_error)


def test_the_fewest_delays_that_explain_as_much_are_kept(clean):
    run = add_noise(late(clean, 1.5, "u", "v", "r", "psi"), NOISE, seed=1)
    with unchecked():
        identities = Identities(run, SHIP.particulars)
        faults = possible_faults(run, SHIP.particulars, identities)
        three = [f for f in faults if f.name in {"delay of r", "delay of psi", "delay of u, v"}]
        noise = identities.noise([part for f in three for part in f.parts])
        kept = fewest_delays(identities, three, faults, noise)
    assert [f.name for f in kept] == ["delay of x, y"]


def test_on_a_straight_course_nothing_is_claimed():
    with unchecked():
        (run,) = roll_out(CalmWater(SHIP), [straight(duration=200.0)], step=0.5)
        run = add_noise(run.resampled(np.arange(0.0, 200.1, 1.0)), NOISE, seed=1)
        measured = {m.name: m for m in measure_faults(run, SHIP.particulars)}
    assert not any(m.found for m in measured.values())
    lag = measured["delay of r"]
    assert lag.size_error > lag.matters or not np.isfinite(lag.size_error)


def test_jumps_of_the_positions_do_not_mislead(clean):
    run = add_noise(late(clean, 0.7, "r"), NOISE, seed=1)
    x = run["x"].copy()
    x[100:104] += 40.0
    with unchecked():
        found = [m.name for m in measure_faults(replace(run.with_channels(x=x)), SHIP.particulars) if m.found]
    assert found == ["delay of r"]
