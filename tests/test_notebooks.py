"""Notebooks run from their first cell to their last and print what their text says."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib.pyplot as plt
import pytest
from fleet import unchecked

from manoeuvre_nn.diagnosis import forecast, predictive
from scripts.sample_recordings import CONCEALED

ROOT = Path(__file__).parents[1]
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
nbformat = pytest.importorskip("nbformat", reason='notebooks need the extra: pip install -e ".[test]"')

MAX_BYTES = 300_000


def book_of(name: str, lighter: Mapping[str, str] = MappingProxyType({})):
    """A notebook, with less to compute where something lighter stands for a text of its cells."""
    book = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    for long, short in lighter.items():
        holding = [cell for cell in book.cells if cell.cell_type == "code" and long in cell.source]
        assert len(holding) == 1, f"the notebook no longer says {long} in one cell"
        holding[0].source = holding[0].source.replace(long, short)
    return book


def run_here(book) -> dict[str, Any]:
    """What the cells leave behind, run in this process: a kernel of its own would import torch anew."""
    left: dict[str, Any] = {}
    with unchecked():  # a person writes 120 where an annotation says float
        for cell in book.cells:
            if cell.cell_type == "code":
                exec(compile(re.sub(r"^%.*$", "", cell.source, flags=re.MULTILINE), "cell", "exec"), left)
    plt.close("all")
    return left


def printed(book) -> str:
    """What the cells printed, tables included, without colours."""
    outputs = [o for cell in book.cells if cell.cell_type == "code" for o in cell.outputs]
    return COLOUR.sub("", "\n".join(o.get("text") or o.get("data", {}).get("text/plain", "") for o in outputs))


def forms(light: Mapping[str, str]) -> pytest.MarkDecorator:
    """The notebook with less to compute, and, among the slow tests, as it is."""
    return pytest.mark.parametrize("form", [light, pytest.param({}, marks=pytest.mark.slow)], ids=["light", "whole"])


def draw_fewer(light: Mapping[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a notebook with less to compute: a fifth of the free runs that a diagnosis draws for its bands and checks."""
    for module in (forecast, predictive) if light else ():
        monkeypatch.setattr(module, "DRAWS", 20)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_small_defines_nothing_and_shows_what_came_out_when_it_ran_from_first_to_last(path):
    book = nbformat.read(path, as_version=4)
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    assert not any(re.search(r"^\s*(def|class) ", cell.source, re.MULTILINE) for cell in code), "notebooks call"
    assert path.stat().st_size < MAX_BYTES
    counts = [cell.execution_count for cell in code]
    assert counts == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell.outputs]
    assert not any(output.output_type == "error" for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not re.search(r"/tmp/|/home/|/root/|/work/|Warning", printed(book)), "paths and warnings are nobody's"


@pytest.mark.slow
@pytest.mark.recordings
@forms({
    "network.members=2": "network.members=1",
    "trainer.max_epochs=6": "trainer.max_epochs=3",
    "mnn.score(hull, mnn.read(raw, MENDED, SHIP))": "mnn.score(hull, mnn.read(DATA / LEARNT[0], MENDED, SHIP))",
    "mnn.fit(SHIP, learnt": "mnn.fit(SHIP, [run.between(0.0, 150.0) for run in learnt]",
    "mnn.read([fitted_run, raw], HIDDEN, SHIP)": (
        "[run.between(0.0, 300.0) for run in mnn.read([fitted_run, raw], HIDDEN, SHIP)]"
    ),
    '"wind_gusty", "current", "side_force", "rudder_offset", "heading_bias"]': '"wind_gusty"]',
})
def test_two_runs_go_from_their_raw_file_to_a_diagnosis(form, capsys, monkeypatch):
    if not os.environ.get("RECORDINGS"):
        pytest.skip("RECORDINGS is not set: write RECORDINGS=FOLDER with the measured files")
    draw_fewer(form, monkeypatch)
    left = run_here(book_of("esso_osaka_from_file_to_diagnosis", form))
    late = [float(s) for s in re.findall(r"x, y: written down ([\d.]+)", capsys.readouterr().out)]
    assert 0.85 < late[0] < 1.0 and late[-1] < 0.1
    assert 1.0 < left["recorded_speed"] < 2.0 and 120 < left["recorded_from"] < 150
    ((name, found),) = left["answer"].effects.items()
    # One turn tells the speed within two errors, the direction within an eighth of the compass to either side.
    assert name == "wind_gusty" and abs(found["speed"] - left["recorded_speed"]) < 0.6
    assert abs(found["from_deg"] - left["recorded_from"]) < 45


@pytest.mark.slow
def test_the_wind_that_was_guessed_is_named_as_it_was(capsys, monkeypatch):
    monkeypatch.chdir(ROOT / "notebooks")
    run_here(book_of("hess2000_wind"))
    said = capsys.readouterr().out
    assert "named: wind_" in said
    for found, error, was in re.findall(r"([\d.]+) \+- ([\d.]+) (?:m/s|deg); it was ([\d.]+)", said):
        assert abs((float(found) - float(was) + 180) % 360 - 180) < 2 * float(error)


@pytest.mark.slow
@forms({
    "network.members=8": "network.members=2",
    '"zz20", "tc25", "tc35_port"]': '{"zz20": {"duration": 200.0}}, {"tc25": {"duration": 200.0}}]',
})
def test_the_series_predicts_the_mariner_closer_than_networks_where_the_record_is_noisy(form):
    table = run_here(book_of("identify_mariner", form))["table"]
    assert (table["series"] < 0.5).all() and (table["networks"] > table["series"]).all()


@pytest.mark.slow
@forms({
    "STARTS, EPOCHS = 4, 200": "STARTS, EPOCHS = 1, 20",
    "(5, 20, 50, EPOCHS)": "(5, 20)",
    '["zz20", "zz10", "tc25"]': '[{"zz20": {"duration": 600.0}}, {"zz10": {"duration": 600.0}}]',
})
def test_a_smaller_training_error_of_the_tanker_is_no_better_ship_outside_her_zigzag(form):
    left = run_here(book_of("tanker_levenberg_marquardt", form))
    losses, found = left["losses"], left["found"]
    assert losses["nielsen", 0][-1] < 1e-3 < 1e-2 < losses["adam", 0][-1]
    assert found["training error"].is_monotonic_decreasing and found["dev/L zz20"].iloc[-1] < 0.05
    assert (found["dev/L zz10"] > 1).all()


@pytest.mark.slow
@forms({
    "network.members=8": "network.members=2",  # a whole zigzag: nothing shorter teaches networks the tanker
    "\nmodel.scores": "",
    'learnt + mnn.simulate("esso_190k", ["tc35"])': (
        '[learnt[0].between(0.0, 500.0), *mnn.simulate("esso_190k", [{"tc35": {"duration": 600.0}}])]'
    ),
    "mnn.score(second, beyond)": "mnn.score(second, [run.between(0.0, 200.0) for run in beyond])",
    '["zz5", "zz10", "zz20", "tc10", "tc20", "tc35"]': str([
        {n: {"duration": s}} for n, s in (("zz5", 1100.0), ("zz10", 700.0), ("tc35", 300.0))
    ]),
})
def test_what_lies_inside_the_box_of_the_data_may_still_be_missed_and_the_spread_or_the_status_tells(form):
    left = run_here(book_of("outside_its_data", form))
    table, status = left["table"], {one.manoeuvre: one.status for one in left["scores"]}
    assert table["dev/L"]["zz10"] < 0.1 and table["samples inside the data"]["zz5"] == 1.0
    assert table["dev/L"]["zz5"] > 0.5 and table["spread of the members, L"]["zz5"] > 0.5
    assert all(told.startswith("left") for name, told in status.items() if name in {"zz20", "tc20", "tc35"})
    assert all(one.status == "ok" for one in left["after"])


@pytest.mark.slow  # what is simulated is diagnosed in test_front_door.py
@forms({
    'mnn.read("sample")': '[run for run in mnn.read("sample") if run.name not in {"zz10", "zz20"}]',
    'held_out=["zz20", "tc25"]': 'held_out=["tc25"]',
    'candidates="default"': 'candidates=["wind_steady"]',
})
def test_the_disturbance_of_the_sample_is_named_as_it_was_made(form, monkeypatch):
    draw_fewer(form, monkeypatch)
    left = run_here(book_of("sample_diagnosis", form))
    (name, made), found = *CONCEALED.items(), left["answer"].effects
    assert set(found) == {name} and min(one.dev_L for one in left["calm"]) > 0.1
    assert abs(found[name]["speed"] - made["speed"]) < 1.0 and abs(found[name]["from_deg"] - made["from_deg"]) < 1.5


@pytest.mark.slow
@forms({'"strip_theory"': '"closed_form"'})
def test_a_good_test_on_the_grid_says_nothing_of_the_pitch_between(form):
    published, informed = run_here(book_of("pitch_s175", form))["errors"].values()
    assert published["testing"] < 1.5 * published["learning"] and published["between"] > 5 * published["testing"]
    assert informed["between"] < 0.2 * published["between"]
