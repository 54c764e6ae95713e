"""Axes, units, prime systems, recordings and the errors that a person sees."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body, kinematics
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.prime import bis_system, length_system
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM
from manoeuvre_nn.ship.mariner import WANG


def made(n=5):
    t = np.arange(float(n))
    return Recording("made", t, {"u": t + 1.0, "psi": 0.1 * t})


def test_a_ship_heading_east_moves_east_and_drifts_south_to_starboard():
    state = torch.tensor([5.0, 1.0, 0.02, 0.0, 0.0, np.pi / 2], dtype=torch.float64)
    assert kinematics(state).tolist() == approx([-1.0, 5.0, 0.02])


def test_body_and_earth_axes_are_each_others_inverse_and_keep_lengths():
    u, v, psi = (np.random.default_rng(0).normal(size=10) for _ in range(3))
    north, east = body_to_earth(u, v, psi)
    assert np.hypot(north, east) == approx(np.hypot(u, v))
    back = earth_to_body(north, east, psi)
    assert back[0] == approx(u) and back[1] == approx(v)


def test_earth_axes_agree_with_the_kinematics():
    u, v, psi = np.array([3.0]), np.array([-1.0]), np.array([2.5])
    north, east = body_to_earth(u, v, psi)
    rates = kinematics(torch.tensor([3.0, -1.0, 0.0, 0.0, 0.0, 2.5], dtype=torch.float64))
    assert rates[:2].tolist() == approx([north[0], east[0]])


def test_units_are_the_defined_ones():
    assert 15.990 * KNOT == approx(8.226, abs=1e-3)
    assert (180 * DEGREE, 80 * RPM) == approx((np.pi, 4 / 3))


def test_forces_in_the_draught_system_are_over_half_rho_L_T_U_squared():
    prime = replace(WANG, length=150.0, draught=8.0, speed=7.0, rho=1000.0).prime
    assert prime.force == approx(0.5 * 1000 * 150 * 8 * 7**2)
    assert prime.moment == approx(0.5 * 1000 * 150**2 * 8 * 7**2)
    assert prime.velocity_units == approx((7.0, 7.0, 7 / 150))
    assert prime.acceleration_units == approx((49 / 150, 49 / 150, 49 / 150**2))


def test_forces_in_the_length_system_are_over_half_rho_L_squared_U_squared():
    prime = length_system(150.0, 7.0, rho=1000.0)
    assert prime.force == approx(0.5 * 1000 * 150**2 * 7**2)
    assert prime.moment == approx(0.5 * 1000 * 150**3 * 7**2)


def test_forces_in_the_bis_system_are_over_the_weight():
    prime = bis_system(300.0, 2e8)
    assert prime.force == approx(2e8 * 9.81)
    assert prime.moment == approx(2e8 * 9.81 * 300)
    assert prime.velocity_units[2] == approx(np.sqrt(9.81 / 300))


@pytest.mark.parametrize("time", [[0.0, 1.0, 1.0], [0.0, 2.0, 1.0], [0.0]])
def test_times_that_do_not_increase_are_refused(time):
    with pytest.raises(InputError, match="at least 2 samples and increase"):
        Recording("bad", np.array(time), {})


def test_channels_of_another_length_are_refused():
    with unchecked(), pytest.raises(InputError, match=r"channel u has shape \(2,\), time has \(3,\)"):
        Recording("bad", np.arange(3.0), {"u": np.arange(2.0)})


def test_a_missing_channel_is_named_with_those_there_are():
    with pytest.raises(InputError, match="has no channel delta; it has: u, psi"):
        made()["delta"]


def test_a_window_keeps_its_ends_and_times_and_an_empty_one_is_refused():
    window = made().between(1.0, 3.0)
    assert window.time.tolist() == [1.0, 2.0, 3.0] and window["u"].tolist() == [2.0, 3.0, 4.0]
    with pytest.raises(InputError, match=r"window 10\.\.20 s holds 0 samples; it runs from 0 to 4 s"):
        made().between(10.0, 20.0)


def test_resampling_is_linear_and_stays_within_the_recording():
    assert made().resampled(np.array([0.5, 3.25]))["u"] == approx([1.5, 4.25])
    with pytest.raises(InputError, match="ends at 4 s, asked for 5 s"):
        made().resampled(np.array([0.0, 5.0]))


def test_changing_channels_makes_a_new_recording():
    old = made()
    new = old.with_channels(u=np.zeros(5), v=np.ones(5))
    assert set(old.channels) == {"u", "psi"} and old["u"][1] == 2.0
    assert new["u"].tolist() == [0.0] * 5 and new.stacked("u", "v").shape == (5, 2)


def test_a_written_recording_has_units_in_its_headings_and_the_same_numbers(tmp_path):
    made().to_csv(tmp_path / "made.csv")
    table = pd.read_csv(tmp_path / "made.csv")
    assert list(table.columns) == ["t [s]", "u [m/s]", "psi [rad]"]
    assert table["psi [rad]"].to_numpy() == approx(made()["psi"])


def test_an_unknown_name_is_answered_with_the_known_ones():
    check_choice("ship.shaft", "hold", ["hold", "free"])
    with pytest.raises(InputError, match="ship.shaft 'hald' is unknown; choose one of: hold, free"):
        check_choice("ship.shaft", "hald", ["hold", "free"])


SIZES = {"name": "x", "length": 100.0, "beam": 20.0, "draught": 8.0, "block": 0.7, "speed": 7.0, "rudder_rate": 0.04}


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"speed": -7.0}, "speed is -7.0; it must be positive"),
        ({"rudder_rate": 0.0}, "rudder_rate is 0.0; it must be positive"),
        ({"length": 15.0}, "expected length > beam > draught"),
        ({"draught": 30.0}, "expected length > beam > draught"),
        ({"block": 1.2}, "block <= 1"),
    ],
)
def test_dimensions_that_no_ship_has_are_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        Particulars(**{**SIZES, "rudder_limit": 0.6, **wrong})


def test_particulars_give_displacement_and_time_unit():
    assert WANG.mass == 16_274e3
    assert replace(WANG, displacement=None).mass == approx(1025 * 0.6 * 152.4 * 21.763 * 8.138)
    assert WANG.time_unit == approx(152.4 / 7.614) and WANG.at_speed(5.0).time_unit == approx(30.48)


@pytest.mark.parametrize("stated", [350.1e3, None])
def test_resistance_goes_with_the_square_of_the_approach_speed_whether_stated_or_estimated(stated):
    ship = replace(WANG, resistance=stated)
    assert ship.at_speed(0.5 * WANG.speed).calm_resistance == approx(0.25 * ship.calm_resistance)
