"""Notebooks run from their first cell to their last and print what their text says."""

import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
nbformat = pytest.importorskip("nbformat", reason='notebooks need the extra: pip install -e ".[test]"')
nbclient = pytest.importorskip("nbclient", reason='notebooks need the extra: pip install -e ".[test]"')

LIGHTER = {
    "score=[turning/turn_14-Oct-2020_14_56_07.csv]": "score=[zigzag/zigzag_31-Jul-2020_13_57_45.csv]",  # a third
    "*14_56_07*.png": "*13_57_45*.png",
    "wind_steady,wind_gusty,current,side_force,rudder_offset,heading_bias": "wind_steady,wind_gusty,side_force",
}
"""What takes most of the time and says nothing about what is asked here: a shorter run to score, fewer candidates."""


def lighter(book):
    """The same cells with less to compute."""
    for long, short in LIGHTER.items():
        holding = [cell for cell in book.cells if cell.cell_type == "code" and long in cell.source]
        assert len(holding) == 1, f"the notebook no longer says {long}"
        holding[0].source = holding[0].source.replace(long, short)
    return book


def printed(book) -> str:
    """What the cells printed, tables included, without colours."""
    outputs = [o for cell in book.cells if cell.cell_type == "code" for o in cell.outputs]
    return COLOUR.sub("", "\n".join(o.get("text") or o.get("data", {}).get("text/plain", "") for o in outputs))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_kept_without_outputs_and_defines_nothing(path):
    book = nbformat.read(path, as_version=4)
    for cell in book.cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None, "clear the outputs before committing"
            assert not re.search(r"^\s*(def|class) ", cell.source, re.MULTILINE), "the package defines, notebooks call"


@pytest.mark.recordings
@pytest.mark.parametrize(
    "form", [lighter, pytest.param(lambda book: book, marks=pytest.mark.slow)], ids=["light", "whole"]
)
def test_two_runs_go_from_their_raw_file_to_a_diagnosis(form):
    if not os.environ.get("RECORDINGS"):
        pytest.skip("RECORDINGS is not set: write RECORDINGS=FOLDER with the measured files")
    book = form(nbformat.read(ROOT / "notebooks" / "esso_osaka_from_file_to_diagnosis.ipynb", as_version=4))
    where = {"metadata": {"path": str(ROOT / "notebooks")}}
    nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources=where).execute()
    said = printed(book)
    late = [float(s) for s in re.findall(r"x, y: written down ([\d.]+)", said)]
    assert 0.85 < late[0] < 1.0 and late[-1] < 0.1
    wind = re.search(r"recorded wind: ([\d.]+) m/s from (\d+) deg", said)
    assert wind and 1.0 < float(wind[1]) < 2.0 and 120 < float(wind[2]) < 150
    assert "verdict: mismatch" in said
    found = re.search(r"\* a gusty wind .*?speed ([\d.]+) ± [\d.]+ m/s.*?from ([\d.]+) ± ", said, re.DOTALL)
    # One turn tells the speed within two errors, the direction within an eighth of the compass to either side.
    assert found and abs(float(found[1]) - float(wind[1])) < 0.6 and abs(float(found[2]) - float(wind[2])) < 45


@pytest.mark.slow
def test_the_wind_that_was_guessed_is_named_as_it_was():
    book = nbformat.read(ROOT / "notebooks" / "hess2000_wind.ipynb", as_version=4)
    where = {"metadata": {"path": str(ROOT / "notebooks")}}
    nbclient.NotebookClient(book, timeout=900, kernel_name="python3", resources=where).execute()
    said = printed(book)
    assert "named: wind_" in said
    for found, error, was in re.findall(r"([\d.]+) \+- ([\d.]+) (?:m/s|deg); it was ([\d.]+)", said):
        assert abs((float(found) - float(was) + 180) % 360 - 180) < 2 * float(error)
