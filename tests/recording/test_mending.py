"""What is wrong with a file and its sensors, and is mended on the way in."""

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import followed
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.read.logger_stamps import without_midnights
from manoeuvre_nn.recording.read.position import local_metres
from manoeuvre_nn.recording.read.reader import read_recording


def refused(path, read, ship, message):
    with pytest.raises(InputError, match=message) as error:
        read_recording(path, read, ship)
    assert "\n" not in str(error.value)


def test_a_sensor_that_is_off_and_shows_too_little_is_put_right(zz20, frame, write, columns, ship):
    frame["delta"] = -frame["delta"] / DEGREE / 1.25 + 3.0
    where = {"column": "delta", "unit": "deg", "sign": -1, "offset": 3.0, "scale": 1.25}
    record = read_recording(write(frame), columns({"delta": where}), ship)
    np.testing.assert_allclose(record["delta"], zz20["delta"], atol=1e-12)


def test_a_heading_counted_from_east_the_other_way_is_one_with_an_offset_and_a_sign(zz20, frame, write, columns, ship):
    frame["psi"] = np.mod(90.0 - frame["psi"] / DEGREE, 360.0)
    where = {"column": "psi", "unit": "deg", "sign": -1, "offset": 90.0}
    record = read_recording(write(frame), columns({"psi": where}), ship)
    np.testing.assert_allclose(np.sin(record["psi"]), np.sin(zz20["psi"]), atol=1e-9)


@pytest.mark.parametrize("delay", [3.0, -3.0])
def test_a_channel_that_comes_late_or_early_is_moved_back_and_the_ends_are_cut(
    zz20, frame, write, columns, ship, delay
):
    frame["psi"] = np.mod(np.interp(frame["t"] - delay, frame["t"], frame["psi"]), 2 * np.pi)
    where = {"column": "psi", "unit": "rad", "delay": delay}
    record = read_recording(write(frame), columns({"psi": where}), ship)
    kept = (zz20.time >= max(-delay, 0)) & (zz20.time <= zz20.time[-1] - max(delay, 0))
    assert len(record) == kept.sum() == len(zz20) - 3
    assert record.time[0] == 0 and record.meta["started"] == max(-delay, 0)
    np.testing.assert_allclose(record["x"], zz20["x"][kept])
    np.testing.assert_allclose(np.sin(record["psi"]), np.sin(zz20["psi"][kept]), atol=1e-9)


def test_a_delay_longer_than_the_file_is_refused(frame, write, columns, ship):
    refused(
        write(frame), columns({"psi": {"column": "psi", "unit": "rad", "delay": 1e4}}), ship, "too short a record: 0"
    )


def test_what_lies_outside_start_and_end_is_cut_out_and_may_be_broken(zz20, frame, write, columns, ship):
    frame["t"] += 500.0
    frame.loc[[3, 280], "v"] = np.nan
    record = read_recording(write(frame), columns(start=20.0, end=200.0), ship)
    assert record.time[0] == 0 and record.time[-1] == 180 and record.meta["started"] == 520
    np.testing.assert_allclose(record["v"], zz20["v"][20:201])


def test_a_complaint_within_the_window_names_the_files_line(frame, write, columns, ship):
    frame.loc[50, "v"] = np.nan
    refused(write(frame), columns(start=20.0), ship, "line 52: column 'v' is the first of 1 empty")
    frame.loc[50, "v"], frame.loc[60:, "t"] = 0.0, frame.loc[60:, "t"] + 100
    refused(write(frame), columns(start=20.0), ship, "line 62: column 't' jumps .*this is 160 s after the first")


def test_a_window_too_short_is_refused(frame, write, columns, ship):
    refused(write(frame), columns(start=20.0, end=40.0), ship, "21 samples over 20 s between start and end")


def test_single_outliers_are_filled_and_counted_where_that_is_asked_for(zz20, frame, write, columns, ship):
    frame.loc[[50, 90], "x"] += 80.0
    frame.loc[70, "psi"] = 0.0
    as_is = read_recording(write(frame), columns(), ship)
    assert as_is["x"][50] - zz20["x"][50] == pytest.approx(80.0)
    record = read_recording(write(frame), columns(outliers="fill"), ship)
    assert record.meta["outliers"] == {"x": 2, "psi": 1}
    np.testing.assert_allclose(record["x"], zz20["x"], atol=0.5)
    np.testing.assert_allclose(record["psi"], zz20["psi"], atol=0.01)
    np.testing.assert_allclose(record["delta"], zz20["delta"], atol=1e-12)


def test_a_channel_of_outliers_is_refused_as_noise(frame, write, columns, ship):
    frame.loc[::7, "v"] += 5.0
    refused(write(frame), columns(outliers="fill"), ship, "14% of column 'v' .* that is noise")


def test_steps_ramps_and_pairs_are_no_outliers():
    step = np.repeat([0.0, 1.0, -1.0], 20)
    pair = np.sin(np.arange(60) / 9)
    pair[[30, 31]] += 5.0
    assert not spikes(step).any() and not spikes(np.arange(40.0)).any() and not spikes(pair).any()
    pair[31] -= 5.0
    assert np.flatnonzero(spikes(pair)).tolist() == [30]


@pytest.mark.parametrize("backward", [False, True])
def test_a_rudder_that_begins_to_move_with_the_last_sample_is_none(backward):
    """It moves as far as it does elsewhere in a step; further than that it cannot."""
    rate = np.clip(np.concatenate([np.full(30, 10.0), 10.0 - 2.5 * np.arange(1, 9), np.full(30, -10.0)]), -10.0, 10.0)
    for last, found in ((-8.0, False), (-7.5, False), (5.3, True)):
        angles = np.append(rate, last)[:: -1 if backward else 1]
        assert spikes(angles).tolist() == (angles == last if found else np.zeros(len(angles), dtype=bool)).tolist()


def test_gaps_of_some_seconds_are_filled_where_that_is_asked_for(zz20, frame, write, columns, ship):
    frame.loc[30:36, "x"] = np.nan
    record = read_recording(write(frame), columns(fill_gaps=8.0), ship)
    assert record.meta["gaps"] == {"x": 7}
    np.testing.assert_allclose(record["x"][30:37], np.linspace(zz20["x"][29], zz20["x"][37], 9)[1:-1])
    refused(write(frame), columns(fill_gaps=7.0), ship, "gap of 7 cells; only gaps of up to 7 s")


def test_a_rudder_order_is_followed_at_the_rate_of_the_steering_gear(zz20, frame, write, columns, ship):
    frame["delta"] = order = np.r_[0.0, zz20["delta_order"][1:]]
    record = read_recording(write(frame), columns(rudder="order"), ship)
    np.testing.assert_allclose(record["delta_order"], order)
    # orders fall between samples: the rudder is off by up to half of one
    np.testing.assert_allclose(record["delta"], zz20["delta"], atol=0.5 * ship.rudder_rate + 1e-9)
    assert np.abs(np.diff(record["delta"])).max() <= ship.rudder_rate + 1e-12


def test_an_order_stands_until_midway_before_the_next_one():
    angle = followed(np.array([0.0, 1.0, 3.0, 4.0, 5.0]), np.array([0.0, 5.0, 5.0, -1.0, -1.0]), 2.0)
    assert angle.tolist() == [0.0, 1.0, 5.0, 4.0, 2.0]


def test_an_order_given_twice_is_refused(columns):
    with pytest.raises(InputError, match="take delta_order out"):
        columns({"delta_order": {"column": "o", "unit": "deg"}}, rudder="order")


WIND = {
    "wind_speed": {"column": "speed", "unit": "kn"},
    "wind_from": {"column": "from", "unit": "deg"},
    "phi": {"column": "roll", "unit": "deg"},
}


def test_wind_and_roll_are_read_and_a_wind_from_north_does_not_jump(frame, write, columns, ship):
    frame["speed"], frame["roll"] = 10.0, 2.0
    frame["from"] = np.mod(350.0 + 0.2 * frame["t"], 360.0)
    delays = {**WIND, "wind_from": {**WIND["wind_from"], "delay": 0.5}}
    record = read_recording(write(frame), columns(delays), ship)
    np.testing.assert_allclose(record["wind_speed"], 5.14444, rtol=1e-5)
    np.testing.assert_allclose(record["wind_from"], (350.1 + 0.2 * record.time) * DEGREE)
    np.testing.assert_allclose(record["phi"], 2 * DEGREE)


def test_latitude_and_longitude_become_metres_north_and_east(zz20, frame, write, columns, ship):
    frame["lat"] = 60.0 + zz20["x"] / 111412.9
    frame["lon"] = np.mod(179.99 + zz20["y"] / 55800.0 + 180, 360) - 180
    geo = {"x": None, "y": None, "lat": {"column": "lat", "unit": "deg"}, "lon": {"column": "lon", "unit": "deg"}}
    record = read_recording(write(frame), columns(geo), ship)
    # lengths of a degree at 60 deg: 111 412.9 m of latitude, 55 800.0 m of longitude (WGS 84)
    np.testing.assert_allclose(record["x"], zz20["x"] - zz20["x"][0], atol=0.05)
    np.testing.assert_allclose(record["y"], zz20["y"] - zz20["y"][0], atol=0.05)
    assert record.meta["origin"][0] == pytest.approx(60.0)
    assert record.meta["derived"] == () and "lat" not in record.channels


def test_a_degree_is_as_long_as_tables_say():
    x, y = local_metres(np.radians([45.0, 46.0]), np.radians([10.0, 11.0]))
    assert x[1] == pytest.approx(111131.8, rel=1e-5) and y[1] == pytest.approx(78846.8, rel=1e-5)


def test_speed_and_course_over_ground_become_velocities_along_and_across_the_heading(zz20, frame, write, columns, ship):
    frame["sog"] = np.hypot(zz20["u"], zz20["v"])
    frame["cog"] = np.mod((zz20["psi"] + np.arctan2(zz20["v"], zz20["u"])) / DEGREE, 360)
    over = {"u": None, "v": None, "sog": {"column": "sog", "unit": "m/s"}, "cog": {"column": "cog", "unit": "deg"}}
    record = read_recording(write(frame), columns(over), ship)
    np.testing.assert_allclose(record["u"], zz20["u"], atol=1e-9)
    np.testing.assert_allclose(record["v"], zz20["v"], atol=1e-9)
    assert record.meta["derived"] == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": None}, "has x without y"),
        ({"v": None}, "has u without v.* a speed log alone is u_log"),
        ({"lat": {"column": "a", "unit": "deg"}, "lon": {"column": "b", "unit": "deg"}}, "leave one pair out"),
        ({"u": {"column": "u", "unit": "count"}}, "unit of u .* 'count' is unknown"),
        ({"u": {"column": "u", "unit": "m/s", "scale": 0}}, "scale of u is 0; write a factor above 0"),
        ({"u": {"column": "u", "unit": "m/s", "scale": 1e30}}, "scale of u is 1e.30; write a factor above 0"),
        ({"u": {"column": "u", "unit": "m/s", "offset": "low"}}, "offset of u is 'low'; write a number"),
    ],
)
def test_channels_that_make_no_sense_are_refused(columns, change, message):
    with pytest.raises(InputError, match=message):
        columns(change)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"start": 5, "end": 5}, "must end after"), ({"start": -1}, "0 or more"), ({"time_zone": "UTC"}, "unit: iso"),
     ({"outliers": "drop"}, "keep, fill"), ({"rudder": "helm"}, "angle, order"), ({"decimal": ","}, "point, comma"),
     ({"fill_gaps": -2}, "seconds"), ({"start": "now"}, "seconds")],
)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(columns, settings, message):
    with pytest.raises(InputError, match=message):
        columns(**settings)


def test_an_unknown_time_zone_is_refused(columns):
    with pytest.raises(InputError, match="'Mars/Base' is unknown; write for instance UTC"):
        columns(time={"column": "t", "unit": "iso"}, time_zone="Mars/Base")


@pytest.mark.parametrize(
    ("unit", "text", "settings", "started"),
    [
        ("iso", "2020-07-31T23:59:00.5", {"time_zone": "Asia/Tokyo"}, 1596207540.5),
        ("iso", "2020-07-31 23:59:00.5", {}, 1596239940.5),
        ("iso", "2020-07-31T23:59:00.5+09:00", {}, 1596207540.5),
        ("iso", "2020-07-31T14:59:00.5Z", {}, 1596207540.5),
        ("clock", "23:59:00.5", {}, 86340.5),
    ],
)
def test_time_stamps_become_seconds_also_past_midnight(
    zz20, frame, write, columns, ship, unit, text, settings, started
):
    hour = text.index(":") - 2
    clock = int(text[hour : hour + 2]) * 3600 + 59 * 60 + frame["t"]
    day = np.where(clock < 86400, "2020-07-31", "2020-08-01")
    stamp = [f"{int(c) % 86400 // 3600:02d}:{int(c) % 3600 // 60:02d}:{int(c) % 60:02d}.5" for c in clock]
    zone = text[text.index(".5") + 2 :]
    frame["t"] = stamp if unit == "clock" else [f"{d}{text[10]}{s}{zone}" for d, s in zip(day, stamp, strict=True)]
    record = read_recording(write(frame), columns(time={"column": "t", "unit": unit}, **settings), ship)
    np.testing.assert_allclose(record.time, zz20.time, atol=1e-6)
    assert record.meta["started"] == pytest.approx(started, abs=1e-6)


def test_what_is_no_time_stamp_is_refused_with_its_line(frame, write, columns, ship):
    frame["t"] = [f"2020-07-31T12:{int(t) // 60:02d}:{int(t) % 60:02d}" for t in frame["t"]]
    frame.loc[7, "t"] = "noon"
    refused(write(frame), columns(time={"column": "t", "unit": "iso"}), ship, "line 9: column 't' is 'noon'; expected")


def test_numbers_with_a_comma_are_read_where_that_is_said(zz20, frame, write, columns, ship):
    text = frame.to_csv(index=False, sep=";", decimal=",")
    record = read_recording(write(text), columns(delimiter=";", decimal="comma"), ship)
    np.testing.assert_allclose(record["u"], zz20["u"])
    refused(write(text), columns(delimiter=";"), ship, "line .*: column .* is '.*,.*'; expected a number")


def test_a_record_may_hold_counts_and_lack_everything_else(frame, write, columns, ship):
    channels = {k: None for k in ("u", "v", "x", "y", "psi", "delta")} | {"r": {"column": "r", "unit": "count"}}
    record = read_recording(write(frame.iloc[:25]), columns(channels, kind="record"), ship)
    np.testing.assert_allclose(record["r"], frame["r"][:25])
    assert set(record.channels) == {"r"} and record.meta["kind"] == "record"


def test_a_first_fix_that_is_missing_leaves_the_others():
    north, east = local_metres(np.radians([np.nan, 45.0, 46.0]), np.radians([10.0, 10.0, 11.0]))
    assert np.isnan(north[0])
    x, y = local_metres(np.radians([45.0, 46.0]), np.radians([10.0, 11.0]))
    np.testing.assert_array_equal(north[1:], x)
    np.testing.assert_array_equal(east[1:], y)


def test_an_order_that_was_not_written_down_leaves_the_one_before_standing():
    time, order = np.arange(8.0), np.array([0.0, 4.0, 4.0, np.nan, 4.0, -1.0, np.nan, -1.0])
    whole = followed(time, np.array([0.0, 4.0, 4.0, 4.0, 4.0, -1.0, -1.0, -1.0]), 2.0)
    known = np.isfinite(order)
    angle = followed(time, order, 2.0)
    np.testing.assert_array_equal(angle[known], whole[known])
    assert np.isnan(angle[~known]).all() and np.isnan(followed(time, np.full(8, np.nan), 2.0)).all()
    np.testing.assert_array_equal(followed(time, np.array([np.nan, *order[1:]]), 2.0)[1:3], [4.0, 4.0])


def test_two_clocks_that_pass_midnight_in_turn_pass_it_once():
    times = np.array([86398.0, 86399.0, 0.0, 86399.9, 0.5, np.nan, 1.0])
    expected = [86398.0, 86399.0, 86400.0, 86399.9, 86400.5, np.nan, 86401.0]
    np.testing.assert_allclose(without_midnights(times), expected)
    np.testing.assert_allclose(without_midnights(np.array([0.2, 86399.9, 1.0])), [0.2, -0.1, 1.0], atol=1e-9)
    np.testing.assert_array_equal(without_midnights(np.array([3600.0, 60000.0])), [3600.0, 60000.0])  # a hole


@pytest.mark.parametrize("where", [0, 1, 30, 58, 59])
def test_a_spike_is_found_wherever_it_stands(where):
    ramp = 5.0 * np.arange(60.0) + np.random.default_rng(0).normal(0.0, 0.5, 60)
    assert not spikes(ramp, 0.0).any() and not spikes(ramp**2, 0.0).any()
    ramp[where] += 300.0
    assert np.flatnonzero(spikes(ramp, 0.0)).tolist() == [where]
