"""Files that this package wrote are read as they are; mappings as files are data."""

import numpy as np
import pytest
from fleet import unchecked

from manoeuvre_nn.core.channels import CHANNELS, MEASURED, UNITS
from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.case import RunSettings, read_runs
from manoeuvre_nn.recording.check.inspection import inspect_file
from manoeuvre_nn.recording.preparation import measured
from manoeuvre_nn.recording.read.mapping_file import is_written_by_package, mapping_of, read_mapping
from manoeuvre_nn.recording.read.reader import read_measured, read_recording, read_recordings
from manoeuvre_nn.ship.mariner import mariner_corrected

OLD = "_target_: manoeuvre_nn.recording.mapping.mapping\n"
PLAIN = "time: {column: t, unit: s}\nchannels:\n"
PLAIN += "".join(f"  {k}: {{column: {k}, unit: {UNITS[k]}}}\n" for k in ("x", "y", "psi", "delta"))


def test_what_the_package_wrote_is_read_without_a_mapping(zz20, tmp_path, ship):
    zz20.to_csv(tmp_path / "zz20.csv")
    (record,) = read_recordings(tmp_path, None, ship)
    for name in ("u", "v", "r", "x", "y", "psi", "delta", "delta_order"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-5, rtol=1e-8, err_msg=name)
    assert record.meta["derived"] == () and record.meta["kind"] == "zigzag"


def test_what_the_package_wrote_is_checked_and_diagnosed_without_a_mapping(zz20, zz35, tmp_path):
    hull = mariner_corrected()
    for run in (zz20, zz35):
        run.to_csv(tmp_path / f"{run.name.replace(' ', '_')}.csv")
    one = sorted(tmp_path.glob("*.csv"))[0]
    assert inspect_file(one, mapping_of(one), hull.particulars).verdict != "refuse"
    case = read_runs(tmp_path, hull)
    assert len(case.runs) == 2 and case.runs[0]["delta"].max() > 0.3
    for run, seen in zip(case.runs, (zz20, zz35), strict=True):
        even = seen.resampled(run.time)
        assert measured(run)[:, MEASURED.index("x")] == pytest.approx(even["x"], abs=1e-3)
        assert measured(run)[:, MEASURED.index("psi")] == pytest.approx(even["psi"], abs=1e-6)


def test_another_file_without_a_mapping_is_refused_in_a_line_that_names_import(frame, write, ship):
    path = write(frame)
    assert not is_written_by_package(path)
    with pytest.raises(InputError, match=r"run\.csv is no recording that this package wrote.*manoeuvre import") as said:
        read_recording(path, None, ship)
    assert "\n" not in str(said.value)


def test_positions_alone_or_velocities_alone_are_enough_for_an_optional_mapping(frame, write, ship):
    both = frame.rename(columns={k: f"{k} [{CHANNELS[k].unit}]" for k in frame})
    found = {}
    for left_out in (["x [m]", "y [m]"], ["u [m/s]", "v [m/s]"]):
        path = write(both.drop(columns=left_out))
        found[left_out[0]] = set(read_measured(path, mapping_of(path), ship).channels)
    assert found == {"x [m]": {"u", "v", "r", "psi", "delta"}, "u [m/s]": {"x", "y", "r", "psi", "delta"}}
    with pytest.raises(InputError, match="neither position nor velocity"):
        read_measured(write(both[["t [s]", "psi [rad]", "delta [rad]"]]), mapping_of(path), ship)


def test_gaps_are_left_where_that_is_asked_for_and_refused_where_not(frame, write, columns, ship):
    frame.loc[10:14, "x"] = np.nan
    path = write(frame)
    left = read_measured(path, columns(), ship, leave_gaps=True)
    assert np.flatnonzero(np.isnan(left["x"])).tolist() == [10, 11, 12, 13, 14]
    with pytest.raises(InputError, match="is the first of 5 empty cells"):
        read_recording(path, columns(), ship)


@pytest.mark.parametrize("name", ["si_degrees", "concealed"])
def test_the_csv_of_a_diagnosis_is_a_mapping_like_any_other(name):
    read = read_mapping(name)
    assert read.optional and read.rudder_positive_to == ("port" if name == "concealed" else "starboard")
    rolling = "phi p delta_starboard delta_port n_starboard n_port" if name == "si_degrees" else ""
    columns = f"x_north y_east sog cog u v u_log psi r delta_order delta n {rolling}".split()
    assert read.table["columns"] == ["t", *columns]
    assert (CONF / "recording" / f"{name}.yaml").is_file()


def test_an_old_first_line_is_passed_over_and_any_other_code_is_refused(tmp_path):
    path = tmp_path / "recording" / "mine.yaml"
    path.parent.mkdir()
    path.write_text(PLAIN)
    plain = read_mapping(path)
    path.write_text(OLD + PLAIN)
    assert read_mapping(path) == plain
    assert read_mapping("mine", tmp_path) == plain


@pytest.mark.parametrize(
    "text, told",
    [
        ("_target_: subprocess.run\n" + PLAIN, "_target_: subprocess.run is refused; settings are plain"),
        (PLAIN + "kind: {_target_: os.system}\n", "_target_: os.system is refused; settings are plain"),
        (PLAIN + "kind: ${oc.env:HOME}\n", "expected a plain value"),
        ("columns: {}\n", "is no mapping of a record over time: write time: and channels: into it"),
        ("- 1\n", "is no mapping of a record over time"),
        (PLAIN + "optional: 3\n", "mapping: optional=3; write true or false"),
        (PLAIN + PLAIN, "stands twice"),
    ],
)
def test_a_mapping_that_is_more_than_data_or_says_nothing_is_refused_in_a_line(tmp_path, text, told):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_mapping(path)
    assert told in str(refused.value) and "\n" not in str(refused.value)


def test_a_mapping_that_is_a_number_is_refused():
    with unchecked(), pytest.raises(InputError, match=r"^mapping=1e\+308: expected the path of a yaml, or a name"):
        read_mapping(1e308)


def test_a_side_that_is_written_stands_over_that_of_the_mapping(zz20, tmp_path):
    zz20.with_channels(delta=-zz20["delta"], delta_order=-zz20["delta_order"]).to_csv(tmp_path / "a.csv")
    with pytest.raises(InputError, match="rudder sign opposite to the turn"):
        read_runs(tmp_path, mariner_corrected(), RunSettings([]))
    case = read_runs(tmp_path, mariner_corrected(), RunSettings([], rudder_positive_to="port"))
    assert case.runs[0]["delta"].max() == pytest.approx(zz20["delta"].max(), abs=1e-6)
