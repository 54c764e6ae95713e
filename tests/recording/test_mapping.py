import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.read.captive import captive_mapping
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.records import records_mapping


def refused(columns, message, channels=None, **settings):
    with pytest.raises(InputError, match=message) as error:
        columns(channels, **settings)
    assert "\n" not in str(error.value)


def test_a_unit_and_a_sign_become_one_factor(columns):
    read = columns({"u": {"column": "speed", "unit": "kn"}, "psi": {"column": "hdg", "unit": "deg", "sign": -1}})
    assert read.factor("u") == KNOT
    assert read.factor("psi") == -DEGREE
    assert read.factor("time") == 1.0


def test_a_rudder_positive_to_port_is_turned_round(columns):
    order = {"delta_order": {"column": "order", "unit": "deg"}}
    read = columns(order, rudder_positive_to="port")
    assert read.factor("delta") == -1.0
    assert read.factor("delta_order") == -DEGREE
    assert read.factor("psi") == 1.0


def test_an_unknown_key_is_refused_and_the_known_ones_are_listed(columns):
    refused(columns, "'rudder_side' is unknown; choose one of: .*rudder_positive_to", rudder_side="port")


def test_an_unknown_unit_is_refused_and_the_known_ones_are_listed(columns):
    refused(
        columns,
        "unit of u .speed. 'knots' is unknown; choose one of: m/s, kn, km/h",
        {"u": {"column": "u", "unit": "knots"}},
    )


def test_an_angle_is_no_rate_of_turn(columns):
    refused(
        columns, "unit of r .* 'deg' is unknown; choose one of: rad/s, deg/s", {"r": {"column": "r", "unit": "deg"}}
    )


def test_an_unknown_channel_is_refused(columns):
    refused(columns, "channel 'yaw' is unknown", {"yaw": {"column": "yaw", "unit": "deg"}})


@pytest.mark.parametrize("missing", ["psi", "delta"])
def test_a_channel_that_nothing_replaces_must_be_there(columns, missing):
    refused(columns, f"channels has no {missing}", {missing: None})


def test_velocities_or_positions_must_be_there(columns):
    refused(columns, "has no u and v .or x and y.", {"u": None, "x": None})


@pytest.mark.parametrize(
    ("setting", "value"),
    [("frame", "ship"), ("rudder_positive_to", "left"), ("skip_rows", 1.5), ("fill_gaps", "yes"), ("kind", "zig"),
     ("reference_point", "bow"), ("delimiter", "tab"), ("header", 1), ("place", "basin")],
)  # fmt: skip
def test_a_setting_that_makes_no_sense_is_refused(columns, setting, value):
    refused(columns, setting, **{setting: value})


def test_a_column_without_a_unit_is_refused():
    with pytest.raises(InputError, match="write u: {column: HEADING, unit: UNIT}"):
        mapping(time={"column": "t", "unit": "s"}, channels={"u": "speed"})


def test_a_sign_is_one_or_minus_one(columns):
    refused(columns, "sign of u is 2; write 1 or -1", {"u": {"column": "u", "unit": "m/s", "sign": 2}})


def test_a_mapping_without_time_is_refused():
    with pytest.raises(InputError, match="time is None"):
        mapping(channels={})


@pytest.mark.parametrize("side", [["port"], None, 1])
def test_a_side_that_is_no_word_is_refused(columns, side):
    refused(columns, "rudder_positive_to", rudder_positive_to=side)


@pytest.mark.parametrize("delimiter", [None, "", ";;", '"', "\n"])
def test_what_parts_no_columns_is_refused(columns, delimiter):
    refused(columns, "delimiter=.*write one character such as ; or the word whitespace", delimiter=delimiter)


@pytest.mark.parametrize("sign", [[1], True, 2, "minus", None])
def test_a_sign_that_is_none_is_refused(columns, sign):
    refused(columns, "sign of u is .*; write 1 or -1", {"u": {"column": "u", "unit": "m/s", "sign": sign}})


@pytest.mark.parametrize("heading", [True, None, ["u"]])
def test_a_heading_that_yaml_took_for_something_else_is_refused(columns, heading):
    refused(columns, "column of u is .*in quotation marks", {"u": {"column": heading, "unit": "m/s"}})


def test_the_example_of_channels_is_one_of_channels():
    with pytest.raises(InputError, match="channels is None; write e.g. channels: {psi"):
        mapping(time={"column": "t", "unit": "s"}, channels=None)


@pytest.mark.parametrize(
    ("channels", "settings", "said"),
    [
        ({"u": {"column": "v", "unit": "m/s"}}, {}, "u and v both name the column 'v'"),
        ({"psi": {"column": "delta", "unit": "rad"}}, {}, "psi and delta both name the column 'delta'"),
        ({"n": {"column": "u", "unit": "rpm"}}, {"optional": True}, "u and n both name the column 'u'"),
        ({"r": {"column": "t", "unit": "rad/s"}}, {}, "time and r both name the column 't'"),
        ({"q": {"column": "r", "unit": "count"}}, {"kind": "record"}, "r and q both name the column 'r'"),
    ],
)
def test_a_column_is_one_channel(columns, channels, settings, said):
    refused(columns, f"mapping: {said}; a column is one of them", channels, **settings)


def test_a_column_of_a_table_is_one_quantity():
    one = {name: {"column": name} for name in ("X", "Y", "N")} | {"beta": {"column": "a", "unit": "deg"}}
    with pytest.raises(InputError, match="captive mapping: beta and delta both name the column 'a'"):
        captive_mapping(columns=one | {"delta": {"column": "a", "unit": "deg"}})
    with pytest.raises(InputError, match="mapping of records: Hs and T both name the column 'h'"):
        records_mapping(columns={"Hs": {"column": "h", "unit": "m"}, "T": {"column": "h", "unit": "s"}})


def test_a_drift_is_a_word_or_a_velocity(columns):
    refused(columns, "drift=\\['a'\\]; write keep, arcs", drift=["a"])
