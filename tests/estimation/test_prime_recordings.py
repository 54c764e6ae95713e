"""Recordings in units of L and the approach speed."""

from dataclasses import replace

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.recorded_inputs import air_velocity, approach_speed
from manoeuvre_nn.estimation.prime_recordings import averaged, to_prime
from manoeuvre_nn.estimation.problem import CHANNELS, measured_motion
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars


def straight(speed=SHIP.speed, seconds=400.0, step=0.25, **more):
    time = np.arange(0, seconds, step)
    flat = np.zeros_like(time)
    channels = {"u": flat + speed, "v": flat, "r": flat + 0.001, "x": speed * time, "y": flat, "psi": 0.001 * time}
    return Recording("run", time, {**channels, "delta": flat + 0.1, **more})


def test_units_are_length_and_approach_speed():
    (track,) = to_prime([straight(speed=0.5 * SHIP.speed)], SHIP, 80.0, "approach")
    np.testing.assert_allclose(track["u"], 1.0)
    np.testing.assert_allclose(np.diff(track["x"]) / np.diff(track.time), 1.0)
    np.testing.assert_allclose(np.diff(track["psi"]) / np.diff(track.time), track["r"][1:])
    assert np.median(np.diff(track.time)) == pytest.approx(0.05, abs=0.01)


def test_with_a_shaft_law_the_speed_is_the_ships_and_n_is_what_was_recorded():
    flat = np.ones(1600)
    (known,) = to_prime([straight(speed=0.5 * SHIP.speed, n=flat)], SHIP, 120.0, "shaft")
    np.testing.assert_allclose(known["u"], 0.5)
    np.testing.assert_allclose(known["n"], 0.5)
    (guessed,) = to_prime([straight(speed=0.5 * SHIP.speed)], SHIP, 120.0, "shaft")
    np.testing.assert_allclose(guessed["n"], 0.5)


def test_a_ship_at_rest_begins_with_its_own_speed():
    assert approach_speed(straight(speed=0.01), SHIP) == SHIP.speed
    assert approach_speed(straight(speed=1.01 * SHIP.speed), SHIP) == SHIP.speed
    assert approach_speed(straight(speed=0.6 * SHIP.speed), SHIP) == pytest.approx(0.6 * SHIP.speed)


def test_means_are_kept_when_a_recording_is_averaged():
    run = straight(u=np.random.default_rng(0).standard_normal(1600))
    slow = averaged(run, 1.0)
    assert len(slow) == 400
    np.testing.assert_allclose(slow["u"], run["u"].reshape(400, 4).mean(1))
    np.testing.assert_allclose(slow.time, run.time.reshape(400, 4).mean(1))
    assert averaged(run, 0.3) is run


def test_derived_channels_are_a_guess_and_no_measurement():
    run = replace(straight(), meta={"derived": ("u", "r")})
    (track,) = to_prime([run], SHIP, 80.0, "approach")
    measured = measured_motion(track)
    assert np.isnan(measured[:, [0, 2]]).all() and not np.isnan(measured[:, [1, 3, 4, 5]]).any()
    assert np.isfinite(track.stacked(*CHANNELS)).all()


def test_pieces_astern_are_left_out_where_the_propeller_counts():
    n = np.where(np.abs(np.arange(1600) - 800) < 100, -1.0, 1.0)
    pieces = to_prime([straight(n=n)], SHIP, 60.0, "shaft")
    assert len(pieces) == 2 and all((p["n"] > 0).all() for p in pieces)
    with pytest.raises(InputError, match="3 L/U0 of motion ahead"):
        to_prime([straight(n=-np.ones(1600))], SHIP, 60.0, "shaft")


def test_a_wind_that_sets_in_at_once_is_there_after_half_the_time_in_which_the_ship_sails_her_length():
    time = np.arange(1600) * 0.25
    north, _ = air_velocity(straight(wind_speed=8.0 * (time > 200.0), wind_from=np.zeros(1600)), SHIP)
    rising = time[(north < -0.01) & (north > -7.99)]
    assert np.ptp(rising) + 2 * 0.25 == pytest.approx(0.5 * SHIP.length / SHIP.speed, abs=0.3)
    assert rising.mean() == pytest.approx(200.0, abs=0.3)


def test_wind_from_the_north_blows_to_the_south_and_gusts_are_averaged():
    time = np.arange(1600) * 0.25
    run = straight(wind_speed=8.0 + np.sin(20 * time), wind_from=np.zeros(1600))
    north, east = air_velocity(run, SHIP)
    assert north.mean() == pytest.approx(-8.0, abs=0.01) and np.abs(east).max() < 1e-12
    assert north.std() < 0.1 * np.std(run["wind_speed"])
    assert not any(a.any() for a in air_velocity(straight(), SHIP))


def test_pieces_in_which_a_ship_hardly_goes_ahead_are_left_out_where_the_shaft_is_known():
    """From an eighth of U0 and a hundredth of the shaft speed on a model of ships that go ahead is held to data."""
    speed, turns = SHIP.speed, np.ones(1600)
    for u, n, kept in ((0.13, 0.02, True), (0.12, 0.02, False), (0.13, 0.009, False)):
        run = straight(speed=u * speed, n=n * turns * SHIP.rpm / 60)
        if kept:
            (track,) = to_prime([run], SHIP, SHIP.rpm, "shaft")
            np.testing.assert_allclose(track["u"], u)
        else:
            with pytest.raises(InputError, match="motion ahead in one piece"):
                to_prime([run], SHIP, SHIP.rpm, "shaft")
        assert len(to_prime([run], SHIP, SHIP.rpm, "approach")) == 1
