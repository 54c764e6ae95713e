"""``manoeuvre train network=recursive``: from a config to scores, and what is refused."""

import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from fleet import unchecked

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.job import load_model
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.recursive import RecursiveShip

TINY = (
    "network=recursive", "network.hidden=[6]",
    "fit.stages=[{steps: 3, updates: 4, rows: 6}, {steps: null, updates: 2}]",
    "fit.iterations_per_epoch=2", "scoring.every=1", "trainer.max_epochs=9",
)  # fmt: skip
CIRCLES = (
    "ship=container_twin", "manoeuvre=circles", "manoeuvre.circles.turn_deg=20", "manoeuvre.circles.approach=10",
    "manoeuvre.circles.rudder_deg=[35]", "manoeuvre.circles.speed_kn=[18]", "score=[{tc25: {duration: 60}}]",
)  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory, typed_train) -> Path:
    """The folder of a whole run, whose figures are drawn in files and not on the page as well."""
    folder = tmp_path_factory.mktemp("recursive") / "run"
    with unchecked(), patch("manoeuvre_nn.report.html.data_address", lambda figure: "data:,"):
        assert typed_train([*TINY, *CIRCLES, f"out={folder}"]) == 0
    return folder


def test_a_training_leaves_scores_predictions_figures_report_and_dashboard(out):
    found = json.loads((out / "scores.json").read_text())
    assert found["training"]["stopped"] == "all stages done" and found["training"]["epochs"] == 3
    assert set(found["training"]["relrmse"]) == {"u", "v", "r"}
    assert set(found["trained_on"]) == {"circle35_18kn", "circle35_port_18kn"}
    assert np.isfinite(found["mean_dev_L"]) and found["baselines"]["linear"]
    assert "training and held-out runs together" in found["chosen"]
    drawn = {p.name for p in (out / "figures").iterdir()}
    assert {"tc25_track.png", "training_learning.png"} <= drawn and "training_forces.png" not in drawn
    assert (out / "report.html").stat().st_size > 10_000 and list((out / "tensorboard").iterdir())
    assert "phi [rad]" in (out / "predictions" / "tc25.csv").read_text().splitlines()[0]


def test_its_checkpoint_is_a_model_that_scores_recordings(out):
    model = load_model(out / "checkpoints" / "best.ckpt")
    assert isinstance(model, RecursiveShip)
    runs = mnn.simulate("container_twin", {"tc25": {"duration": 60.0}})
    told = json.loads((out / "scores.json").read_text())["scores"]["tc25"]["dev_L"]
    assert mnn.score(str(out / "checkpoints" / "best.ckpt"), runs)[0].dev_L == pytest.approx(told, rel=0.05)


@pytest.mark.slow
def test_it_is_fitted_from_python(tmp_path):
    runs = mnn.simulate("container_twin", [{"tc25": {"duration": 60.0}}, {"tc35_port": {"duration": 60.0}}])
    model = mnn.fit("container_twin", runs[:1], "recursive", [*TINY[1:4]])
    assert isinstance(model.model, RecursiveShip) and len(mnn.score(model, runs[1:])) == 1


@pytest.mark.parametrize(
    "words, told",
    [
        (("ship=mariner", "manoeuvre=zz20"), "network.freedom=3"),
        (("ship=container_twin", "network.freedom=5"), "freedom"),
        (("ship=container_twin", "network.hidden=54"), "hidden"),
        (("ship=container_twin", "fit.stages=[]"), "fit.stages"),
        (("ship=container_twin", "fit.stages=[{steps: 3}]"), "updates"),
        (("ship=container_twin", "fit.choose_by=luck"), "choose_by"),
        (("ship=container_twin", "fit=backprop"), "does not train"),
        (("ship=container_twin", "network.forces.wake=1.2"), "wake"),
        (("ship=container_twin", "network.forces.thrust=[1]"), "thrust"),
    ],
)
def test_wrong_input_ends_in_one_line(words, told, attempt, tmp_path):
    usual = [word for word in TINY if not word.startswith("fit.") or "fit=backprop" not in words]
    ended = attempt(tmp_path, *usual, "data.length=60", "score=[{tc25: {duration: 60}}]", *words)
    assert ended.code == 2 and told in ended.err and len(ended.err.strip().splitlines()) == 1


def test_what_needs_a_rate_of_the_state_refuses_it_in_one_line(out):
    runs = mnn.simulate("container_twin", {"tc25": {"duration": 60.0}})
    with pytest.raises(InputError, match="a diagnosis needs a model"):
        mnn.diagnose("container_twin", runs, model=str(out / "checkpoints" / "best.ckpt"))
