"""Runs are put into one table wherever they lie, by what differs in their configs."""

import csv
import json
import os
import re
from itertools import product
from pathlib import Path

import pytest
import yaml
from pages import unexplained

from manoeuvre_nn.commands.compare import compare, request, settings_of
from manoeuvre_nn.commands.main import OF_FILES, _of_files
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.terminal import Terminal

USUAL = {
    "network": {"_target_": "manoeuvre_nn.network.perceptron.wang_network", "hidden": 7, "activation": "tanh"},
    "ship": {"_target_": "manoeuvre_nn.ship.mariner.mariner"},
    "manoeuvre": {"speed_kn": None, "zz35": {"_target_": "manoeuvre_nn.manoeuvre.zigzag.zigzag", "rudder_deg": 35}},
    "trainer": {"max_epochs": 60, "progress": True},
    "name": "mariner_zz35",
}


def run(folder: Path, dev: dict[str, float] | None, typed=(), **config) -> Path:
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra/overrides.yaml").write_text(yaml.safe_dump(list(typed)))
    (folder / "config.yaml").write_text(
        yaml.safe_dump({"format": 1, **USUAL, **config, "versions": {"torch": folder.name}})
    )
    if dev is not None:
        scores = {name: {"dev_L": value, "status": "ok"} for name, value in dev.items()}
        mean = sum(dev.values()) / len(dev)
        found = {"scores": scores, "mean_dev_L": mean, "seed": 0, "verdict": {"word": "usable"}}
        (folder / "scores.json").write_text(json.dumps(found))
    return folder


def series(hidden: int) -> dict:
    return {"network": {**USUAL["network"], "hidden": hidden}}


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """``asked(*folders)`` compares them; rows, what is printed at 80 columns, and the rows of the file."""
    monkeypatch.chdir(tmp_path)

    def ask(*words: str, width: int = 80):
        console = Terminal(width=width, record=True, quiet=False, file=(tmp_path / "printed").open("w"))
        rows = compare(request([*words, "out=table"]), console)
        assert f"{len(rows)} run{'s' * (len(rows) != 1)} compared" in Path("table/compare.html").read_text()
        with Path("table/runs.csv").open() as file:
            return rows, console.export_text(), list(csv.DictReader(file))

    return ask


def test_runs_of_several_folders_stand_in_one_table_the_best_first_with_what_differs_alone(tmp_path, asked):
    run(tmp_path / "monday/a", {"zz20": 0.3, "tc25": 0.5}, **series(7))
    run(tmp_path / "tuesday/sweep/hidden=11", {"zz20": 0.1, "tc25": 0.2}, **series(11))
    rows, printed, file = asked("monday", "tuesday/sweep")
    assert [row["job"] for row in rows] == ["tuesday/sweep/hidden=11", "monday/a"] == [row["job"] for row in file]
    assert list(file[0])[:7] == ["job", "network.hidden", "status", "verdict", "mean dev/L", "dev/L zz20", "dev/L tc25"]
    assert [row["network.hidden"] for row in file] == ["11", "7"]
    log = Path("table/run.log").read_text()
    assert "begun: manoeuvre compare monday tuesday/sweep out=table" in log and "monday/a" in log and "done" in log
    heading = next(line for line in printed.splitlines() if "hidden" in line)
    assert heading.split() == ["run", "verdict", "mean", "dev/L", "zz20", "tc25", "hidden"]


def test_a_setting_that_comes_with_another_network_is_no_difference_unless_somebody_wrote_it(tmp_path, asked):
    other = {"_target_": "manoeuvre_nn.network.hull_rudder.HullRudder", "hidden": 16, "activation": "sine"}
    run(tmp_path / "a", {"zz20": 0.3}, typed=["network.hidden=7"])
    run(tmp_path / "b", {"zz20": 0.1}, network=other)
    rows, _, _ = asked("a", "b")
    assert [(row["network"], row["network.hidden"]) for row in rows] == [("HullRudder", 16), ("wang_network", 7)]
    assert "network.activation" not in rows[0]


def test_a_setting_that_is_not_given_is_null_as_in_the_config(tmp_path, asked):
    run(tmp_path / "a", {"zz20": 0.3}, data={"length": None})
    run(tmp_path / "b", {"zz20": 0.1}, data={"length": 120})
    rows, printed, _ = asked("a", "b")
    assert [row["data.length"] for row in rows] == [120, "null"] and "None" not in printed


def test_what_a_refused_command_left_is_passed_over(tmp_path, asked):
    run(tmp_path / "good", {"zz20": 0.3})
    (tmp_path / "refused/.hydra").mkdir(parents=True)
    (tmp_path / "refused/.hydra/overrides.yaml").write_text("[trainer.max_epochs=0]")
    rows, printed, _ = asked("good", "refused")
    assert [row["job"] for row in rows] == ["good"] and "refused: passed over" in printed


def test_a_run_that_failed_or_was_stopped_stands_last_and_says_so(tmp_path, asked):
    run(tmp_path / "all/good", {"zz20": 0.3})
    run(tmp_path / "all/stopped", None)
    failed = run(tmp_path / "all/failed", None)
    (failed / "error.txt").write_text("network.hidden=0: expected 1\n")
    (failed / "config.yaml").unlink()
    rows, printed, _ = asked("all")
    assert [row["job"] for row in rows] == ["good", "failed", "stopped"]
    assert "failed: network.hidden=0: expected 1" in " ".join(printed.split()) and "unfinished" in printed


def test_means_over_different_manoeuvres_are_not_compared_without_a_word(tmp_path, asked):
    run(tmp_path / "all/a", {"zz20": 0.3})
    run(tmp_path / "all/b", {"zz20": 0.3, "tc25": 4.0})
    assert "not scored on the same manoeuvres" in " ".join(asked("all")[1].split())


def test_a_table_of_many_manoeuvres_still_fits_eighty_columns(tmp_path, asked):
    for k in range(3):
        run(
            tmp_path / f"all/{k}",
            {f"{kind}{angle}": 0.1 * k + angle for kind in ("zz", "tc") for angle in range(10, 35, 5)},
        )
    _, printed, file = asked("all")
    assert max(map(len, printed.splitlines())) <= 80 and "worst" in printed
    assert sum(name.startswith("dev/L ") for name in file[0]) == 10


def test_settings_that_have_no_room_are_named_and_no_word_is_broken(tmp_path, asked):
    many = {f"setting_{k}": "a_long_name" for k in range(8)}
    run(tmp_path / "own/model", {"tc25": 2.3, "zz10": 3.6}, fit=many)
    run(tmp_path / "own/model2", {"tc25": 0.2, "zz10": 1.7}, fit={name: f"another_{k}" for k, name in enumerate(many)})
    run(tmp_path / "own/lost", {"tc25": float("nan")})
    rows, printed, file = asked("own/model2", "own/model", "own/lost")
    heading, _, best, *_ = (line.split() for line in printed.splitlines()[2:])
    assert heading == ["run", "verdict", "mean", "dev/L", "tc25", "zz10", "setting_0", "setting_1", "setting_2"]
    assert best == ["model2", "usable", "0.95", "0.2", "1.7", "another_0", "another_1", "another_2"]
    said = " ".join(printed.split())
    assert "differ: setting_3, setting_4," in said and "setting_7; they are in runs.csv" in said
    assert "tc25 nan" not in printed and file[0]["fit.setting_7"] == "another_7"
    page = Path("table/compare.html").read_text()
    places = [page.index(f">{name}<") for name in ("run", "verdict", "mean dev/L", "worst", "dev/L tc25", "setting_0")]
    assert places == sorted(places) and unexplained(page) == set()


def sweep(folder: Path, **config) -> Path:
    """Four runs of a sweep over two settings, which chose the members too."""
    folder.mkdir(parents=True)
    (folder / "multirun.yaml").touch()
    for hidden, length in product((8, 12), (120, 240)):
        name, said = f"hidden={hidden},length={length}", [f"network.hidden={hidden}", f"data.length={length}"]
        run(
            folder / name, {"zz20": 1 / length, "tc35": 2 / hidden, "tc25_port": 0.1}, ["network.members=2", *said],
            network={**USUAL["network"], "hidden": hidden, "members": 2}, data={"length": length}, **config,
        )  # fmt: skip
    return folder


def another(folder: Path, **config) -> Path:
    """A run that differs in what somebody wrote, and in what nobody did."""
    network = {**USUAL["network"], "hidden": 12, "members": 16, "activation": "sine", "library": "quadratic"}
    dev = {"zz20": 0.2, "tc35": 0.3, "tc25_port": 0.1}
    return run(folder, dev, ["ship=kvlcc2"], network=network, data={"length": None}, **config)


OUTCOME = {"run", "verdict", "mean", "dev/L", "worst", "zz20", "tc35", "tc25_port"}
KVLCC2 = {"_target_": "manoeuvre_nn.ship.kvlcc2.kvlcc2"}


@pytest.mark.parametrize("width", [80, 100, 129])
def test_settings_that_were_swept_or_written_always_have_room_and_stand_before_those_that_nobody_wrote(
    tmp_path, asked, width
):
    sweep(tmp_path / "swp")
    another(tmp_path / "other", ship=KVLCC2)
    _, printed, file = asked("swp", "other", width=width)
    lines = printed.splitlines()
    rule = next(k for k, line in enumerate(lines) if "──" in line)
    heading = [word for word in lines[rule - 1].split() if word not in OUTCOME]
    assert heading[:4] == ["length", "hidden", "ship", "members"] and max(map(len, lines[: rule + 1])) <= width
    settings = [name.rpartition(".")[2] for name in file[0]]
    assert settings[1:5] == heading[:4] and set(settings[5 : settings.index("status")]) == {"activation"}
    named = [part for line in lines[rule + 1 :] for part in line.split()[:1] if "=" in part]
    assert named and all(re.fullmatch(r"(swp/)?(hidden=\d+,)?(length=\d+)?", part) for part in named)


def test_no_table_of_the_page_is_wider_than_ten_columns_and_names_break_at_their_signs_alone(tmp_path, asked):
    sweep(tmp_path / "swp")
    another(tmp_path / "other", ship=KVLCC2)
    many = {f"zz{angle}": 0.1 for angle in range(5, 20)}
    for name, shift in (("many", 0), ("more", 1)):
        values = {f"setting_{k}": k + shift for k in range(20)}
        run(tmp_path / name, many, [f"fit.{key}={value}" for key, value in values.items()], fit=values)
    asked("swp", "other", "many", "more")
    page = Path("table/compare.html").read_text()
    tables = re.findall(r"<thead>.*?</thead>", page, re.DOTALL)
    assert len(tables) == 3 and all(table.count("<th ") <= 10 for table in tables) and unexplained(page) == set()
    assert "swp/<wbr>hidden=<wbr>12,<wbr>length=<wbr>240" in page
    assert re.search(r"in runs.csv alone: .*dev/L zz19.*setting_19", page)
    assert 'data-heading="verdict"' in page and "what the model may be used for" in page


def test_a_best_run_is_named_only_among_runs_of_one_ship_and_the_same_manoeuvres(tmp_path, asked):
    run(tmp_path / "one/a", {"zz20": 0.3})
    run(tmp_path / "one/b", {"zz20": 0.1}, **series(9))
    run(tmp_path / "one/stopped", None, ship=KVLCC2)
    run(tmp_path / "ship", {"zz20": 0.2}, ship=KVLCC2)
    run(tmp_path / "scored", {"zz20": 0.2, "tc25": 0.1})
    for folders, best, why in (
        (["one"], True, ""), (["one", "ship"], False, "are of different ships"), (["one", "scored"], False, "same man"),
    ):  # fmt: skip
        _, printed, _ = asked(*folders)
        page = Path("table/compare.html").read_text()
        assert ("the best is b" in page) == best and ("no best is named" in page) == (not best)
        assert why in page and why in " ".join(printed.split())


def test_a_ship_has_its_own_name_and_recordings_no_manoeuvre(tmp_path, asked):
    ship = {"_target_": "manoeuvre_nn.ship.own.own_particulars", "name": "Wave Dancer", "length": 100.0}
    measured = {"ship": ship, "data": {"_target_": "manoeuvre_nn.training.data.recorded_files", "folder": "trial"}}
    run(tmp_path / "a", {"zz20": 0.1}, **measured)
    run(tmp_path / "b", {"zz20": 0.3}, data={"_target_": "manoeuvre_nn.training.data.SimulatedData"})
    rows, *_ = asked("a", "b")
    assert [row["ship"] for row in rows] == ["Wave Dancer", "mariner"] and "ship.name" not in rows[0]
    assert [settings_of(tmp_path / name).get("manoeuvre") for name in "ab"] == [None, "zz35"]


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        ([], "no folder is given"),
        (["nothing"], "nothing is neither a folder"),
        (["width=3"], "width=3 is neither"),
        (["."], "no run of"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path, asked, words, advice):
    with pytest.raises(InputError, match=advice):
        asked(*words)


def test_a_folder_without_a_run_is_told_and_passed_over(tmp_path, asked):
    run(tmp_path / "monday/a", {"zz20": 0.3, "tc25": 0.5}, **series(7))
    (tmp_path / "diagnosed").mkdir()
    rows, printed, _ = asked("monday", "diagnosed")
    assert len(rows) == 1 and "no run of manoeuvre train is in diagnosed: passed over" in printed
    assert "1 run compared" in Path("table/compare.html").read_text()


def test_odd_results_and_names_of_folders_are_shown_as_text(tmp_path, asked):
    odd = run(tmp_path / "a", {"zz20": 0.3}) / "scores.json"
    odd.write_text(json.dumps({**json.loads(odd.read_text()), "seed": [1, 2], "verdict": {"word": {"x": 1}}}))
    run(Path(os.fsdecode(bytes(tmp_path) + b"/r\xff")), {"zz20": 0.1})
    rows, _, file = asked("a", os.fsdecode(b"r\xff"))
    assert [row["job"] for row in rows] == [row["job"] for row in file] == [r"r\udcff", "a"]
    assert rows[1]["seed"] == "[1, 2]" and rows[1]["verdict"] == "{'x': 1}"


@pytest.mark.parametrize("columns", ["80", None])
def test_what_is_printed_into_a_file_is_as_wide_as_columns_says(tmp_path, monkeypatch, capsys, columns):
    monkeypatch.chdir(tmp_path)
    for k in range(3):
        run(tmp_path / f"{k}", {f"manoeuvre{a}": 0.1 * k for a in range(7)}, seed=k)
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    _of_files(OF_FILES["compare"], ["0", "1", "2", "out=table"])
    table = [line for line in capsys.readouterr().out.splitlines() if not line.startswith(("table:", "note:"))]
    assert (max(map(len, table)) <= 80) == bool(columns)


def test_a_result_that_is_larger_than_any_number_is_a_damaged_file(tmp_path, asked):
    odd = run(tmp_path / "a", {"zz20": 0.3}) / "scores.json"
    odd.write_text(json.dumps({**json.loads(odd.read_text()), "mean_dev_L": 2**1024 - 1}))
    run(tmp_path / "b", {"zz20": 0.1})
    rows, _, _ = asked("a", "b")
    assert [row["status"] for row in rows] == ["finished", "failed: scores.json is damaged"]
