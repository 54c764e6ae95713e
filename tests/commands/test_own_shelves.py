"""An effect, network, fit, ship and manoeuvre of a person's own, two files each: simulated, learnt, found, reported."""

import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import torch
import yaml
from fleet import unchecked
from rich.console import Console
from sailed import table_of, to_starboard, write_runs

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.check import check
from manoeuvre_nn.commands.coefficients import unscored
from manoeuvre_nn.commands.config import read_mapping
from manoeuvre_nn.commands.diagnose import diagnose_all
from manoeuvre_nn.commands.diagnosis_setup import setup, wanted
from manoeuvre_nn.commands.excite import excite
from manoeuvre_nn.commands.export import export
from manoeuvre_nn.commands.groups import compose, options
from manoeuvre_nn.commands.import_recording import import_recording, request
from manoeuvre_nn.commands.job import load_model, prepare
from manoeuvre_nn.commands.simulate import simulate
from manoeuvre_nn.commands.train import train
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read.containers import READERS

RACE = '''
import torch
from manoeuvre_nn.core.effect import Effect, Parameter


class MillRace(Effect):
    """Water that flows north."""

    name, site, family, label = "mill_race", "inflow", "current", "a mill race"
    equations = ("kinematics",)
    fingerprint, source = "The track drifts north.", "made up"
    candidate, acts_indoors, measured_by = True, True, "the flow of the mill race"
    declared = (Parameter("speed", "m/s", -3.0, 3.0, 0.0, 0.5, (0.5, -0.5)),)

    def stream(self, s):
        north = self.value("speed") + 0 * s.u
        return torch.stack([north, 0 * north], -1)
'''
LINE = '''
import torch
from manoeuvre_nn.core.network import Network


class Line(Network):
    """Forces linear in what is seen."""

    def __init__(self, seed: int = 0, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(4, 3, dtype=dtype)

    def forward(self, x):
        return self.layer(x)
'''
AVERAGE = '''
from my_line import Line
from manoeuvre_nn.training.fits import Fit


class AverageFit(Fit):
    """The mean force, whatever the motion: for a network with a layer."""

    made_for = Line

    def __init__(self, dynamics, share: float = 1.0) -> None:
        super().__init__(dynamics, iterations_per_epoch=1)
        self.share = share

    def configure_optimizers(self) -> None: ...

    def training_step(self, batch, batch_idx) -> None:
        x, y = self.scaled(batch[0], batch[1])
        self.dynamics.network.layer.weight.data.zero_()
        self.dynamics.network.layer.bias.data.copy_(self.share * y[0].mean(0))
        self.stopped = "done at once"
        self.finish(batch, (self.rows(x) - y).square().mean())
'''
BARGE = '''
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.ship.mariner import mariner_corrected


def barge() -> Ship:
    """A ship that turns as the Mariner does."""
    return mariner_corrected()
'''
NUDGE = '''
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage


def nudge(order: float = 0.3, duration: float = 200.0) -> Manoeuvre:
    """Rudder over, back, and amidships."""
    stages = Stage(order, hold=60.0), Stage(-order, hold=90.0), Stage(0.0)
    return Manoeuvre(f"nudge{order:g}", "random_rudder", stages, duration=duration)
'''
LOGGER = '''
import numpy as np
import pandas as pd
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read.containers import reads


@reads(".log64")
def logger_frame(path, columns=None):
    """Numbers of 8 bytes, a row a sample."""
    numbers = np.fromfile(path)
    if len(numbers) % 6:
        raise InputError(f"{path.name}: cut off within a sample")
    return pd.DataFrame(numbers.reshape(-1, 6), columns=["t", "yaw", "rate", "surge", "sway", "rudder"])
'''
LOGGED = """
time: {column: t, unit: s}
channels:
  psi: {column: yaw, unit: rad}
  r: {column: rate, unit: rad/s}
  u: {column: surge, unit: m/s}
  v: {column: sway, unit: m/s}
  delta: {column: rudder, unit: rad}
"""
FILES = {
    "my_race.py": RACE,
    "effect/mill_race.yaml": "# @package effect.mill_race\n_target_: my_race.MillRace\nspeed: 0.6\n",
    "my_line.py": LINE, "network/line.yaml": "_target_: my_line.Line\nscaling: centred\ndtype: float64\n",
    "my_average.py": AVERAGE, "fit/average.yaml": "_target_: my_average.AverageFit\nshare: 0.5\n",
    "my_barge.py": BARGE, "ship/barge.yaml": "_target_: my_barge.barge\n",
    "my_logger.py": LOGGER, "recording/logger.yaml": LOGGED,
    "my_nudge.py": NUDGE, "manoeuvre/nudge.yaml": "# @package manoeuvre.nudge\n_target_: my_nudge.nudge\n",
}  # fmt: skip
TWICE = "manoeuvre.again={_target_: my_nudge.nudge, order: -0.2, duration: 240.0}"


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Words that name a folder of a person's own."""
    folder = tmp_path_factory.mktemp("own")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    yield [f"config_dir={folder}", "plugins=[my_race,my_line,my_average,my_barge,my_nudge,my_logger]"]
    READERS.pop(".log64", None)


@pytest.fixture(scope="module")
def sailed(own, tmp_path_factory) -> Path:
    """Recordings of the own ship in the own effect on the own manoeuvre."""
    out = tmp_path_factory.mktemp("sailed")
    words = [*own, "ship=barge", "manoeuvre=nudge", f"+{TWICE}", "effect=[mill_race]", "rate_hz=1"]
    with unchecked():
        runs = simulate(compose("simulate", words), out, Console(quiet=True))
    assert [run.name for run in runs] == ["nudge0.3", "nudge-0.2"]
    assert runs[1]["vn"][0] == pytest.approx(runs[1]["u"][0] + 0.6, abs=0.2)
    return write_runs(out / "read", {run.name: to_starboard(table_of(run, k)) for k, run in enumerate(runs)})


def test_simulations_are_not_written_over_recordings_that_no_simulation_wrote(tmp_path):
    (tmp_path / "zz20.csv").write_text("measured")
    with pytest.raises(InputError, match=r"zz20\.csv is there already, and no simulation wrote it"):
        simulate(compose("simulate", ["ship=mariner", "manoeuvre=zz20"]), tmp_path, Console(quiet=True))
    assert (tmp_path / "zz20.csv").read_text() == "measured"


def test_an_own_ship_manoeuvre_network_and_effect_are_what_a_model_learns_from(own):
    words = [*own, "ship=barge", "manoeuvre=nudge", "network=line", "effect=[mill_race]", "fit=backprop"]
    with unchecked():
        job = prepare(compose("train", [*words, "score=[{zz20: {duration: 60}}]"]))
        job.data.setup()
    assert type(job.network).__name__ == "Line" and [e.name for e in job.data.effects] == ["mill_race"]
    assert [run.name for run in job.data.recordings] == ["nudge0.3"]
    assert job.network(torch.as_tensor(job.data.tuples.inputs)).shape[1] == 3


SHORT = ["data.length=60", "scoring.solver=rollout", "scoring.every=1"]


@pytest.fixture
def on_the_page_alone(monkeypatch) -> None:
    """Figures are drawn on the page and not in files as well, which takes as long again."""
    for command in ("results", "diagnose"):
        monkeypatch.setattr(f"manoeuvre_nn.commands.{command}.save_figures", lambda figures, folder: {})


@pytest.mark.slow
def test_an_own_fit_trains_the_networks_that_its_class_names_by_command_and_from_python(
    own, tmp_path, on_the_page_alone
):
    train_words = [*own, *SHORT, "network=line", "fit=average", "score=[{zz20: {duration: 60}}]"]
    with unchecked():
        train(compose("train", train_words), tmp_path / "run", Console(quiet=True))
        zigzag = mnn.simulate("mariner", {"zz20": {"duration": 60.0}})
        fitted = mnn.fit("mariner", zigzag, "line", [*own, "fit=average", "data.rate_hz=1", *SHORT[1:]])
        trained = load_model(tmp_path / "run/checkpoints/best.ckpt")
    stopped = json.loads((tmp_path / "run/scores.json").read_text())["training"]["stopped"]
    assert stopped == "done at once" and (tmp_path / "run/report.html").exists()
    for network in (trained.network, fitted.model.network):
        assert network.layer.bias.abs().max() > 0 and not network.layer.weight.any()
    assert len(fitted.scores) == 1 and fitted.scores[0].manoeuvre == "zz20"


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (
            ["network=line", "fit=closed_loop"],
            "write fit=average or backprop or bayesian or levenberg_marquardt, or network=abk",
        ),
        (["network=cubic", "fit=average"], "write fit=closed_loop, or network=line"),
    ],
)
def test_the_networks_and_fits_that_go_together_are_said_own_ones_among_them(own, words, advice):
    with unchecked(), pytest.raises(InputError, match=advice):
        prepare(compose("train", [*own, *words]))


def test_an_own_effect_is_a_candidate_where_its_class_says_so(own):
    (folder,) = (word.partition("=")[2] for word in own if word.startswith("config_dir"))
    compose("diagnose", own)
    shelf = {name: yaml.safe_load(path.read_text()) for name, path in options("effect", folder).items()}
    assert "mill_race" in wanted("default", shelf) and "mill_race" in wanted("tank", shelf)


@pytest.mark.slow  # that it is a candidate is tested above
def test_an_own_effect_is_found_in_recordings_and_reported(own, sailed, tmp_path, on_the_page_alone):
    words = [
        "ship=barge",
        f"recordings={sailed}",
        "candidates=[mill_race,heading_bias]",
        "rudder_positive_to=starboard",
    ]
    with unchecked():
        diagnose_all(compose("diagnose", [*own, *words, f"out={tmp_path}"]), tmp_path, Console(quiet=True))
    answer = json.loads((tmp_path / "answer.json").read_text())
    best = answer["effects"][0]
    assert best["name"] == "mill_race" and best["parameters"]["speed"][0] == pytest.approx(0.6, abs=0.1)
    assert "a mill race" in (tmp_path / "report.html").read_text()


@pytest.fixture(scope="module")
def logged(own, tmp_path_factory) -> Path:
    """A zigzag as the own logger writes it."""
    with unchecked():
        (run,) = mnn.simulate("mariner", {"zz20": {"duration": 150.0}})
    place = tmp_path_factory.mktemp("logged") / "zz20.log64"
    np.column_stack([run.time, run.stacked("psi", "r", "u", "v", "delta")]).tofile(place)
    return place


def test_a_file_of_an_own_format_is_checked_with_an_own_mapping_and_found_in_its_folder(own, logged, tmp_path):
    words = [*own, "ship=barge", "data.mapping=logger", f"data.folder={logged.parent}"]
    with unchecked():
        (found,) = check(compose("check", [*words, "figures=false"]), tmp_path, Console(quiet=True))
    assert found.name == "zz20" and found.verdict in {"ok", "note"}
    assert found.recording.derived == {"x", "y"} and np.abs(found.recording["delta"]).max() == pytest.approx(
        0.349, 0.01
    )


def test_a_mapping_is_proposed_for_a_file_of_an_own_format(own, logged, tmp_path):
    asked = request([str(logged), *own, "ship=barge", f"out={tmp_path / 'made.yaml'}"])
    with unchecked():
        made = import_recording(asked, Console(quiet=True)).settings["channels"]
    assert made["psi"] == {"column": "yaw", "unit": "rad"} and made["delta"]["column"] == "rudder"


def test_a_broken_file_of_an_own_format_is_refused_in_its_readers_words(own, logged, tmp_path):
    (tmp_path / "half.log64").write_bytes(logged.read_bytes()[:-16])
    compose("check", own)
    with pytest.raises(InputError, match="half.log64: cut off within a sample"), unchecked():
        mnn.read(tmp_path / "half.log64", read_mapping("logger", own[0].partition("=")[2]))


@pytest.fixture(scope="module")
def learnt(own, tmp_path_factory) -> Path:
    """A run of the own ship on the own manoeuvre."""
    out = tmp_path_factory.mktemp("learnt") / "run"
    words = [*own, *SHORT, "ship=barge", "manoeuvre=nudge", "network=wang", "fit=backprop", "trainer.max_epochs=1"]
    with unchecked(), patch("manoeuvre_nn.commands.results.figures", lambda outcome: {}):
        train(compose("train", [*words, "score=[{nudge: {order: 0.2, duration: 60}}]"]), out, Console(quiet=True))
    return out


@pytest.mark.slow
def test_a_run_with_an_own_ship_and_manoeuvre_is_exported_and_diagnosed_with(own, learnt, sailed, tmp_path):
    with unchecked():
        (made,) = export(compose("export", [*own, f"run={learnt}", "format=python"]), tmp_path, Console(quiet=True))
        model = load_model(learnt / "checkpoints/best.ckpt")
        words = [*own, f"recordings={sailed}", f"model={learnt}/checkpoints/best.ckpt", "candidates=[mill_race]"]
        setup(compose("diagnose", [*words, f"out={tmp_path}"]))
    assert "nudge0.3" in made.content and model.particulars.name == "Mariner"


def test_coefficients_need_no_held_out_file_and_take_an_own_ship_format_and_mapping(own, logged):
    words = [*own, "ship=barge", "data=recording", "data.mapping=logger", f"data.folder={logged.parent}"]
    with unchecked():
        job = prepare(unscored(compose("coefficients", [*words, "data.files=[zz20.log64]", "network=cubic"])))
    assert [run.name for run in job.data.runs] == ["zz20"] and not job.data.unseen
    with pytest.raises(InputError, match="no recording is left"), unchecked():
        prepare(compose("train", [*words, "data.files=[zz20.log64]"]))


def test_an_own_manoeuvre_is_a_candidate_of_what_to_sail_next(own, tmp_path):
    words = [*own, "ship=barge", "manoeuvre=nudge", "network=cubic", "fit=closed_loop", "goal=coefficients"]
    words += ["candidates=[{nudge: {order: 0.1}}]", "score=[nudge]", "trainer.max_epochs=1"]
    with unchecked():
        advice = excite(compose("excite", words), tmp_path, Console(quiet=True))
    assert [one.manoeuvre for one in advice.expected] == ["nudge0.1"]
