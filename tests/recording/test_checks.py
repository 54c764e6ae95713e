import numpy as np
import pytest
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.recording.check.axes import rudder_sign
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import mariner


@pytest.fixture
def judge(write, columns, ship):
    """Write a file, read it, check it."""

    def read_and_check(table, channels=None, **settings):
        check_recording(read_recording(write(table), columns(channels, **settings), ship), ship)

    return read_and_check


@pytest.fixture
def found(judge):
    def finding(message, table, channels=None, **settings):
        with pytest.raises(InputError, match=message) as error:
            judge(table, channels, **settings)
        assert "\n" not in str(error.value)
        assert "recording run: " in str(error.value)

    return finding


def unit(name, text):
    return {name: {"column": name, "unit": text}}


def test_a_right_file_passes(frame, judge):
    judge(frame)


def test_a_noisy_file_passes(zz20, ship):
    sd = {"u": 0.1, "v": 0.1, "r": 0.1 * DEGREE, "x": 1.0, "y": 1.0, "psi": 0.3 * DEGREE, "delta": 0.2 * DEGREE}
    check_recording(add_noise(zz20, sd, seed=3), ship)


@pytest.mark.parametrize("lost", [("r",), ("u", "v"), ("x", "y"), ("r", "u", "v")])
def test_a_file_from_which_channels_are_derived_passes(frame, judge, lost):
    judge(frame, dict.fromkeys(lost))


def test_a_straight_run_gives_no_verdict_on_the_rudder(ship):
    check_recording(simulate(CalmWater(mariner()), straight(duration=120.0)), ship)


def test_rudder_degrees_taken_for_radians_are_found(frame, found):
    frame["delta"] /= DEGREE
    found("rudder angles reach 20 rad.*write unit: deg", frame)


def test_rudder_radians_taken_for_degrees_are_found(frame, found):
    found("delta looks like radians, not degrees: write unit: rad", frame, unit("delta", "deg"))


def test_heading_degrees_taken_for_radians_are_found(frame, found):
    frame["psi"] = np.mod(frame["psi"] / DEGREE, 360.0)
    found("psi looks like degrees: write unit: deg for psi", frame)


def test_heading_radians_taken_for_degrees_are_found(frame, found):
    found("psi looks like radians, not degrees: write unit: rad for psi", frame, unit("psi", "deg"))


def test_turning_rates_in_degrees_taken_for_radians_are_found(frame, found):
    frame["r"] /= DEGREE
    found("r looks like deg/s: write unit: deg/s for r", frame)


def test_turning_rates_in_radians_taken_for_degrees_are_found(frame, found):
    found("r looks like rad/s, not deg/s: write unit: rad/s for r", frame, unit("r", "deg/s"))


def test_knots_taken_for_metres_per_second_are_found_by_the_track(frame, found):
    frame[["u", "v"]] /= KNOT
    found("0.5144 times hypot.u, v.; expected 1: u and v look like knots", frame)


def test_metres_per_second_taken_for_knots_are_found_by_the_track(frame, found):
    found("u and v look like m/s, not knots", frame, unit("u", "kn") | unit("v", "kn"))


def test_knots_taken_for_metres_per_second_are_found_without_a_track(frame, found):
    frame[["u", "v"]] /= KNOT
    found("the Mariner approaches at 7.614 m/s: u and v look like knots", frame, {"x": None, "y": None})


def test_kilometres_per_hour_and_feet_are_found(frame, found):
    fast = frame.assign(u=frame["u"] * 3.6, v=frame["v"] * 3.6)
    found("look like km/h", fast)
    found("x and y look like feet: write unit: ft", frame.assign(x=frame["x"] / 0.3048, y=frame["y"] / 0.3048))


def test_a_wrong_unit_of_time_is_found(frame, found):
    found("time looks like milliseconds", frame.assign(t=frame["t"] * 1000))
    found("time looks like seconds, not minutes", frame, time={"column": "t", "unit": "min"})


def test_a_full_scale_file_for_a_model_is_found(frame, found, ship):
    slow = frame.assign(u=frame["u"] / 100, v=frame["v"] / 100, x=frame["x"] / 100, y=frame["y"] / 100)
    found("choose the right ship", slow)


def test_a_ship_that_runs_astern_throughout_is_found(frame, found):
    found("u stays below .* write sign: -1 for u", frame.assign(u=-frame["u"]), {"x": None, "y": None})


def test_a_rate_of_turn_with_the_wrong_sign_is_found(frame, found):
    found("write sign: -1 for r", frame.assign(r=-frame["r"]))


def test_a_heading_with_the_wrong_sign_is_found(frame, found):
    found("write sign: -1 for psi", frame.assign(psi=-frame["psi"]))


def test_earth_fixed_velocities_taken_for_body_fixed_are_found(frame, found):
    u, v = body_to_earth(frame["u"].to_numpy(), frame["v"].to_numpy(), frame["psi"].to_numpy())
    found("u and v look earth-fixed: write frame: earth", frame.assign(u=u, v=v))


def test_body_fixed_velocities_taken_for_earth_fixed_are_found(frame, found):
    found("u and v look body-fixed: write frame: body", frame, frame="earth")


def test_swapped_velocities_are_found(frame, found):
    found("u and v look swapped", frame.assign(u=frame["v"], v=frame["u"]))


def test_swapped_positions_are_found(frame, found):
    found("x and y look swapped", frame.assign(x=frame["y"], y=frame["x"]))


@pytest.mark.parametrize("channel", ["u", "v", "x", "y"])
def test_a_velocity_or_position_with_the_wrong_sign_is_found(frame, found, channel):
    found(f"write sign: -1 for {channel}", frame.assign(**{channel: -frame[channel]}))


def test_a_heading_that_is_off_by_a_constant_is_found(frame, found):
    found("psi looks 90 deg off", frame.assign(psi=frame["psi"] + np.pi / 2))


def test_a_rudder_with_the_wrong_sign_is_found(frame, found):
    found("rudder sign opposite to the turn: .*change rudder_positive_to", frame.assign(delta=-frame["delta"]))


@pytest.mark.parametrize("ship", [mariner(), esso_190k()], ids=lambda s: s.particulars.name)
@pytest.mark.parametrize("side", mainly(1, ["starboard", "port"]))
def test_the_rudders_sign_is_found_in_a_turning_circle_of_a_stable_and_of_an_unstable_ship(ship, side):
    length = 15 * ship.particulars.time_unit
    turn = simulate(CalmWater(ship), turning_circle(25.0, side, duration=length))
    check_recording(turn, ship.particulars)
    with pytest.raises(InputError, match="rudder sign opposite to the turn"):
        check_recording(turn.with_channels(delta=-turn["delta"]), ship.particulars)


def test_the_rudders_sign_is_found_among_spikes_of_the_yaw_rate(zz20, ship):
    spikes = np.zeros(len(zz20))
    spikes[7::25] = 2 * np.abs(zz20["r"]).max() * (-1.0) ** np.arange(len(spikes[7::25]))
    spoilt = zz20.with_channels(r=zz20["r"] + spikes, delta=-zz20["delta"])
    assert rudder_sign(zz20.with_channels(r=zz20["r"] + spikes), ship) is None
    assert rudder_sign(spoilt, ship) is not None


@pytest.mark.slow
def test_few_samples_do_not_give_the_rudders_sign_by_chance(ship):
    # The rudder is put over once: in ten samples the yaw rate, moved by the seaway, may answer to either side, however
    # slowly the ship turns to the right one in the end.
    turn = simulate(CalmWater(mariner()), turning_circle(25.0, duration=15 * ship.time_unit))
    strays = np.random.default_rng(0).standard_normal((800, len(turn)))
    refused = [rudder_sign(turn.with_channels(r=1e-3 * stray + 3e-4), ship) for stray in strays]
    assert sum(found is not None for found in refused) <= 1


def test_a_rudder_beyond_its_stop_is_found(frame, found):
    found("rudder angles reach 40 deg; that of the Mariner stops at 35 deg", frame.assign(delta=2 * frame["delta"]))


@pytest.mark.parametrize("factor, said", [(1 / KNOT, "knots"), (3.6, "km/h")])
def test_a_log_in_another_unit_is_refused_before_a_model_is_fitted_too(zz20, ship, factor, said):
    with pytest.raises(InputError, match=f"u_log is .* times the speed over ground: u_log looks like {said}"):
        check_recording(zz20.with_channels(u_log=factor * zz20["u"]), ship)
    check_recording(zz20.with_channels(u_log=np.where(zz20.time > 90, zz20["u"], np.nan)), ship)
