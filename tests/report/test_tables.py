import csv
import io
import math
from dataclasses import replace

import pandas as pd
import pytest
from rich.console import Console

from manoeuvre_nn.report.tables import (
    columns,
    criteria_rows,
    criterion_label,
    is_good,
    main_criteria_rows,
    rich_table,
    score_rows,
    score_table,
    text,
    to_markdown,
    write_csv,
)
from manoeuvre_nn.scoring.score import Score

NRMSE = {"u": 0.0123456, "v": 0.1, "r": 123.456, "psi": math.nan}
ZIGZAG = Score(
    "zz20",
    "ok",
    0.123456,
    NRMSE,
    {"reversals": 4.0, "overshoot_1_deg": 10.61, "overshoot_2_deg": 9.2, "overshoot_10_deg": 9.0, "period_s": 177.0},
    {"reversals": 4.0, "overshoot_1_deg": 10.29, "overshoot_2_deg": 8.75, "overshoot_10_deg": 8.0, "period_s": 181.0},
)
LOST = Score(
    "tc35_port_shallow",
    "left the physical range at 1234 s",
    12.5,
    NRMSE,
    {},
    {"advance_L": 3.6, "tactical_diameter_L": 4.76},
)
SPIRAL = Score("spiral20", "ok", 2.0, NRMSE, {"loop_height_deg_s": 0.289}, {"loop_height_deg_s": 0.286})


def printed(table, width: int = 100) -> str:
    console = Console(width=width, file=io.StringIO(), color_system=None)
    console.print(table)
    return console.file.getvalue()


def test_the_score_table_fits_80_columns_without_cutting_anything():
    shown = printed(score_table([ZIGZAG, LOST, SPIRAL]), 80)
    assert max(map(len, shown.splitlines())) <= 80
    for line in ("overshoot 1: 10.6 (10.3) deg", "period: 177 (181) s", "tactical diameter: – (4.76) L", "0.123"):
        assert line in shown
    assert "…" not in shown.replace("tc35_port_sha…", "")


def test_the_score_table_keeps_its_names_on_a_narrow_terminal():
    for width in (60, 80):
        shown = printed(score_table([ZIGZAG, SPIRAL]), width)
        assert "zz20" in shown
        assert "spiral20" in shown
        assert "0.123" in shown


def test_a_number_of_a_markdown_table_has_four_digits_or_as_many_as_are_asked_for():
    assert "| 1.235 |" in to_markdown([{"a": 1.23456}]) and "| 1.2 |" in to_markdown([{"a": 1.23456}], 2)


@pytest.mark.parametrize("score, word", [
    (ZIGZAG, "ok"), (replace(ZIGZAG, dev_L=0.5), "ok"), (replace(ZIGZAG, dev_L=0.51), "far off"), (LOST, LOST.status)
])  # fmt: skip
def test_a_run_that_goes_on_to_its_end_far_from_the_recorded_one_is_not_ok(score, word):
    (row,) = score_rows([score])
    assert row["status"] == word and is_good(word) is (word == "ok")
    assert f" {word.split()[0]}" in printed(score_table([score]), 120)


def test_main_criteria_of_a_manoeuvre_stand_in_a_line_and_there_is_no_table_of_none():
    shown = printed(score_table([ZIGZAG]), 80)
    assert " zz20 overshoot 1: 10.6 (10.3) deg, overshoot 2: 9.2 (8.75) deg, " in " ".join(shown.split())
    bare = replace(ZIGZAG, criteria={}, reference={})
    assert "predicted (recorded)" in shown and "predicted (recorded)" not in printed(score_table([bare]))


def test_the_tenth_overshoot_is_not_taken_for_the_first():
    (row,) = main_criteria_rows([ZIGZAG])
    assert row["criteria, predicted (recorded)"].split(", ") == [
        "overshoot 1: 10.6 (10.3) deg",
        "overshoot 2: 9.2 (8.75) deg",
        "period: 177 (181) s",
    ]


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("overshoot_1_deg", "overshoot 1", "deg"),
        ("loop_height_deg_s", "loop height", "deg/s"),
        ("steady_u_m_s", "steady u", "m/s"),
        ("tactical_diameter_L", "tactical diameter", "L"),
        ("speed_loss", "speed loss", ""),
    ],
)
def test_a_criterion_is_named_in_words_with_its_unit(name, words, unit):
    assert criterion_label(name) == (words, unit)


def test_every_criterion_is_listed_even_where_one_side_lacks_it():
    rows = criteria_rows([ZIGZAG, LOST])
    assert len(rows) == 7
    first = next(row for row in rows if row["criterion"] == "overshoot 1")
    assert first["error"] == pytest.approx(0.32)
    assert rows[-1] == {
        "manoeuvre": "tc35_port_shallow", "criterion": "tactical diameter", "unit": "L",
        "predicted": None, "recorded": 4.76, "error": None,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "–"),
        (math.nan, "–"),
        (True, "yes"),
        (0.1234567, "0.1235"),
        (1234567.0, "1.235e+06"),
        (12345, "12345"),
        ("a", "a"),
    ],
)
def test_cells_read_well(value, shown):
    assert text(value) == shown


def test_rows_need_not_have_the_same_columns():
    rows = [{"a": 1}, {"b": 2.0, "a": None}]
    assert columns(rows) == ["a", "b"]
    assert to_markdown(rows) == "| a | b |\n| ---: | ---: |\n| 1 | – |\n| – | 2 |\n"


def test_bars_and_line_breaks_do_not_break_a_markdown_table():
    lines = to_markdown([{"a": "x|y\nz"}]).splitlines()
    assert lines == ["| a |", "| --- |", "| x\\|y<br>z |"]


def test_no_rows_are_no_markdown():
    assert not to_markdown([])


def test_a_csv_file_keeps_its_digits(tmp_path):
    path = write_csv(tmp_path / "new" / "scores.csv", [{"a": 1 / 3, "b": "x,y"}, {"b": "z"}])
    with path.open() as file:
        first, second = csv.DictReader(file)
    assert float(first["a"]) == pytest.approx(1 / 3, abs=1e-10)
    assert (first["b"], second["b"]) == ("x,y", "z")
    assert pd.read_csv(path)["a"].isna().tolist() == [False, True]


def test_brackets_in_a_cell_are_shown_and_not_obeyed():
    shown = printed(rich_table([{"[red]heading": "hidden=[7, 11] \\[red]x[/]"}], title="[bold]title in many words"))
    for words in ("hidden=[7, 11] \\[red]x[/]", "[red]heading", "[bold]title in many words"):
        assert words in shown


def test_verdicts_are_shown_as_they_are():
    row = {"criterion": "tc35 advance_L", "value": 3.43, "limit": 4.5, "verdict": "met"}
    shown = printed(rich_table([row, row | {"verdict": "not met"}]))
    assert "tc35 advance_L" in shown
    assert "not met" in shown and "verdict" in shown


@pytest.mark.parametrize(
    ("cell", "good"),
    [("ok", True), ("met", True), ("not met", False), ("left the physical range at 3 s", False), ("zz20", None)],
)
def test_good_and_bad_words_are_told_apart(cell, good):
    assert is_good(cell) is good
