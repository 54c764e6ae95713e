from pathlib import Path

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import Records, Variable
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.read.records import read_records, records_mapping, unit_size

INPUTS = (
    Variable("V", "kn", KNOT, "speed", low=0.0, high=60 * KNOT),
    Variable("beta", "deg", DEGREE, "heading", low=0.0, high=np.pi),
    Variable("Hs", "m", 1.0, "wave height", low=0.0, high=25.0),
    Variable("T", "s", 1.0, "period", low=1.0, high=30.0),
)
PITCH = Variable("pitch", "deg", DEGREE, "pitch", low=0.0, high=45 * DEGREE)
HEAD = "V [kn],beta [deg],Hs [m],T [s],pitch [deg]"
LINES = ("10,0,2,8,0.9", "12,90,3,9,0.4", "15,180,4,10,2.5")
COLUMNS = {
    "V": {"column": "speed", "unit": "m/s"}, "beta": {"column": "dir", "unit": "deg"},
    "Hs": {"column": "h", "unit": "m"}, "T": {"column": "tz", "unit": "s"},
    "pitch": {"column": "rms", "unit": "deg", "factor": 2.0},
}  # fmt: skip


def table(folder: Path, *lines: str, head: str = HEAD) -> list[Path]:
    path = folder / "voyage.csv"
    path.write_text("\n".join([head, *lines]) + "\n")
    return [path]


def read(folder: Path, *lines: str, head: str = HEAD, **mapping) -> Records:
    return read_records(
        table(folder, *lines, head=head), INPUTS, PITCH, records_mapping(**mapping) if mapping else None
    )


def test_a_table_as_this_package_writes_it_is_read_in_si(tmp_path):
    records = read(tmp_path, *LINES)
    assert records.conditions[1] == pytest.approx([12 * KNOT, np.pi / 2, 3.0, 9.0])
    assert records.values == pytest.approx(np.radians([0.9, 0.4, 2.5]))
    assert "voyage.csv" in records.source


def test_a_mapping_says_columns_units_factors_and_what_heading_zero_is(tmp_path):
    head = "speed,dir,h,tz,rms"
    records = read(tmp_path, "5,0,2,8,0.5", "5,150,2,8,0.5", head=head, columns=COLUMNS, heading_zero="head")
    assert records.conditions[0] == pytest.approx([5.0, np.pi, 2.0, 8.0])
    assert records.conditions[1, 1] == pytest.approx(30 * DEGREE)
    assert records.values[0] == pytest.approx(1.0 * DEGREE)  # significant amplitude: twice the root mean square


def test_waves_from_port_and_starboard_are_one(tmp_path):
    records = read(tmp_path, "10,-30,2,8,1", "10,330,2,8,1", "10,30,2,8,1", "10,360,2,8,1")
    assert records.conditions[:, 1] == pytest.approx(np.radians([30, 30, 30, 0]))


@pytest.mark.parametrize(
    "line, said",
    [
        ("10,0,2,8,", "line 3: column 'pitch \\[deg\\]' is empty"),
        ("10,0,two,8,1", "is 'two'; expected a number"),
        ("10,0,200,8,1", "Hs can be 0 to 25 m"),
        ("-3,0,2,8,1", "V can be 0 to 60 kn"),
        ("10,0,2,8,-1", "pitch can be 0 to 45 deg"),
        ("10,0,2,8,90", "pitch can be 0 to 45 deg"),
        ("10,400,2,8,1", "more than a turn"),
        ("10,0,2,8", "4 cells, expected 5"),
    ],
)
def test_a_cell_that_cannot_be_is_refused_with_its_line(tmp_path, line, said):
    with pytest.raises(InputError, match=said):
        read(tmp_path, LINES[0], line)


def test_height_and_period_that_are_swapped_are_seen_by_the_steepness(tmp_path):
    with pytest.raises(InputError, match="Hs and T swapped"):
        read(tmp_path, *LINES, head="V [kn],beta [deg],T [s],Hs [m],pitch [deg]")


def test_a_missing_column_is_named(tmp_path):
    with pytest.raises(InputError, match="no column 'Hs \\[m\\]'"):
        read(tmp_path, *LINES, head=HEAD.replace("Hs [m]", "height"))


@pytest.mark.parametrize(
    "settings, said",
    [
        ({}, "columns is None"),
        ({"columns": {"V": "speed"}}, "V is 'speed'"),
        ({"columns": {"V": {"column": "s", "unit": "furlong"}}}, "unit 'furlong' is unknown"),
        ({"columns": {"V": {"column": "s", "factor": 0}}}, "factor of V is 0"),
        ({"columns": {}, "heading_zero": "beam"}, "'beam' is unknown"),
        ({"columns": {}, "sign": 1}, "'sign' is unknown"),
    ],
)
def test_a_mapping_that_makes_no_sense_is_refused(settings, said):
    with pytest.raises(InputError, match=said):
        records_mapping(**settings)


def test_a_mapping_without_a_variable_or_with_an_unknown_one_is_refused(tmp_path):
    some = {name: where for name, where in COLUMNS.items() if name != "T"}
    with pytest.raises(InputError, match="columns has no T"):
        read(tmp_path, *LINES, columns=some)
    with pytest.raises(InputError, match="'roll' is unknown"):
        read(tmp_path, *LINES, columns={**COLUMNS, "roll": {"column": "x"}})


def test_units_have_their_value_in_si():
    assert (unit_size("kn"), unit_size("deg"), unit_size("s"), unit_size("m")) == (KNOT, DEGREE, 1.0, 1.0)
