"""Workbooks are read with the headings that people give them; what cannot be told is refused in one line."""

import datetime

import numpy as np
import pandas as pd
import pytest
from logs import MIDNIGHT, placed
from tiers import only

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.recording.read.table import read_table

openpyxl = pytest.importorskip("openpyxl", reason='Excel files need the extra: pip install -e ".[excel]"')
NAMES = ["Time", "Latitude", "Longitude", "SOG", "COG", "Heading", "ROT", "Rudder angle", "Surge", "Sway"]
UNITS = ["s", "deg", "deg", "kn", "°", "deg", "deg/min", "[deg]", "(kn)", "kn"]


@pytest.fixture
def workbook(zz20, tmp_path):
    def write(above, table=None, **sheets):
        book = openpyxl.Workbook()
        rows = (placed(zz20) if table is None else table).itertuples(index=False, name=None)
        for row in [*above, *map(list, rows)]:
            book.active.append([None if isinstance(cell, float) and np.isnan(cell) else cell for cell in row])
        for title, content in sheets.items():
            sheet = book.create_sheet(title)
            for row in content:
                sheet.append(row)
        book.save(tmp_path / "run.xlsx")
        return tmp_path / "run.xlsx"

    return write


HEADINGS = {
    "one line": [[f"{name} [{unit.strip('[]()')}]" for name, unit in zip(NAMES, UNITS, strict=True)]],
    "without brackets": [[f"{name} {unit}" for name, unit in zip(NAMES, UNITS, strict=True)]],
    "units below": [NAMES, UNITS],
    "a title and an empty line": [["Sea trial of the Mariner"], [], NAMES, UNITS],
}


@pytest.mark.parametrize("how", only({"without brackets", "a title and an empty line"}, HEADINGS))
def test_a_workbook_is_proposed_and_read_as_it_was_sailed(zz20, ship, workbook, how):
    path = workbook(HEADINGS[how], notes=[["calm"], ["sea", "state", 2]])
    made = propose(path, ship)
    assert made.finding is None and set(made.questions) == {"reference_point"}
    assert {c.channel: c.unit for c in made.choices}["r"] == "deg/min"
    record = read_recording(path, made.mapping, ship)
    for name in ("u", "v", "r", "delta", "psi"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-12)


def test_headings_over_several_columns_are_joined_with_those_below(zz20, workbook):
    table = pd.DataFrame({"t": zz20.time, "a": 1.0, "b": 2.0, "c": 3.0})
    above = [["", "Rudder", None, "Heading"], ["Time", "Starboard", "Port", "true"], ["s", "deg", "deg", "deg"]]
    assert list(read_table(workbook(above, table)).cells) == [
        "Time s",
        "Rudder Starboard deg",
        "Rudder Port deg",
        "Heading true deg",
    ]


def test_dates_times_of_day_and_durations_are_times(zz20, workbook):
    for cell, unit, first in (
        (lambda t: MIDNIGHT.to_pydatetime() + datetime.timedelta(seconds=t), "iso", MIDNIGHT.timestamp()),
        (lambda t: (MIDNIGHT + pd.Timedelta(seconds=t)).time(), "clock", 86220.0),
        (lambda t: datetime.timedelta(seconds=t), "s", 0.0),
    ):
        table = pd.DataFrame({"t": pd.Series([cell(t) for t in zz20.time], dtype=object), "hdg": zz20["psi"] / DEGREE})
        read = read_table(workbook([["Time", "Heading [deg]"]], table))
        np.testing.assert_allclose(read.times("Time", unit), first + zz20.time, atol=1e-3)


def test_empty_cells_are_gaps(zz20, workbook):
    table = placed(zz20)
    table.loc[30, "hdg"] = np.nan
    assert np.flatnonzero(np.isnan(read_table(workbook([NAMES], table)).numbers("Heading"))) == [30]


def refused(path, message):
    with pytest.raises(InputError, match=message) as error:
        read_table(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_of_two_sheets_with_numbers_none_is_guessed_but_hidden_ones_do_not_count(workbook):
    numbers = [["t", "u"], *([k, 1.0] for k in range(9))]
    path = workbook([NAMES], second=numbers)
    refused(path, r"2 sheets hold rows of numbers \(Sheet, second\); hide all but one")
    book = openpyxl.load_workbook(path)
    book["second"].sheet_state = "hidden"
    book.save(path)
    assert list(read_table(path).cells) == NAMES


def test_a_broken_or_foreign_workbook_is_refused(zz20, workbook, tmp_path, monkeypatch):
    path = workbook([NAMES], pd.DataFrame(columns=NAMES))
    refused(path, "no sheet with rows of numbers below headings; it has: Sheet")
    whole = workbook([NAMES]).read_bytes()
    for content in (b"t,u\n1,2\n", whole[: len(whole) // 2], b"PK\3\4" + bytes(100), b"\xd0\xcf\x11\xe0" + bytes(600)):
        path.write_bytes(content)
        refused(path, "not an Excel workbook, or cut off")
    spoilt = bytearray(whole)
    sheet = whole.index(b"xl/worksheets/sheet1.xml") + 60
    spoilt[sheet : sheet + 60] = b"\xff" * 60
    path.write_bytes(spoilt)
    refused(path, "not an Excel workbook, or cut off")
    path.write_bytes(b"")
    refused(path, "empty file")
    path.write_bytes(whole)
    monkeypatch.setattr("manoeuvre_nn.core.memory.free_memory", lambda: 1000.0)
    refused(path, "GB of cells need about")
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    refused(path, r"pip install 'manoeuvre-nn\[excel\]'")


def test_a_cell_is_called_by_its_row_in_excel(zz20, workbook):
    table = placed(zz20).astype(object)
    table.loc[20, "hdg"] = "calm"
    path = workbook([["Sea trial"], [], NAMES, UNITS], table)
    with pytest.raises(InputError, match="run.xlsx, row 25: column 'Heading deg' is 'calm'"):
        read_table(path).numbers("Heading deg")
    book = openpyxl.load_workbook(path)
    book.active.insert_rows(10, 3)
    book.save(path)
    with pytest.raises(InputError, match="row 28: column 'Heading deg' is 'calm'"):
        read_table(path).numbers("Heading deg")


def test_cells_marked_as_dates_that_are_none_give_no_warnings(zz20, workbook, recwarn):
    path = workbook([NAMES])
    book = openpyxl.load_workbook(path)
    for row in range(2, 9):
        book.active.cell(row, 1, 1e9).number_format = "yyyy-mm-dd"
    book.save(path)
    recwarn.clear()
    assert list(read_table(path).cells) == NAMES and not recwarn.list
