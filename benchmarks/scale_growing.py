"""What is done with recordings of growing size, step by step."""

import shutil
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from scale_inputs import write_voyage

from manoeuvre_nn.commands.main import run
from manoeuvre_nn.diagnosis.case import read_runs
from manoeuvre_nn.recording.read.mapping_file import WRITTEN
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner_corrected
from manoeuvre_nn.training.data import DataSettings, RecordedData

Steps = Iterator[tuple[str, Callable[[], object]]]
SHIP = "ship=mariner_corrected"
RATE, SHORT = 100.0, 301
"""Samples a second of a recording of many rows; samples of one of many files."""


def command(*words: str) -> None:
    """A command, as from a terminal."""
    sys.argv = ["manoeuvre", *words[1:]]
    run(words[0], list(words[1:]))


def rows(count: int, folder: Path) -> Steps:
    """One recording of so many rows."""
    path, ship = _fresh(folder) / "rows.csv", mariner_corrected()
    yield "(write)", partial(write_voyage, path, count, RATE)
    yield "read", lambda: read_recording(path, WRITTEN, ship.particulars)
    yield "prepare", lambda: read_runs(path.parent, ship)
    yield "check", partial(command, "check", SHIP, f"data.folder={path.parent}", f"out={folder}/out")
    yield "import", partial(command, "import", str(path), "ship=mariner", f"out={folder}/mine.yaml", "overwrite=true")


def files(count: int, folder: Path) -> Steps:
    """A folder of so many recordings."""
    place = _fresh(folder)
    yield "(write)", partial(_write_copies, place, count)
    words = (SHIP, f"data.folder={place}", "figures=false", f"out={folder}/out")
    yield "check", partial(command, "check", *words)
    yield "train data", partial(_data_of, place)


def _write_copies(place: Path, count: int) -> None:
    """The first minutes of a voyage, so many times."""
    first = write_voyage(place / "run0000.csv", SHORT)
    for number in range(1, count):
        shutil.copy(first, place / f"run{number:04}.csv")


def _data_of(place: Path) -> None:
    """Recordings read, checked and made tuples, a third of them held out."""
    ship = mariner_corrected()
    runs = [read_recording(path, WRITTEN, ship.particulars) for path in sorted(place.iterdir())]
    held = len(runs) // 3
    RecordedData(ship, clarke_part(ship), runs[held:], runs[:held], settings=DataSettings()).setup()


def hours(count: int, folder: Path) -> Steps:
    """A voyage of so many hours, a sample a second, and half an hour to prove by."""
    place = _fresh(folder)
    yield (
        "(write)",
        lambda: [write_voyage(place / f"{n}.csv", s) for n, s in (("voyage", 3600 * count), ("short", 1800))],
    )
    of_files = (f"data.folder={place}", "data.files=[voyage.csv]")
    yield "check", partial(command, "check", SHIP, *of_files, f"out={folder}/out")
    recorded = (SHIP, "data=recording", *of_files, "score=[short.csv]", f"out={folder}/fitted")
    yield "coefficients", partial(command, "coefficients", *recorded)
    asked = (SHIP, f"recordings={place}", "held_out=[short]", "candidates=[current]", "workers=1")
    yield "diagnose", partial(command, "diagnose", *asked, f"out={folder}/diagnosed")


def _fresh(folder: Path) -> Path:
    """An empty folder for the inputs; what commands wrote before is gone."""
    for old in folder.iterdir():
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    (folder / "inputs").mkdir()
    return folder / "inputs"
