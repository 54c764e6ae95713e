"""Recordings with a mistake in them are refused in one line that says what to do."""

import numpy as np
import pytest
from sailed import sailed, write_runs

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.diagnosis.case import RunSettings, read_runs
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
OVER_GROUND = ["x_north", "y_east", "sog", "cog", "u", "v"]


def refusal(folder, change, which=0, **settings) -> str:
    """What is said of one changed run."""
    write_runs(folder, {"run": change(sailed(0.4)[which].copy())})
    with pytest.raises(InputError) as refused:
        read_runs(folder, SHIP, RunSettings(**{"rudder_positive_to": "port", **settings}))
    message = str(refused.value)
    assert "\n" not in message and len(message) < 500
    return message


def with_cell(column, row, value):
    def change(t):
        return t.astype({column: object}).assign(**{
            column: [value if k == row else v for k, v in enumerate(t[column])]
        })

    return change


ANGLES = {name: DEGREE for name in ("psi", "cog", "delta", "delta_order", "r")}
MISTAKES = {
    "a column is missing": (lambda t: t.drop(columns="psi"), "no column 'psi'; it has: t, x_north"),
    "no time": (lambda t: t.drop(columns="t"), "no column 't'"),
    "no heading": (lambda t: t.assign(psi=np.nan), "column 'psi' holds no numbers"),
    "no rudder": (lambda t: t.assign(delta=""), "column 'delta' holds no numbers"),
    "a rudder that is stuck": (lambda t: t.assign(delta=0.0, delta_order=0.0), "the rudder stays within 0 deg while"),
    "rudder mostly lost": (
        lambda t: t.assign(**{k: t[k].where(t.t < 150) for k in ("delta", "delta_order")}), "38% of delta is empty"
    ),
    "no position, no velocity": (lambda t: t.drop(columns=OVER_GROUND), "needs x_north, y_east or sog, cog or u, v"),
    "half a position": (lambda t: t.drop(columns=[*OVER_GROUND[1:]]), "neither position nor velocity"),
    "the log called u": (
        lambda t: t.drop(columns=["v", "u_log"]).assign(u=t.u_log), "'u' stands without 'v'; if it is the log's speed"
    ),
    "speed without course": (lambda t: t.drop(columns="cog"), "'sog' stands without 'cog'"),
    "a word": (with_cell("r", 50, "fast"), "line 52: column 'r' is 'fast'"),
    "an endless number": (with_cell("u_log", 50, "inf"), "line 52: column 'u_log' is inf"),
    "time lost": (with_cell("t", 50, ""), "line 52: column 't' is empty"),
    "time going back": (with_cell("t", 50, 48.0), "line 52: column 't' goes from 49 to 48; times must increase"),
    "too short": (lambda t: t[t.t <= 30], "too short a record: 31 samples over 30 s; the Mariner needs at least 20"),
    "one sample": (lambda t: t.head(1), "too short a record: 1 samples"),
    "no sample": (lambda t: t.head(0), "no line of numbers below the headings"),
    "too few samples": (lambda t: t[::8], "samples are 8 s apart; the Mariner needs one every 5 s or more often"),
    "time in ms": (lambda t: t.assign(t=t.t * 1000), "samples are 1000 s apart"),
    "time in min": (lambda t: t.assign(t=t.t / 60), "too short a record"),
    "times at random": (
        lambda t: t.assign(t=t.t + np.where(t.t % 2, 0.7, 0.0)), "of the times between samples are more than half off"
    ),
    "a heading in any order": (
        lambda t: t.assign(psi=np.random.default_rng(0).permutation(t.psi)), "psi has no order in time"
    ),
    "a heading that never moves": (lambda t: t.assign(psi=10.0), "psi never moves, while the course turns through"),
    "a position in any order": (
        lambda t: t.assign(y_east=np.random.default_rng(0).permutation(t.y_east)), "y has no order in time"
    ),
    "a position that never moves": (lambda t: t.assign(x_north=7.0), "x never moves, while the heading turns through"),
    "psi in rad": (lambda t: t.assign(psi=t.psi * DEGREE), "psi looks like radians"),
    "psi in rad, no track": (
        lambda t: t.assign(psi=t.psi * DEGREE).drop(columns=OVER_GROUND[:4]), "psi looks like radians"
    ),
    "all in rad": (lambda t: t.assign(**{k: t[k] * unit for k, unit in ANGLES.items()}), "psi looks like radians"),
    "r in rad/s": (lambda t: t.assign(r=t.r * DEGREE), "r looks like rad/s"),
    "r in deg/min": (lambda t: t.assign(r=t.r * 60), "r looks like deg/min"),
    "r to port": (lambda t: t.assign(r=-t.r), "write sign: -1 for r"),
    "delta in rad": (lambda t: t.assign(delta=t.delta * DEGREE), "delta looks like radians, not degrees"),
    "delta in ten thousandths": (lambda t: t.assign(delta=t.delta * 3), "that of the Mariner stops at 35 deg"),
    "speed in knots": (lambda t: t.assign(sog=t.sog / KNOT), "u and v look like knots"),
    "speed in km/h": (lambda t: t.assign(sog=t.sog * 3.6), "u and v look like km/h"),
    "speed in knots, no track": (
        lambda t: t.assign(sog=t.sog / KNOT).drop(columns=["x_north", "y_east"]), "the Mariner approaches at 7.614 m/s"
    ),
    "log in knots": (lambda t: t.assign(u_log=t.u_log / KNOT), "u_log looks like knots"),
    "n in 1/s": (lambda t: t.assign(n=t.n / 60), "n is 1.27 rpm; nominal for the Mariner is 76 rpm: mind the unit"),
    "rudder to starboard": (lambda t: t.assign(delta=-t.delta), "change rudder_positive_to"),
    "x and y swapped": (
        lambda t: t.rename(columns={"x_north": "y_east", "y_east": "x_north"}), "x and y look swapped (x is north"
    ),
    "x and y swapped, no velocity": (
        lambda t: t.rename(columns={"x_north": "y_east", "y_east": "x_north"}).drop(columns=["sog", "cog", "u", "v"]),
        "x is north and y east, cog and psi are clockwise from north",
    ),
    "y to the west": (lambda t: t.assign(y_east=-t.y_east), "write sign: -1 for y"),
    "u and v swapped": (
        lambda t: t.rename(columns={"u": "v", "v": "u"}).drop(columns=["sog", "cog"]), "u and v look swapped"
    ),
    "v to port": (lambda t: t.assign(v=-t.v).drop(columns=["sog", "cog"]), "write sign: -1 for v"),
    "course from the east": (lambda t: t.assign(cog=90 - t.cog), "exchange"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(tmp_path, name):
    change, told = MISTAKES[name]
    assert told in refusal(tmp_path, change)


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize(
    "name", ["psi in rad", "r in deg/min", "speed in knots", "rudder to starboard", "y to the west"]
)
def test_the_usual_mistakes_are_seen_in_every_manoeuvre(tmp_path, name, which):
    change, told = MISTAKES[name]
    assert told in refusal(tmp_path, change, which)


def test_what_can_be_done_about_a_unit_is_said(tmp_path):
    message = refusal(tmp_path, MISTAKES["r in rad/s"][0])
    assert "csv columns are t in s, x_north, y_east in m" in message and "mapping=FILE.yaml" in message
    assert "csv columns" not in refusal(tmp_path, MISTAKES["rudder to starboard"][0])


def test_a_heading_in_another_file_format_is_checked_too(tmp_path):
    channels = {"x": {"column": "x_north", "unit": "m"}, "y": {"column": "y_east", "unit": "m"}}
    channels |= {"psi": {"column": "psi", "unit": "deg"}, "delta": {"column": "delta", "unit": "deg"}}
    read = mapping(time={"column": "t", "unit": "s"}, channels=channels, rudder_positive_to="port")
    message = refusal(tmp_path, lambda t: t.assign(psi=t.psi * DEGREE), mapping=read, rudder_positive_to=None)
    assert "psi looks like radians; mind the columns, units and signs of the mapping" in message


def test_a_gyro_with_a_constant_error_is_no_wrong_unit(tmp_path):
    for k in range(4):
        write_runs(tmp_path, {f"r{k}": sailed(0.4)[k].assign(r=sailed(0.4)[k].r + 0.3)})
    assert len(read_runs(tmp_path, SHIP, RunSettings(rudder_positive_to="port")).runs) == 4


@pytest.mark.parametrize("sensor, spike", [("psi", 90.0), ("delta", 60.0), ("r", 30.0), ("x_north", 5e3), ("n", 9e3)])
def test_single_outliers_are_no_mistake(tmp_path, sensor, spike):
    table = sailed(0.4)[0].copy()
    table.loc[[60, 130], sensor] += spike
    write_runs(tmp_path, {"run": table})
    assert len(read_runs(tmp_path, SHIP, RunSettings(rudder_positive_to="port")).runs) == 1


@pytest.mark.parametrize(
    "content, told",
    [
        (b"", "empty file"),
        (b"\x89PNG\0\0\0", "not a text file"),
        (b"a;b;c\n1;2;3\n", "is the delimiter ','?"),
        (b"name,age\nAnna,7\n", "no column 't'; it has: name, age"),
        (b"t,psi,delta,sog,cog\n0,1,2,3,4\n1,1,2\n", "line 3: 3 cells, expected 5 (cut off?)"),
        (b"t,psi,psi,delta\n0,1,2,3\n", "column 'psi' stands 2 times; rename one"),
        (b"t,psi,delta,n,n\n" + b"".join(b"%d,1,2,3,4\n" % k for k in range(99)), "column 'n' stands 2 times"),
    ],
)
def test_a_foreign_or_damaged_file_is_refused_by_name(tmp_path, content, told):
    (tmp_path / "run.csv").write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_runs(tmp_path, SHIP)
    assert told in str(refused.value) and "run.csv" in str(refused.value) and "\n" not in str(refused.value)


def test_folders_without_recordings_are_refused(tmp_path):
    with pytest.raises(InputError, match="nowhere is not a folder: write the folder that holds the csv files"):
        read_runs(tmp_path / "nowhere", SHIP)
    with pytest.raises(InputError, match="holds no csv file"):
        read_runs(tmp_path, SHIP)
    write_runs(tmp_path, {"run": sailed(0.4)[0]})
    with pytest.raises(
        InputError,
        match="ship= is not given, and the folder of recordings= names none: write for instance ship=esso_190k",
    ):
        read_runs(tmp_path)


@pytest.mark.parametrize(
    "settings, told",
    [
        ({"held_out": ["zz9"]}, "run in held_out 'zz9' is unknown; choose one of: run"),
        ({"held_out": ["run"]}, "held out are all runs (run): leave at least one to fit"),
        ({"rudder_positive_to": "left"}, "rudder_positive_to"),
        ({"speed_kn": 0.0}, "approach_speed_m_s is 0.0; expected a number more than 0"),
        ({"speed_kn": 40.0}, "approach speed 20.6 m/s; the Mariner was identified at 7.61 m/s: write speed_kn"),
        ({"rpm": -5.0}, "nominal_rpm is -5.0; expected a number more than 0"),
        ({"warmup_s": -5.0}, "warmup_s is -5.0; expected a number more than 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(tmp_path, settings, told):
    assert told in refusal(tmp_path, lambda t: t, **settings)
