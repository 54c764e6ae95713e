import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.read.reader import read_recording, read_recordings


def refused(path, read, ship, message):
    with pytest.raises(InputError, match=message) as error:
        read_recording(path, read, ship)
    assert "\n" not in str(error.value)


def test_what_is_written_is_read(zz20, frame, write, columns, ship):
    record = read_recording(write(frame), columns(), ship)
    np.testing.assert_allclose(record.time, zz20.time)
    for name in ("u", "v", "r", "x", "y", "psi", "delta"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-12)
    assert record.name == "run"
    assert record.meta["ship"] == "Mariner"
    assert record.meta["kind"] == "zigzag"
    assert record.meta["derived"] == ()
    assert record.meta["time_unit"] == pytest.approx(152.4 / 7.614)


def test_a_recording_may_be_written_and_read_again(zz20, tmp_path, columns, ship):
    zz20.to_csv(tmp_path / "again.csv")
    units = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}
    named = {k: {"column": f"{k} [{unit}]", "unit": unit} for k, unit in units.items()}
    record = read_recording(tmp_path / "again.csv", columns(named, time={"column": "t [s]", "unit": "s"}), ship)
    np.testing.assert_allclose(record["psi"], zz20["psi"], atol=1e-8)


def test_units_signs_and_sides_come_out_in_si(zz20, frame, write, columns, ship):
    frame["u"] /= KNOT
    frame["psi"] = -(frame["psi"] / DEGREE)
    frame["delta"] /= -DEGREE
    frame["t"] /= 60
    named = {"u": {"column": "u", "unit": "kn"}, "psi": {"column": "psi", "unit": "deg", "sign": -1}} | {
        "delta": {"column": "delta", "unit": "deg"}
    }
    read = columns(named, time={"column": "t", "unit": "min"}, rudder_positive_to="port")
    record = read_recording(write(frame), read, ship)
    np.testing.assert_allclose(record.time, zz20.time, atol=1e-9)
    for name in ("u", "psi", "delta"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-12)


def test_a_heading_from_0_to_360_becomes_continuous(zz20, frame, write, columns, ship):
    frame["psi"] = np.mod(frame["psi"] / DEGREE, 360.0)
    record = read_recording(write(frame), columns({"psi": {"column": "psi", "unit": "deg"}}), ship)
    np.testing.assert_allclose(record["psi"] - record["psi"][0], zz20["psi"] - zz20["psi"][0], atol=1e-9)


def test_times_count_from_the_first_sample(frame, write, columns, ship):
    frame["t"] += 1000.0
    record = read_recording(write(frame), columns(), ship)
    assert record.time[0] == 0.0
    assert record.meta["started"] == 1000.0


def test_velocities_and_track_of_another_point_are_carried_to_midship(zz20, frame, write, columns, ship):
    frame["v"] += 20.0 * frame["r"]
    frame["x"] += 20.0 * np.cos(frame["psi"])
    frame["y"] += 20.0 * np.sin(frame["psi"])
    record = read_recording(write(frame), columns(reference_point=20.0), ship)
    for name in ("v", "x", "y"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-9)


def test_earth_fixed_velocities_are_turned_into_body_axes(zz20, frame, write, columns, ship):
    u, v, psi = (zz20[k] for k in ("u", "v", "psi"))
    frame["u"], frame["v"] = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    record = read_recording(write(frame), columns(frame="earth"), ship)
    np.testing.assert_allclose(record["u"], u, atol=1e-12)
    np.testing.assert_allclose(record["v"], v, atol=1e-12)


def test_a_missing_rate_of_turn_follows_from_the_heading(zz20, frame, write, columns, ship):
    record = read_recording(write(frame), columns({"r": None}), ship)
    assert record.meta["derived"] == ("r",)
    assert np.std(record["r"] - zz20["r"]) < 0.02 * np.std(zz20["r"])


def test_missing_velocities_follow_from_the_track(zz20, frame, write, columns, ship):
    record = read_recording(write(frame), columns({"u": None, "v": None}), ship)
    assert record.meta["derived"] == ("u", "v")
    assert np.std(record["u"] - zz20["u"]) < 0.02 * np.std(zz20["u"])
    assert np.std(record["v"] - zz20["v"]) < 0.05 * np.std(zz20["v"])


def test_a_missing_track_follows_from_the_velocities(zz20, frame, write, columns, ship):
    record = read_recording(write(frame), columns({"x": None, "y": None}), ship)
    assert record.meta["derived"] == ("x", "y")
    distance = np.hypot(record["x"] - zz20["x"], record["y"] - zz20["y"])
    assert distance.max() < 0.01 * ship.length


def test_a_kind_that_is_given_is_not_guessed(frame, write, columns, ship):
    assert read_recording(write(frame), columns(kind="spiral"), ship).meta["kind"] == "spiral"


def test_files_without_headings_and_with_blanks_between_columns_are_read(zz20, frame, write, columns, ship):
    text = "a comment\n" + "\n".join("  ".join(f"{c:.12g}" for c in row) for row in frame.to_numpy())
    units = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}
    named = {k: {"column": place, "unit": unit} for place, (k, unit) in enumerate(units.items(), start=2)}
    read = columns(named, time={"column": 1, "unit": "s"}, delimiter="whitespace", header=False, skip_rows=1)
    record = read_recording(write(text), read, ship)
    np.testing.assert_allclose(record["delta"], zz20["delta"], atol=1e-9)


def test_several_files_are_read_from_a_folder_a_pattern_or_a_list(frame, tmp_path, columns, ship):
    for name in ("b.csv", "a.csv", "note.txt"):
        frame.to_csv(tmp_path / name, index=False)
    assert [r.name for r in read_recordings(tmp_path, columns(), ship)] == ["a", "b"]
    assert [r.name for r in read_recordings(str(tmp_path / "b*.csv"), columns(), ship)] == ["b"]
    assert [r.name for r in read_recordings([tmp_path / "b.csv", tmp_path / "a.csv"], columns(), ship)] == ["b", "a"]
    with pytest.raises(InputError, match="no csv or .*parquet or .* file there"):
        read_recordings(tmp_path / "c*.csv", columns(), ship)


def test_a_missing_file_is_named(tmp_path, columns, ship):
    refused(tmp_path / "nowhere.csv", columns(), ship, "nowhere.csv: no such file")


def test_a_folder_is_no_file(tmp_path, columns, ship):
    refused(tmp_path, columns(), ship, "is a folder; write a file")


@pytest.mark.parametrize("content", ["", "\n\n  \n"])
def test_an_empty_file_is_refused(write, columns, ship, content):
    refused(write(content), columns(), ship, "run.csv: empty file")


def test_headings_alone_are_refused(write, columns, ship):
    refused(write("t,u,v,r,x,y,psi,delta\n"), columns(), ship, "no line of numbers")


def test_a_binary_file_is_refused(write, columns, ship):
    refused(write(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"), columns(), ship, "not a text file")


def test_a_missing_column_is_refused_and_the_files_columns_are_listed(frame, write, columns, ship):
    path = write(frame.rename(columns={"psi": "heading"}))
    refused(path, columns(), ship, "no column 'psi'; it has: t, u, v, r, x, y, heading, delta")


def test_a_wrong_delimiter_is_suspected(frame, write, columns, ship):
    refused(write(frame.to_csv(index=False, sep=";")), columns(), ship, "is the delimiter ','?")


def test_a_column_that_stands_twice_is_refused(frame, write, columns, ship):
    path = write(frame.to_csv(index=False).replace("t,u,v,r", "t,u,v,u", 1))
    refused(path, columns({"r": None}), ship, "'u' stands 2 times")


def test_a_cut_off_last_line_is_refused_with_its_number(frame, write, columns, ship):
    text = frame.to_csv(index=False)
    count = len(frame) + 1
    refused(write(text[: text.rindex(",") - 30]), columns(), ship, rf"line {count}: \d cells, expected 8 .cut off")


def test_a_line_with_too_many_cells_is_refused(frame, write, columns, ship):
    lines = frame.to_csv(index=False).splitlines()
    lines[9] += ",1.0"
    refused(write("\n".join(lines)), columns(), ship, "line 10: 9 cells, expected 8")


def test_a_word_among_numbers_is_refused_with_line_and_column(frame, write, columns, ship):
    frame["u"] = frame["u"].astype(object)
    frame.loc[5, "u"] = "fast"
    refused(write(frame), columns(), ship, "line 7: column 'u' is 'fast'; expected a number")


def test_an_infinite_number_is_refused(frame, write, columns, ship):
    frame.loc[5, "u"] = np.inf
    refused(write(frame), columns(), ship, "line 7: column 'u' is inf; expected a finite number")


def test_empty_cells_are_refused_with_their_count_and_first_line(frame, write, columns, ship):
    frame.loc[[30, 31, 50], "v"] = np.nan
    refused(write(frame), columns(), ship, "line 32: column 'v' is the first of 3 empty cells; write fill_gaps: true")


def test_a_column_of_empty_cells_is_refused(frame, write, columns, ship):
    frame["v"] = np.nan
    refused(write(frame), columns(fill_gaps=True), ship, "column 'v' is empty")


def test_short_gaps_are_filled_by_a_straight_line_where_that_is_asked_for(zz20, frame, write, columns, ship):
    frame.loc[[30, 31, 32], "x"] = np.nan
    record = read_recording(write(frame), columns(fill_gaps=True), ship)
    line = zz20["x"][29] + np.arange(1, 4) / 4 * (zz20["x"][33] - zz20["x"][29])
    np.testing.assert_allclose(record["x"][30:33], line)


def test_a_gap_in_the_heading_is_filled_across_north(zz20, frame, write, columns, ship):
    frame["psi"] = np.mod(frame["psi"], 2 * np.pi)
    place = int(np.argmax(np.abs(np.diff(frame["psi"])) > 3)) + 1
    frame.loc[place, "psi"] = np.nan
    record = read_recording(write(frame), columns(fill_gaps=True), ship)
    wanted = zz20["psi"] - zz20["psi"][0]
    np.testing.assert_allclose((record["psi"] - record["psi"][0])[place], wanted[place], atol=0.01)


@pytest.mark.parametrize("rows", [[30, 31, 32, 33], [0], [-1]])
def test_long_gaps_and_gaps_at_the_ends_are_not_filled(frame, write, columns, ship, rows):
    frame.loc[frame.index[rows], "x"] = np.nan
    refused(write(frame), columns(fill_gaps=True), ship, "begins a gap of .* cells?")


def test_a_time_that_goes_back_is_refused_with_its_line(frame, write, columns, ship):
    frame.loc[40, "t"] = 38.5
    refused(write(frame), columns(), ship, "line 42: column 't' goes from 39 to 38.5; times must increase")


def test_a_hole_in_the_record_is_refused(frame, write, columns, ship):
    refused(write(frame.drop(index=range(100, 140))), columns(), ship, "line 102: column 't' jumps by 41 s")


def test_too_few_samples_are_refused(frame, write, columns, ship):
    refused(write(frame.iloc[:19]), columns(), ship, "too short a record: 19 samples")


def test_a_record_of_less_than_two_ship_lengths_is_refused(frame, write, columns, ship):
    refused(write(frame.iloc[:40]), columns(), ship, "too short a record: 40 samples over 39 s")


def test_a_text_of_a_spreadsheet_in_utf_16_is_read(zz20, frame, write, columns, ship):
    record = read_recording(write(frame.to_csv(index=False, sep="\t").encode("utf-16")), columns(delimiter="\t"), ship)
    np.testing.assert_array_equal(record["u"], zz20["u"])


def with_commas(frame):
    return frame.map(lambda value: f"{value!r}".replace(".", ","))


def test_decimal_commas_are_read_exactly_and_points_between_thousands_are_refused(zz20, frame, write, columns, ship):
    text = with_commas(frame).to_csv(index=False, sep=";")
    read = columns(delimiter=";", decimal="comma")
    np.testing.assert_array_equal(read_recording(write(text), read, ship)["x"], zz20["x"])
    lines = text.splitlines()
    lines[40] = "1.039" + lines[40][2:]
    refused(write("\n".join(lines)), read, ship, "line 41: column 't' is '1.039,0'; expected .* 0,25, with a comma")


def test_a_decimal_comma_where_a_point_is_expected_names_the_setting(frame, write, columns, ship):
    text = with_commas(frame).to_csv(index=False, sep=";")
    refused(write(text), columns(delimiter=";"), ship, "expected .* 0.25, with a point; or write decimal: comma")


@pytest.mark.parametrize("how", ["quoted", "blank lines", "blanks around", "carriage returns"])
def test_texts_that_are_read_line_by_line_give_the_same_numbers(zz20, frame, write, columns, ship, how):
    lines = frame.to_csv(index=False).splitlines()
    text = {
        "quoted": "\n".join('"' + line.replace(",", '","') + '"' for line in lines),
        "blank lines": "\n,,\n".join(lines),
        "blanks around": "\n".join(line.replace(",", " , ") for line in lines),
        "carriage returns": "\r\n".join(lines),
    }[how]
    for name in ("u", "psi"):
        np.testing.assert_array_equal(read_recording(write(text), columns(), ship)[name], zz20[name])


def test_a_cell_of_endless_length_is_refused(frame, write, columns, ship):
    lines = frame.to_csv(index=False).splitlines()
    lines[9] = "1" * 200_000 + ',"' + lines[9]
    refused(write("\n".join(lines)), columns(), ship, "line 10: 1 cells, expected 8")


def test_a_line_with_a_cell_too_few_is_named(frame, write, columns, ship):
    lines = frame.to_csv(index=False).splitlines()
    lines[9] = lines[9].rpartition(",")[0]
    refused(write("\n".join(lines)), columns(), ship, "line 10: 7 cells, expected 8: delete or mend this line")


def test_a_file_that_may_not_be_read_is_refused(frame, write, columns, ship, monkeypatch):
    path = write(frame)
    monkeypatch.setattr("os.access", lambda *_: False)
    refused(path, columns(), ship, "run.csv: may not be read")


@pytest.mark.parametrize(
    ("channel", "value", "told"),
    [
        ("x", 1e20, "is 1e.20 m, which no ship and no instrument can mean: empty the cell"),
        ("y", -3e7, "is -3e.07 m, which no ship"),
        ("psi", 1e20, "is 1e.20 rad, which no ship"),
        ("u", 1e300, "is 1e.300 m/s, which no ship"),
    ],
)
def test_a_value_outside_anything_physical_is_refused_with_its_cell(frame, write, columns, ship, channel, value, told):
    frame.loc[30, channel] = value
    refused(write(frame), columns(), ship, f"run.csv, line 32: column '{channel}' {told}")


@pytest.mark.parametrize("channel", ["x", "psi"])
def test_a_value_outside_anything_physical_is_filled_as_an_outlier_where_that_is_asked_for(
    zz20, frame, write, columns, ship, channel
):
    frame.loc[[30, 31], channel] = [1e20, -1e300]  # two in a row, which are no spike
    record = read_recording(write(frame), columns(outliers="fill"), ship)
    np.testing.assert_allclose(record[channel], zz20[channel], atol=2.0 if channel == "x" else 0.02)


def test_positions_far_from_the_origin_of_their_map_are_read(zz20, frame, write, columns, ship):
    frame["y"] += 9.9e7
    assert read_recording(write(frame), columns(), ship)["y"] == pytest.approx(zz20["y"] + 9.9e7)


def test_a_mark_of_a_logger_is_left_to_the_checks(frame, write, columns, ship):
    frame.loc[30, "u"] = 99999.0
    assert read_recording(write(frame), columns(), ship)["u"][30] == 99999.0
