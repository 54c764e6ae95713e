"""Bags of ROS 1 and 2 and MCAP are read as the run was sailed; hostile and broken ones are refused in one line."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest
from logs import MIDNIGHT, write_bag, write_sensors
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.propose.headings import assign, take_apart
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.propose.proposal_yaml import to_yaml
from manoeuvre_nn.recording.read import bags
from manoeuvre_nn.recording.read.reader import read_recording, read_recordings
from manoeuvre_nn.recording.read.table import read_table

pytest.importorskip("rosbags", reason='bags need the extra: pip install -e ".[ros]"')


@pytest.fixture(scope="module")
def zz20(zz20):
    """The first 200 s of the zigzag: both sides and two reversals."""
    return zz20.between(0.0, 200.0)


HEADING = "/odom.pose.pose.orientation.heading [rad]"


@pytest.mark.parametrize("name", mainly(3, ["run.bag", "run", "run_mcap/run_mcap.mcap", "run_mcap", "run/run.db3"]))
def test_a_bag_is_proposed_and_read_as_it_was_sailed(zz20, ship, tmp_path, name):
    write_bag(tmp_path / name.partition("/")[0], zz20)
    path = tmp_path / name
    made = propose(path, ship)
    assert made.finding is None and set(made.questions) == {"reference_point"}
    record = read_recording(path, made.mapping, ship)
    for channel in ("u", "v", "r", "delta", "x", "y", "psi"):
        np.testing.assert_allclose(record[channel], zz20[channel], atol=1e-12)
    np.testing.assert_allclose(record.time, zz20.time, atol=1e-6)
    assert record.meta["started"] == pytest.approx(MIDNIGHT.timestamp(), abs=1e-3)
    assert any("left out: /note" in note for note in made.notes)


def test_sensors_of_several_rates_and_axes_are_put_together(zz20, ship, tmp_path):
    path = write_sensors(tmp_path / "run.bag", zz20)
    made = propose(path, ship)
    columns = {c.channel: c.column for c in made.choices}
    assert made.mapping.frame == "earth" and columns["u"] == "/vel.twist.linear.y [m/s]"
    record = read_recording(path, made.mapping, ship)
    assert record.step == pytest.approx(1.0) and len(record) == len(zz20) - 1
    since = record.time + record.meta["started"] - MIDNIGHT.timestamp()
    for name, error in {"u": 5e-4, "v": 5e-4, "r": 1e-9, "psi": 1e-8, "delta": 1e-8}.items():
        np.testing.assert_allclose(record[name], np.interp(since, zz20.time, zz20[name]), atol=error)


@pytest.mark.parametrize("frame", ["imu_link", "map"])
def test_axes_that_frame_id_does_not_tell_are_undecided(zz20, ship, tmp_path, frame):
    made = propose(write_bag(tmp_path / "run.bag", zz20, frame), ship)
    assert ("psi" in made.questions) is (frame == "imu_link")
    assert ("x is taken for east, y for north, z for up (REP 103)" in to_yaml(made)) is (frame == "imu_link")


@pytest.mark.parametrize(("frame", "told"), [("enu_origin", True), ("/earth", True), ("local_NED", True),
                                             ("", False), ("odom", False), ("combined_imu", False)])  # fmt: skip
def test_frames_that_tell_the_axes_leave_nothing_to_ask(zz20, tmp_path, frame, told):
    short = zz20.between(0.0, 5.0)
    assert (not read_table(write_bag(tmp_path / "run.bag", short, frame)).questions) is told


def test_a_heading_is_clockwise_from_north_whichever_axes_the_frame_says(zz20, tmp_path):
    for frame, heading in (("map", zz20["psi"]), ("odom_ned", np.pi / 2 - zz20["psi"])):
        table = read_table(write_bag(tmp_path / f"{frame}.bag", zz20, frame))
        np.testing.assert_allclose(table.numbers(HEADING), heading, atol=1e-12)


def test_roll_and_pitch_of_a_quaternion_are_those_of_its_turns():
    for roll, pitch, yaw in ((0.1, -0.2, 3.0), (-0.4, 0.3, -1.0), (0.0, 0.0, np.pi / 2)):
        half = [(np.cos(a / 2), np.sin(a / 2)) for a in (roll, pitch, yaw)]
        (cr, sr), (cp, sp), (cy, sy) = half
        x, y, z = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
        w = cr * cp * cy + sr * sp * sy
        np.testing.assert_allclose(bags._angles(x, y, z, w), (roll, pitch, yaw), atol=1e-12)
    assert np.isnan(bags._angles(0.0, 0.0, 0.0, 0.0)).all()


def test_times_are_those_of_the_headers_not_of_receiving(zz20, tmp_path):
    table = read_table(write_bag(tmp_path / "run.bag", zz20.between(0.0, 9.0), receive_delay=3.0))
    assert table.times("time", "iso")[0] == pytest.approx(MIDNIGHT.timestamp(), abs=1e-3)


def test_a_folder_of_bags_is_read_bag_by_bag(zz20, ship, tmp_path):
    mapping = propose(write_bag(tmp_path / "a", zz20), ship).mapping
    write_bag(tmp_path / "b.bag", zz20)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "metadata.yaml").write_text("author: me\n")
    assert [run.name for run in read_recordings(tmp_path, mapping, ship)] == ["a", "b"]
    assert [run.name for run in read_recordings(tmp_path / "a", mapping, ship)] == ["a"]


def refused(path, message):
    with pytest.raises(InputError, match=message) as error:
        read_table(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


BROKEN = {
    "empty": (lambda whole: b"", "empty file"),
    "a text": (lambda whole: b"t,u\n1,2\n", "not a bag of ROS, or damaged"),
    "cut off": (lambda whole: whole[: len(whole) // 2], "not a bag of ROS, or damaged"),
    "cut off in the head": (lambda whole: whole[:40], "not a bag of ROS, or damaged"),
    "garbled": (lambda whole: whole[:300] + bytes(range(256)) * 40, "not a bag of ROS, or damaged"),
    "endless header": (lambda whole: whole[:13] + struct.pack("<I", 2**32 - 1) + whole[17:], "not a bag of ROS"),
}


@pytest.mark.parametrize("suffix", ["bag", "mcap", "db3"])
@pytest.mark.parametrize("how", BROKEN)
def test_a_broken_bag_is_refused(zz20, tmp_path, how, suffix):
    name = {"bag": "run.bag", "mcap": "run_mcap", "db3": "run"}[suffix]
    written = write_bag(tmp_path / name, zz20.between(0.0, 9.0))
    whole = written if suffix == "bag" else written / f"{written.name}.{suffix}"
    make, message = BROKEN[how]
    path = tmp_path / f"broken.{suffix}"
    path.write_bytes(make(whole.read_bytes()))
    refused(path, message)


def definition(words, name="my_ship/msg/Steering"):
    """Types of a bag that carries this definition."""
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    class Link:
        msgtype = name
        msgdef = MessageDefinition(MessageDefinitionFormat.MSG, words)

    return bags._store([Link()])


@pytest.mark.parametrize(
    ("words", "name", "message"),
    [
        ("float64 angle\n", "my/msg/X:\n  pass\nopen('trap', 'w')\nclass Y", "Could not parse"),
        ("float64 angle'); open('trap', 'w'); ('\n", "my/msg/X", "Could not parse"),
        ("float64[99999999] angles\n", "my/msg/X", "a list of more than 10000 entries"),
        ("string[99999999] words\n", "my/msg/X", "a list of more than 10000 entries"),
        ("float64 angle\n" * 100_000, "my/msg/X", "too long"),
    ],
)
def test_definitions_that_are_more_than_plain_fields_are_refused(tmp_path, monkeypatch, words, name, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Exception, match=message):
        definition(words, name)
    assert not (tmp_path / "trap").exists()


def test_pictures_are_not_looked_into_and_words_of_python_are_names_like_others():
    types = definition("uint32 height\nuint8[] data\nuint32 from\n").fielddefs
    assert bags._topic(types, "/camera", "my_ship/msg/Steering").getters == {}
    named = definition("float64 from\nfloat64[3] three\n").fielddefs
    getters = bags._topic(named, "/wind", "my_ship/msg/Steering").getters
    assert list(getters) == ["/wind.from"] and getters["/wind.from"](SimpleNamespace(from_=2.5)) == 2.5


def test_definitions_that_branch_without_end_are_given_up():
    parts = [f"MSG: my/T{k}\n" + "".join(f"T{k + 1} f{j}\n" for j in range(9)) for k in range(9)]
    line = "=" * 80 + "\n"
    types = definition("T0 f\n" + line + line.join(parts) + line + "MSG: my/T9\nstring s\n", "my/msg/X").fielddefs
    assert bags._topic(types, "/x", "my/msg/X").getters == {}


def test_names_that_slip_through_the_parser_are_refused_before_they_become_code(monkeypatch):
    monkeypatch.setattr("rosbags.typesys.get_types_from_msg", lambda text, name: {"a'; import os; '": ([], [])})
    with pytest.raises(ValueError, match="no plain words"):
        definition("float64 angle\n")


def test_a_message_that_holds_itself_is_left_out(zz20, tmp_path):
    path = write_bag(tmp_path / "run.bag", zz20.between(0.0, 5.0))
    plain, itself = b"float64 angle\nstring note\n", b"my_ship/Steering a\nbyte b\n"
    assert len(plain) == len(itself) and plain in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(plain, itself))
    table = read_table(path)
    assert (
        table.notes == ("Topics that hold no plain numbers are left out: /note, /rudder.",) and HEADING in table.cells
    )


def test_without_rosbags_the_extra_is_named(zz20, tmp_path, monkeypatch):
    path = write_bag(tmp_path / "run.bag", zz20.between(0.0, 5.0))
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    refused(path, r"pip install 'manoeuvre-nn\[ros\]'")


def test_parts_of_vectors_are_the_channels_that_they_measure():
    vectors = {"twist.linear.x [m/s]": "u", "twist.linear.y [m/s]": "v", "twist.angular.z [rad/s]": "r",
               "pose.position.x [m]": "x", "angular_velocity.x [rad/s]": "p", "linear_acceleration.x": None,
               "magnetic_field.y": None, "linear.z [m/s]": None}  # fmt: skip
    for part, channel in vectors.items():
        found = assign([take_apart(f"/imu/data.{part}")])
        assert list(found) == ([channel] if channel else []), part


def test_a_bag_that_unpacks_to_more_than_there_is_memory_is_not_called_damaged(zz20, tmp_path, monkeypatch):
    def unpack(path):
        raise MemoryError

    write_bag(tmp_path / "run.bag", zz20)
    monkeypatch.setattr(bags, "_read", unpack)
    with pytest.raises(InputError, match=r"run\.bag: what it holds takes more memory than is free: cut it into parts"):
        read_table(tmp_path / "run.bag")
