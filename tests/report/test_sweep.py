import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from pages import unexplained
from rich.console import Console

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.report.sweep import heat_map, sweep_figure, sweep_rows, swept, write_sweep

LOST = "left the physical range at 10 s"


def job(
    folder: Path, name: str, overrides: list[str], devs: dict[str, float] | None, seed: int = 0, lost: str = ""
) -> Path:
    path = folder / name
    (path / ".hydra").mkdir(parents=True)
    (path / ".hydra" / "overrides.yaml").write_text("".join(f"- {line}\n" for line in overrides))
    if devs is not None:
        scores = {k: {"dev_L": v, "nrmse": {}, "status": LOST if k == lost else "ok"} for k, v in devs.items()}
        training = {"relrmse": {"g1": 0.1}, "epochs": 5, "stopped": "max_epochs", "seconds": 1.5}
        found: dict[str, Any] = {"scores": scores, "training": training, "seed": seed}
        found["mean_dev_L"] = sum(devs.values()) / len(devs)
        (path / "scores.json").write_text(json.dumps(found))
    return path


@pytest.fixture
def sweep(tmp_path) -> Path:
    for k, hidden in enumerate((7, 7, 11, 11)):
        devs = {"zz20": 0.1 * (k + 1), "tc25": 1.0 / (k + 1)}
        job(
            tmp_path,
            str(k + 7),
            ["ship=mariner", f"network.hidden={hidden}"],
            devs,
            seed=k,
            lost="tc25" if k == 0 else "",
        )
    return tmp_path


def curves(figure, panel: int = 0):
    return [line.get_xydata().tolist() for line in figure.axes[panel].get_lines() if line.get_linestyle() == "-"]


def printed(table) -> str:
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(table)
    return console.file.getvalue()


def test_a_row_holds_overrides_scores_and_training(sweep):
    assert sweep_rows(sweep)[0] == {
        "job": "7", "ship": "mariner", "network.hidden": 7, "status": "finished", "ended early": "tc25",
        "mean dev/L": 0.55, "dev/L zz20": 0.1, "dev/L tc25": 1.0, "relRMSE g1": 0.1, "seed": 0, "epochs": 5,
        "stopped": "max_epochs", "seconds": 1.5,
    }  # fmt: skip


def test_job_10_comes_after_job_9(sweep):
    assert [row["job"] for row in sweep_rows(sweep)] == ["7", "8", "9", "10"]


def test_a_failed_job_says_why_in_one_line(sweep):
    path = job(sweep, "11", ["network.hidden=15"], None)
    (path / "error.txt").write_text("network.hidden=15: [no] memory\nTraceback\n")
    row = sweep_rows(sweep)[-1]
    assert row["status"] == "failed: network.hidden=15: [no] memory"
    assert row["network.hidden"] == 15
    assert "[no] memory" in printed(write_sweep(sweep))


def test_a_job_that_has_not_finished_says_so(sweep):
    job(sweep, "11", ["network.hidden=15"], None)
    assert sweep_rows(sweep)[-1]["status"] == "unfinished"


@pytest.mark.parametrize("damage", ['{"scores": ', "[1, 2]", "", "\x00"])
def test_damaged_scores_are_a_failure_of_that_job_alone(sweep, damage):
    (sweep / "7" / "scores.json").write_text(damage)
    rows = sweep_rows(sweep)
    assert rows[0]["status"] == "failed: scores.json is damaged"
    assert [row["status"] for row in rows[1:]] == ["finished"] * 3


@pytest.mark.parametrize("content", [{"scores": None}, {"scores": {"zz20": 3}, "training": [1]}, {"mean_dev_L": 1.0}])
def test_scores_with_parts_missing_give_what_they_have(sweep, content):
    (sweep / "7" / "scores.json").write_text(json.dumps(content))
    assert sweep_rows(sweep)[0]["status"] == "finished"
    write_sweep(sweep)


@pytest.mark.parametrize("damage", ["", "- [", "just text", "- 3\n- ~a", "a: 1"])
def test_damaged_overrides_do_no_harm(sweep, damage):
    (sweep / "7" / ".hydra" / "overrides.yaml").write_text(damage)
    row = sweep_rows(sweep)[0]
    assert row["mean dev/L"] == 0.55
    assert set(row) < set(sweep_rows(sweep)[1]) | {"ended early"}


def test_what_was_swept_is_what_differs_and_repeats_come_last(sweep):
    assert swept(sweep_rows(sweep)) == ["network.hidden", "seed"]


def test_a_curve_goes_through_the_median_of_the_repeats(sweep):
    zz20, tc25 = curves(sweep_figure(sweep_rows(sweep)))
    assert zz20 == [[7, pytest.approx(0.15)], [11, pytest.approx(0.35)]]
    assert tc25 == [[7, pytest.approx(0.75)], [11, pytest.approx((1 / 3 + 1 / 4) / 2)]]


def test_a_prediction_that_ended_early_is_a_cross(sweep):
    axes = sweep_figure(sweep_rows(sweep)).axes[0]
    assert [line.get_xydata().tolist() for line in axes.get_lines() if line.get_marker() == "x"] == [[[7, 1.0]]]


def test_two_settings_give_a_panel_a_manoeuvre_and_a_curve_a_combination(tmp_path):
    for k, (hidden, length) in enumerate([(7, 1000), (11, 1000), (15, 1000), (7, 1500), (11, 1500), (15, 1500)]):
        job(tmp_path, str(k), [f"network.hidden={hidden}", f"data.length={length}"], {"zz20": 1.0 + k, "tc25": 0.1})
    figure = sweep_figure(sweep_rows(tmp_path))
    assert [axes.get_title("left") for axes in figure.axes] == ["zz20", "tc25"]
    assert curves(figure) == [[[7, 1], [11, 2], [15, 3]], [[7, 4], [11, 5], [15, 6]]]
    assert [entry.get_text() for entry in figure.legends[0].get_texts()] == ["length 1000", "length 1500"]


def test_settings_that_are_words_are_not_joined_by_a_line(tmp_path):
    for k, fit in enumerate(("adam", "lbfgs")):
        job(tmp_path, str(k), [f"fit={fit}"], {"zz20": 1.0 + k})
    figure = sweep_figure(sweep_rows(tmp_path))
    assert not curves(figure)
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["adam", "lbfgs"]


def test_settings_over_decades_stand_on_a_logarithmic_axis(tmp_path):
    for k, rate in enumerate(("1e-4", "1e-2")):
        job(tmp_path, str(k), [f"fit.rate={rate}"], {"zz20": 1.0})
    assert sweep_figure(sweep_rows(tmp_path)).axes[0].get_xscale() == "log"


def test_the_files_are_written_and_the_best_job_stands_first(sweep):
    shown = printed(write_sweep(sweep))
    with (sweep / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["job"] for row in rows] == ["7", "8", "9", "10"]
    best = min(rows, key=lambda row: float(row["mean dev/L"]))["network.hidden"]
    assert (sweep / "sweep.md").read_text().splitlines()[2].startswith(f"| {best} |")
    lines = shown.splitlines()
    rule = next(k for k, line in enumerate(lines) if "──" in line)
    assert lines[rule + 1].split()[0] == best
    assert (sweep / "sweep.png").read_bytes().startswith(b"\x89PNG")
    assert "1 ended early" in shown


def test_the_verdict_on_each_model_stands_beside_its_errors(sweep):
    path = sweep / "9" / "scores.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "verdict": {"word": "doubtful"}}))
    assert [row.get("verdict") for row in sweep_rows(sweep)] == [None, None, "doubtful", None]
    assert "doubtful" in printed(write_sweep(sweep)) and "verdict" not in swept(sweep_rows(sweep))


def test_a_sweep_in_which_every_job_failed_still_gives_a_table(tmp_path):
    (job(tmp_path, "0", ["a.b=1"], None) / "error.txt").write_text("")
    assert "failed: no message" in printed(write_sweep(tmp_path))
    assert not (tmp_path / "sweep.png").exists()


def test_two_settings_with_the_same_last_word_keep_their_full_names(tmp_path):
    for k in range(2):
        job(tmp_path, str(k), [f"a.size={k}", f"b.size={k + 5}"], {"zz20": 1.0})
    assert "a.size" in printed(write_sweep(tmp_path))


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no runs"):
        sweep_rows(tmp_path)


def test_the_map_of_two_settings_has_a_cell_each_pair_with_the_median_of_its_repeats(tmp_path):
    for k, (hidden, epochs, seed) in enumerate([(3, 5, 0), (3, 5, 1), (3, 9, 0), (7, 5, 0), (7, 9, 0)]):
        job(tmp_path, str(k), [f"network.hidden={hidden}", f"trainer.max_epochs={epochs}"], {"zz20": k + 1.0}, seed)
    axes, bar = heat_map(sweep_rows(tmp_path)).axes
    cells = {(text.get_position(), text.get_text()) for text in axes.texts}
    assert cells == {((0.5, 0.5), "1.5"), ((0.5, 1.5), "3"), ((1.5, 0.5), "4"), ((1.5, 1.5), "5")}
    assert {axes.get_xlabel(), axes.get_ylabel()} == {"network.hidden", "trainer.max_epochs"}
    assert bar.get_ylabel() == "mean dev/L [-]"
    write_sweep(tmp_path)
    assert (tmp_path / "sweep_map.png").is_file()
    page = (tmp_path / "sweep.html").read_text()
    (best,) = re.findall("Best of 5 jobs: (.*?)<", page)
    assert best == "hidden 3, max_epochs 5, seed 0, mean dev/L 1, worst zz20 1.", "not how it ran"
    assert page.count("<figure") == 2 and unexplained(page) == set()


def test_one_setting_alone_has_no_map(sweep):
    assert heat_map(sweep_rows(sweep)) is None


def test_a_sweep_over_ships_names_no_best(tmp_path):
    for k, ship in enumerate(("mariner", "kvlcc2")):
        job(tmp_path, str(k), [f"ship={ship}"], {"zz20": 0.1 + k})
    write_sweep(tmp_path)
    page = (tmp_path / "sweep.html").read_text()
    assert "2 jobs; no best is named: the runs are of different ships." in page and unexplained(page) == set()
