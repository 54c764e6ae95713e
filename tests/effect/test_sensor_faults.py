from math import cos, radians, sin

import pytest
import torch
from shelf import made, recorded, situation

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.effect.sensors import shifted

TURN = 0.01
STEP = 0.05


def turning(n: int = 401) -> Situation:
    """A steady turn to starboard at 5 m/s with drift, all exact."""
    time = STEP * torch.arange(n, dtype=torch.float64)
    u, v = 5.0, -0.8
    psi = 0.3 + TURN * time
    north, east = u * torch.cos(psi) - v * torch.sin(psi), u * torch.sin(psi) + v * torch.cos(psi)
    nu = torch.tensor([u, v, TURN], dtype=torch.float64).expand(n, 3)
    return Situation(nu, 0 * nu, east / TURN, -north / TURN, psi, 0 * time, 1 + 0 * time, time)


def changes(name: str, **values: float) -> dict[str, torch.Tensor]:
    """What an effect adds to the channels of the turn."""
    s = turning()
    true = recorded(s)
    written = made(name, "mariner", **values).record(true, s)
    added = {k: written[k] - true[k] for k in true}
    return {k: c for k, c in added.items() if float(c.abs().max()) > 0}


@pytest.mark.parametrize(
    ("name", "value", "channel", "expected"),
    [
        ("heading_bias", {"bias_deg": 2.0}, "psi", radians(2.0)),
        ("rate_bias", {"bias_deg_s": -0.1}, "r", radians(-0.1)),
        ("log_scale", {"factor": 0.9}, "u_log", -0.5),
    ],
)
def test_a_bias_is_recorded_minus_true_on_its_channel_alone(name, value, channel, expected):
    added = changes(name, **value)
    assert list(added) == [channel]
    torch.testing.assert_close(added[channel], torch.full_like(added[channel], expected))


def test_the_antenna_moves_as_a_point_of_a_rigid_body():
    s = turning()
    true = recorded(s)
    written = made("gps_lever_arm", "mariner", dx_m=-60.0, dy_m=8.0).record(true, s)
    first = s.psi[0]
    assert float(written["x"][0] - s.x[0]) == pytest.approx(-60 * cos(first) - 8 * sin(first))
    assert float(written["y"][0] - s.y[0]) == pytest.approx(-60 * sin(first) + 8 * cos(first))
    for place, rate in (("x", "vn"), ("y", "ve")):
        slope = (written[place][2:] - written[place][:-2]) / (2 * STEP)
        torch.testing.assert_close(slope, written[rate][1:-1], rtol=0.0, atol=1e-5)


def test_converted_positions_are_stretched_along_each_axis_and_turned_clockwise():
    """A course due east that is turned by 90 deg leads south."""
    s = turning()
    true = recorded(s)
    added = changes("position_conversion", north=1.0, east=-2.0, turn_deg=0.0)
    assert set(added) == {"x", "y"}
    torch.testing.assert_close(added["x"], 0.01 * true["x"])
    torch.testing.assert_close(added["y"], -0.02 * true["y"])
    turned = made("position_conversion", "mariner", north=0.0, east=0.0, turn_deg=90.0).record(true, s)
    torch.testing.assert_close(turned["x"], -true["y"])
    torch.testing.assert_close(turned["y"], true["x"])


def test_an_antenna_forward_of_midship_swings_to_starboard_in_a_starboard_turn():
    s = turning()
    added = changes("gps_lever_arm", dx_m=50.0, dy_m=0.0)
    sway = -added["vn"] * torch.sin(s.psi) + added["ve"] * torch.cos(s.psi)
    torch.testing.assert_close(sway, torch.full_like(sway, 50 * TURN))


def test_velocities_of_another_point_are_those_of_an_antenna_there_without_its_place():
    arm, frame = changes("gps_lever_arm", dx_m=40.0, dy_m=0.0), changes("wrong_frame", dx_m=40.0)
    assert set(frame) == {"vn", "ve"}
    torch.testing.assert_close(frame["vn"], arm["vn"])
    torch.testing.assert_close(frame["ve"], arm["ve"])


def test_a_late_receiver_shows_where_the_ship_was():
    s = turning()
    true = recorded(s)
    written = made("gps_delay", "mariner", delay_s=1.0).record(true, s)
    for channel in ("x", "y", "vn", "ve"):
        torch.testing.assert_close(written[channel][20:], true[channel][:-20])
    assert all(written[k] is true[k] for k in ("psi", "r", "u_log", "delta"))


def test_a_late_clock_shows_the_yaw_rate_of_before():
    s = turning()
    rate = torch.sin(s.time)
    effect = made("time_sync", "mariner", offset_s=0.5)
    written = effect.record({"r": rate, "psi": s.psi}, s)["r"]
    torch.testing.assert_close(written[20:], torch.sin(s.time - 0.5)[20:], rtol=0.0, atol=1e-3)


def test_shifting_is_straight_between_samples_and_beyond_the_ends():
    time = torch.tensor([0.0, 1.0, 2.0, 4.0], dtype=torch.float64)
    channel = torch.tensor([0.0, 1.0, 3.0, 1.0], dtype=torch.float64)
    back = shifted(channel, time, torch.tensor(0.5, dtype=torch.float64))
    assert back.tolist() == pytest.approx([-0.5, 0.5, 2.0, 1.5])
    ahead = shifted(channel, time, torch.tensor([[-0.5], [-1.0]], dtype=torch.float64))
    assert ahead[0].tolist() == pytest.approx([0.5, 2.0, 2.5, 0.5])
    assert ahead[1].tolist() == pytest.approx([1.0, 3.0, 2.0, 0.0])


def test_a_gyro_without_correction_shows_too_much_on_a_northerly_course():
    s = turning()
    added = changes("gyro_speed_error", factor=1.5)
    assert list(added) == ["psi"]
    torch.testing.assert_close(added["psi"], 1.5 * recorded(s)["vn"] / 465.1)
    # 15 kn on north at 50 degrees of latitude is about 1.5 degrees.
    assert 7.717 / 465.1 / cos(radians(50.0)) == pytest.approx(radians(1.5), rel=0.02)


def test_errors_of_the_compass_do_not_move_the_antenna():
    s = turning()
    arm = made("gps_lever_arm", "mariner", dx_m=50.0)
    true = recorded(s)
    biased = made("heading_bias", "mariner", bias_deg=5.0).record(true, s)
    torch.testing.assert_close(arm.record(biased, s)["x"], arm.record(true, s)["x"])


def test_sensors_leave_the_motion_alone():
    s = situation("mariner")
    effect = made("heading_bias", "mariner")
    assert float(effect.acceleration(s, s.nu.new_zeros(4, 0)).abs().max()) == 0.0


def test_a_gyro_feels_the_speed_over_ground_and_not_that_through_the_water():
    s = turning()
    drifting = recorded(s) | {"vn": recorded(s)["vn"] + 1.5}
    written = made("gyro_speed_error", "mariner", factor=1.5).record(drifting, s)
    torch.testing.assert_close(written["psi"] - s.psi, 1.5 * drifting["vn"] / 465.1, rtol=1e-3, atol=0.0)
