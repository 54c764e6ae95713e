"""The recordings that come with the package: made by their script, found under their name, telling nothing."""

from pathlib import Path

import pytest
from fleet import unchecked

from manoeuvre_nn.diagnosis.case import read_runs
from manoeuvre_nn.recording.read.reader import place_of, read_recordings
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.data import recorded_files
from scripts.sample_recordings import CONCEALED, FOLDER, TRIALS, sample

LIGHT = "zz10"


def test_the_name_sample_stands_for_the_folder_that_comes_with_the_package():
    assert place_of("sample").samefile(FOLDER)
    assert place_of("elsewhere") == Path("elsewhere")


def test_a_folder_of_ones_own_that_is_called_sample_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample").mkdir()
    assert place_of("sample") == Path("sample")


@pytest.mark.parametrize("trial", [pytest.param(t, marks=() if t == LIGHT else pytest.mark.slow) for t in TRIALS])
def test_a_sample_recording_is_made_again_bit_for_bit(trial, tmp_path):
    made = tmp_path / f"{trial}.csv"
    with unchecked():  # a person writes 120 where an annotation says float
        sample(trial).to_csv(made)
    assert made.read_bytes() == (FOLDER / made.name).read_bytes()


def test_the_samples_are_small_and_tell_nothing_of_what_they_conceal():
    files = sorted(FOLDER.iterdir())
    assert [f.stem for f in files if f.suffix == ".csv"] == sorted(TRIALS)
    assert sum(f.stat().st_size for f in files) < 300_000
    told = "".join(f.name + f.read_text() for f in files).lower()
    assert not any(word.partition("_")[0] in told for word in CONCEALED)


def test_the_samples_are_read_for_a_diagnosis_with_their_ship_and_some_held_out():
    case = read_runs(place_of("sample"))
    assert case.hull.particulars.name == "Mariner"
    assert len(case.fitted) == 2 and len(case.held_out) == 2


def test_the_samples_are_read_by_their_name_from_python_and_for_a_training():
    ship = mariner()
    assert [run.name for run in read_recordings("sample", None, ship.particulars)] == sorted(TRIALS)
    data = recorded_files(ship, ship, ["zz*.csv"], [], None, folder="sample")
    assert {run.name for run in data.runs} == {"zz10", "zz20"}
