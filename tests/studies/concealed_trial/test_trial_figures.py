"""Figures of a trial show what its scoreboard says."""

import numpy as np
import pytest

from studies.concealed_trial.figures import FIGURES, blocks, confusion, power, reliability, write_figures
from studies.concealed_trial.summaries import calibration


def row(truth, first, strongest="weak"):
    right = None if not truth else first in truth
    base = {"truth": truth, "first": first, "strongest": strongest if truth else None, "answered": True}
    return base | {"detected": first != "none" if truth else None, "first_right": right}


ROWS = [row([], "none"), row([], "current"), row(["current"], "current"), row(["current"], "none", "strong")]
ROWS += [row(["unknown"], "unknown", "strong"), row(["current", "rate_bias"], "current")]


def test_the_confusion_matrix_counts_clean_and_single_cases():
    axes = confusion(ROWS, "tool").axes[0]
    names = [label.get_text() for label in axes.get_xticklabels()]
    assert names == ["none", "current", "unknown"]
    counts = {(text.get_position()): text.get_text() for text in axes.texts}
    assert counts == {(0, 0): "1", (1, 0): "1", (0, 1): "1", (1, 1): "1", (2, 2): "1"}


def test_power_is_the_share_of_each_strength():
    figure = power({"tool": ROWS, "ideal": ROWS})
    detected = figure.axes[0]
    points = [np.atleast_1d(line.get_ydata()) for line in detected.lines]
    assert {1.0, 0.5} <= {float(y[0]) for y in points if len(y) == 1}
    assert [label.get_text() for label in detected.get_xticklabels()] == [
        "weak\n0.15–0.5 L\n2 cases",
        "strong\n1.4–2.5 L\n2 cases",
    ]


def test_a_tool_is_named_once_and_a_trial_without_a_cause_has_no_legend():
    late = [row([], "none"), {**row(["current"], "none"), "detected": None, "first_right": None}]
    late += [row(["current"], "current", "strong")]
    figure = power({"tool": [*late, row(["current"], "none", "extreme")]})
    assert [text.get_text() for text in figure.axes[1].get_legend().get_texts()] == ["tool"]
    assert power({"tool": [row([], "none")]}).axes[1].get_legend() is None


def test_the_reliability_diagram_has_a_panel_for_each_tool():
    bins = calibration([(0.2, 0), (0.2, 1), (0.9, 1)])
    figure = reliability({"one": bins, "other": []})
    assert [axes.get_title() for axes in figure.axes] == ["one", "other"]
    assert [text.get_text() for text in figure.axes[0].texts] == ["2", "1"]


def test_counts_of_neighbouring_bins_do_not_meet():
    axes = reliability({"tool": calibration([(0.59, 0), (0.61, 1)])}).axes[0]
    assert [text.get_position()[0] for text in axes.texts] == pytest.approx([0.55, 0.65])


def test_the_scoreboard_is_shown_as_tables(tmp_path):
    board = "# Concealed trial\n\nShares & more.\n\n| score | a |\n| --- | --- |\n| cases | 4 |\n| no | - |\n"
    board += "\n## tool\n\n- c1: <x>\n"
    assert list(blocks(board)) == [
        ("text", "Shares & more."), ("table", [{"score": "cases", "a": "4"}, {"score": "no", "a": "-"}]),
        ("heading", "tool"), ("list", ["c1: <x>"]),
    ]  # fmt: skip
    (tmp_path / "scoreboard.md").write_text(board)
    write_figures({"tool": {"board": {"calibration": [], "totals": {"cases": 4}}, "cases": ROWS}}, tmp_path)
    page = "".join((tmp_path / "trial.html").read_text().partition("<h2>Scores</h2>")[2].split())
    for part in (
        "<p>Shares&amp;more.</p>",
        "<h3>tool</h3>",
        "<li>c1:&lt;x&gt;</li>",
        '>cases</td><tdclass="text">4</td>',
    ):
        assert part in page


def test_all_figures_and_a_page_that_stands_alone_are_written(tmp_path):
    totals = {"cases": 4, "first name": {"right": 2, "count": 3}, "false alarms": None}
    board = {"calibration": calibration([(0.9, 1)]), "totals": totals}
    write_figures({"tool": {"board": board, "cases": ROWS}}, tmp_path)
    page = (tmp_path / "trial.html").read_text()
    assert '<p class="verdict">tool, 4 cases: first name 2 of 3.</p>' in page
    assert '<meta name="viewport"' in page and "Scores" not in page
    for name in FIGURES:
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert page.count('<img src="data:image/svg+xml') == len(FIGURES)
