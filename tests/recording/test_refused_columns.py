"""Cells that no ship wrote: times far off, places off the earth, numbers that overflow, words instead of numbers."""

import io
import warnings

import numpy as np
import pandas as pd
import pytest
from exports import gps, plain
from rich.console import Console

from manoeuvre_nn.commands.import_recording import show
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.position import misplaced
from manoeuvre_nn.recording.read.reader import read_measured, read_recording

DEGREES = {
    "exchanged": (
        lambda lat, lon: (lon + 129, lat),
        "line 2: column 'Latitude' is 134 deg, expected at most 90 deg: are",
    ),
    "too far north": (lambda lat, lon: (lat + 50, lon), "column 'Latitude' is 93 deg, expected at most 90 deg"),
    "too far east": (lambda lat, lon: (lat, lon + 520), "column 'Longitude' is 525 deg, expected at most 360 deg"),
    "near a pole": (
        lambda lat, lon: (lat - 132.7, lon),
        "is -89.7 deg, within 1 deg of a pole, where east has no",
    ),
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.csv"


def write_plain(run, path):
    pd.DataFrame(plain(run)).to_csv(path, index=False)
    return path


def refused(message, do, *given):
    with warnings.catch_warnings(), pytest.raises(InputError, match=message) as error:
        warnings.simplefilter("error")
        do(*given)
    assert "\n" not in str(error.value)


def test_a_wrong_time_or_two_runs_years_apart_are_refused_before_they_take_all_memory(zz20, ship, path):
    table = pd.DataFrame(plain(zz20))
    last, gap = len(table) - 1, 1e9
    table.assign(t=table["t"].where(table.index < last, gap)).to_csv(path, index=False)
    refused(
        rf"line {last + 2}: column 't' jumps from .* to 1000*, where steps of 1 are usual: mend", propose, path, ship
    )
    reading = propose(write_plain(zz20, path.with_name("plain.csv")), ship).mapping
    refused(f"line {last + 2}: column 't' jumps from 359", read_measured, path, reading, ship, True)
    stamps = pd.Timestamp("2020-07-31") + pd.to_timedelta(table["t"] + gap * (table.index == last), unit="s")
    table.assign(t=stamps.dt.strftime("%Y-%m-%dT%H:%M:%S")).to_csv(path, index=False)
    refused(rf"line {last + 2}: column 't' jumps from", propose, path, ship)


def test_a_hole_of_minutes_is_read_over(zz20, path):
    table = pd.DataFrame(plain(zz20))
    table.assign(t=table["t"] + 600.0 * (table["t"] > 100)).to_csv(path, index=False)
    made = propose(path)
    assert made.time.column == "t" and made.settings["rudder_positive_to"] == "starboard"


@pytest.mark.parametrize("how", DEGREES)
def test_places_off_the_earth_and_at_its_poles_are_refused(zz20, ship, path, how):
    change, message = DEGREES[how]
    table = pd.DataFrame(gps(zz20)).round({"Latitude": 9})
    table.to_csv(path, index=False)
    reading = propose(path, ship).mapping
    moved = change(table["Latitude"], table["Longitude"])
    table.assign(Latitude=moved[0], Longitude=moved[1]).to_csv(path, index=False)
    refused(message, propose, path, ship)
    refused(message, read_recording, path, reading, ship)


@pytest.mark.parametrize(
    ("channel", "degrees", "bad"),
    [("lat", 89.0, False), ("lat", -89.1, True), ("lat", 90.1, True), ("lon", 360.0, False), ("lon", -360.1, True),
     ("lon", 89.5, False), ("psi", 720.0, False)],
)  # fmt: skip
def test_limits_of_latitude_and_longitude(channel, degrees, bad):
    assert misplaced(channel, np.radians([0.0, np.nan, degrees]))[0].tolist() == [False, False, bad]


def test_a_single_wild_fix_is_an_outlier(zz20, ship, path):
    table = pd.DataFrame(gps(zz20))
    table.loc[40, "Latitude"] = 99.0
    table.to_csv(path, index=False)
    made = propose(path, ship)
    assert "line 42: column 'Latitude' is 99 deg, expected at most 90 deg" in made.finding
    filled = made.settings | {"outliers": "fill"}
    assert read_recording(path, mapping(**filled), ship).meta["outliers"]["lat"] == 1


def test_numbers_that_overflow_are_refused_without_a_warning(zz20, ship, path):
    table = pd.DataFrame(plain(zz20))
    table.loc[100, "x"] = 1e308
    table.to_csv(path, index=False)
    refused("line 102: column 'x' is 1e.308, which no motion of a ship does: mend this cell", propose, path, ship)


def test_a_word_among_times_is_called_so(zz20, ship, path):
    text = pd.DataFrame(plain(zz20)).to_csv(index=False)
    path.write_text(text + text)
    refused("line 363: column 't' is 't', no number; mend this cell, or delete the line", propose, path, ship)
    path.write_text(text.replace("\n100.0,", "\n1_00,"))
    refused("line 102: column 't' is '1_00', no number", propose, path, ship)
    path.write_text(text.replace("\n100.0,", "\n,"))
    refused("line 102: column 't' is empty; a sample without a time", propose, path, ship)


def test_columns_that_hold_no_numbers_are_named_with_what_they_hold(zz20, ship, path):
    table = pd.DataFrame(plain(zz20))
    table["x"] = [f"{x:,.3f}".replace(",", "'") for x in 12345 + table["x"]]
    table.to_csv(path, index=False)
    made = propose(path, ship)
    assert made.file.words == {"x": "12'345.000"}
    console = Console(file=io.StringIO(), width=200)
    show(made, console)
    shown = console.file.getvalue()
    assert """Not read: y, x (no numbers: it holds "12'345.000").""" in shown
    assert "y ('y') is left out: no column is called like x, which belongs to it." in shown


def test_two_columns_of_one_name_without_their_partner_are_told(zz20, ship, path):
    table = pd.DataFrame(plain(zz20)).rename(columns={"x": "x [m]", "y": "X [m]"})
    table.to_csv(path, index=False)
    assert "x ('x [m]' and 'X [m]') is left out: no column is called like y, which belongs to it." in (
        propose(path, ship).notes
    )
