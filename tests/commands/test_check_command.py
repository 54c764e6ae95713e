"""``python scripts/check_recordings.py``: what it writes, says and returns."""

import json
import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from fleet import unchecked
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from pages import unexplained
from rich.console import Console

from manoeuvre_nn.commands.check import check
from manoeuvre_nn.commands.groups import register_resolvers
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.report.check_figures import check_chart, check_figure
from manoeuvre_nn.report.interactive import as_data
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner_corrected
from manoeuvre_nn.training.data import recorded_files

ROOT = Path(__file__).parents[2]
CONF = ROOT / "conf"
UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}
NOISE = {"u": 0.05, "v": 0.05, "r": 0.02 * DEGREE, "x": 0.7, "y": 0.7, "psi": 0.1 * DEGREE}


def config(*words):
    register_resolvers()
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("check", ["name=test", *words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A good file, one whose rate is late, and one with the rudder the other way round."""
    place = tmp_path_factory.mktemp("files")
    with unchecked():
        (run,) = roll_out(CalmWater(mariner_corrected()), [zigzag(20.0, duration=240.0)], step=0.5)
    run = run.resampled(np.arange(0.0, 240.1, 1.0))
    for seed, name in enumerate(("good", "late", "turned")):
        table = pd.DataFrame({"t": run.time, **{k: add_noise(run, NOISE, seed)[k] for k in UNITS}})
        if name == "late":
            table["r"] = np.interp(run.time - 1.0, run.time, table["r"])
        table["delta"] *= -1.0 if name == "turned" else 1.0
        table.to_csv(place / f"{name}.csv", index=False, float_format="%.8g")
    said = {
        "time": {"column": "t", "unit": "s"},
        "channels": {k: {"column": k, "unit": u} for k, u in UNITS.items()},
    }
    (place / "columns.yaml").write_text(yaml.safe_dump(said))
    return place


@pytest.fixture(scope="module")
def checked(folder, tmp_path_factory):
    """The folder of results, what was found and what the terminal showed."""
    out = tmp_path_factory.mktemp("out")
    console = Console(record=True, width=140, file=open("/dev/null", "w"))  # noqa: SIM115
    words = (f"data.folder={folder}", f"data.mapping={folder / 'columns.yaml'}", "data.files=[good.csv,late.csv]")
    with unchecked():
        found = check(config(*words), out, console)
    return out, found, console.export_text()


def test_the_folder_holds_a_page_figures_and_findings(checked):
    out, found, _ = checked
    assert {p.name for p in (out / "figures").iterdir()} == {"good.png", "late.png"}
    page = (out / "checks.html").read_text()
    assert page.count('<figure class="chart">') == 2
    page = re.sub("<script>.*?</script>", "", page, flags=re.DOTALL)  # plotly.js
    assert unexplained(page) == set()
    assert re.findall(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", page) == []
    assert "too late: move r back" in page and "1 can be used as it is, 1 should be mended first" in page
    assert [one.name for one in found] == ["good", "late"]
    assert (out / "config.yaml").is_file()


def test_findings_are_told_to_machines(checked):
    told = json.loads((checked[0] / "findings.json").read_text())
    late = told["recordings"]["late"]
    assert late["verdict"] == "mend" and told["recordings"]["good"]["verdict"] in {"ok", "note"}
    assert set(late["changes"]) == {"channels.r.delay"} and late["changes"]["channels.r.delay"] == pytest.approx(
        1, abs=0.2
    )
    (finding,) = [f for f in late["findings"] if f["check"] == "delay of r"]
    assert finding["unit"] == "s" and 0 < finding["error"] < 0.1
    assert any(f["check"] == "excitation" for f in late["findings"]) and told["together"]
    json.dumps(told, allow_nan=False)


def test_the_terminal_says_what_to_write(checked):
    said = checked[2]
    assert "r: written down" in said and "late: channels.r.delay: " in said
    page = (checked[0] / "checks.html").read_text()
    assert "Write into the mapping" in page and "channels.r.delay: " in page
    assert "of 9 linear derivatives can be identified" in said and "checks.html" in said


def test_training_is_told_what_should_be_mended_first(folder):
    ship, said = mariner_corrected(), yaml.safe_load((folder / "columns.yaml").read_text())
    data = recorded_files(ship, clarke_part(ship), ["late.csv"], ["good.csv"], mapping(**said), folder=str(folder))
    (line,) = data.remarks()
    assert line.startswith("late: r: written down") and line.endswith("too late: move r back")


def run_script(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["check_recordings.py", *words])
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    GlobalHydra.instance().clear()
    try:
        with unchecked():
            runpy.run_path(str(ROOT / "scripts" / "check_recordings.py"), run_name="__main__")
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        GlobalHydra.instance().clear()
    return 0


def test_a_refused_file_ends_in_code_2_and_a_report(folder, tmp_path, monkeypatch, capsys):
    words = ["figures=false", f"data.folder={folder}", f"data.mapping={folder / 'columns.yaml'}"]
    code = run_script(monkeypatch, *words, "data.files=[turned.csv]", f"out={tmp_path}")
    assert code == 2
    assert "rudder_positive_to: port" in capsys.readouterr().out
    assert json.loads((tmp_path / "findings.json").read_text())["recordings"]["turned"]["verdict"] == "refuse"


def test_wrong_settings_are_refused_in_one_line(folder, tmp_path):
    mapped = f"data.mapping={folder / 'columns.yaml'}"
    for words, told in (
        ((f"data.folder={folder}",), "is no recording that this package wrote, and mapping is not given"),
        ((f"data.folder={folder / 'none'}", mapped), "is not a folder"),
        ((f"data.folder={folder}", mapped, "data.files=[none.csv]"), "none.csv is not in"),
        ((f"data.folder={tmp_path}", mapped), "holds no recording"),
    ):
        with pytest.raises(InputError, match=told) as refusal:
            check(config(*words), tmp_path / "out", Console(quiet=True))
        assert "\n" not in str(refusal.value)


def test_the_script_lists_its_settings(monkeypatch, capsys):
    assert run_script(monkeypatch, "--help") == 0
    assert "what is wrong with measured files" in capsys.readouterr().out


def test_figures_shade_what_was_found_and_say_what_was_derived(checked):
    one = checked[1][0]
    assert one.recording is not None
    gap = Finding("gaps", "note", "", spans=((50.0, 60.0),))
    derived = replace(one.recording, meta={**one.recording.meta, "derived": ("r",)})
    marked = replace(one, findings=(gap,), recording=derived, flags={"u": np.arange(len(derived)) == 30})
    ship = mariner_corrected().particulars
    chart = check_chart(marked, ship)
    assert chart is not None
    assert sorted(panel.title for panel in chart.panels if panel.title) == ["derived", "nothing to compare: derived"]
    assert all([(span.start, span.end) for span in panel.spans] == [(50.0, 60.0)] for panel in chart.panels)
    from_track = replace(marked, recording=replace(derived, meta={**derived.meta, "derived": ("u", "v")}))
    shown = check_chart(from_track, ship)
    assert shown is not None
    assert [panel.ylabel.partition("\n")[0] for panel in shown.panels[5::2]] == ["x north", "y east"]
    outlier = chart.panels[0].curves[1]
    assert (outlier.x, outlier.y) == (marked.recording.time[30], marked.recording["u"][30])
    figure = check_figure(chart, "marked")
    assert all(len(axes.patches) == 1 for axes in figure.axes)
    assert as_data(chart)["panels"][0]["traces"][1]["mode"] == "markers"
    assert check_chart(replace(one, recording=None), ship) is None


def test_a_ship_that_chooses_a_network_for_training_is_checked_too():
    assert config("ship=esso_190k", "linear=clarke").ship.shaft == "hold"
