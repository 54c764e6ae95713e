import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
import yaml
from fleet import unchecked
from matplotlib.figure import Figure
from pages import unexplained
from tiers import mainly

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.main import task_of
from manoeuvre_nn.commands.response import hull_form, load_response
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.seakeeping.form import S175

TINY = (
    "task=pitch", "data.method=closed_form", "data.between=10", "inputs.d.values=[7,9]", "inputs.V.values=[0,10]",
    "inputs.beta.values=[0,60,120,180]", "inputs.Hs.values=[2,4]", "inputs.T.values=[8,10,12]", "network.hidden=3",
    "trainer.max_epochs=4", "scoring.every=2",
)  # fmt: skip


@pytest.fixture
def fast(monkeypatch):
    """Leaves figures out, as in the other commands' tests."""
    monkeypatch.setattr("manoeuvre_nn.commands.response_results.response_figures", lambda data, response: {})
    for drawn in ("sensitivity_figure", "learning_figure"):
        monkeypatch.setattr(f"manoeuvre_nn.commands.response_results.{drawn}", lambda _: Figure((1, 1)))


def scores(folder) -> dict:
    return json.loads((folder / "scores.json").read_text())


@pytest.fixture(scope="module")
def learnt(tmp_path_factory, typed_train) -> tuple[Path, str]:
    """The folder of a whole run, whose figures are drawn in files and not on the page as well; what it printed."""
    out, said = tmp_path_factory.mktemp("pitch") / "out", StringIO()
    on_the_page = patch("manoeuvre_nn.report.html.data_address", lambda figure: "data:,")
    with unchecked(), redirect_stdout(said), on_the_page:
        assert typed_train([*TINY, f"out={out}"]) == 0
    return out, said.getvalue()


def test_pitch_is_approximated_tested_and_reported(cli, learnt):
    out, said = learnt
    found = scores(out)
    assert "significant pitch amplitude" in said and "96 records of the S-175 by closed form" in said
    assert set(found["errors"]) == {"learning", "testing", "between"} and found["unit"] == "deg"
    assert found["error"] == found["errors"]["testing"]["rms"] > 0
    verdict, page = found["verdict"], (out / "report.html").read_text()
    assert verdict["word"] == "do not use" and 'class="verdict poor">Do not use: the network' in page
    assert verdict["sentence"] in " ".join(said.split()) and "a linear function is closer" in verdict["sentence"]
    assert unexplained((out / "report.html").read_text()) == set() and len(list((out / "figures").glob("*.png"))) == 5
    assert list(pd.read_csv(out / "records.csv").columns) == [
        "d [m]", "V [kn]", "beta [deg]", "Hs [m]", "T [s]", "pitch [deg]",
    ]  # fmt: skip
    again = cli(*TINY, f"out={out}")
    assert "holds this run already" in again.out and scores(out) == found


def test_the_model_of_a_checkpoint_is_the_model_that_was_tested(learnt):
    out, _ = learnt
    response = load_response(out / "checkpoints" / "last.ckpt")
    table = pd.read_csv(out / "records.csv")
    sizes = [v.size for v in response.inputs]
    found = response.at(table.to_numpy()[:, :5] * sizes) / response.output.size
    off = float(np.sqrt(np.mean((found - table["pitch [deg]"]) ** 2)))
    errors = scores(out)["errors"]
    assert off == pytest.approx(np.sqrt((errors["learning"]["rms"] ** 2 + errors["testing"]["rms"] ** 2) / 2), rel=1e-6)
    assert [round(v.high / v.size, 6) for v in response.inputs] == [9, 10, 180, 4, 12]
    module: dict = {}
    exec(mnn.export(out), module)
    written = [module["pitch_deg"](*row) for row in table.to_numpy()[:, :5].tolist()]
    np.testing.assert_allclose(written, found, rtol=1e-9, atol=1e-12)
    assert "50% of the records computed for the S-175 by closed form (grid)" in module["__doc__"]


def test_a_table_of_ones_own_is_learnt_with_a_mapping(cli, learnt, tmp_path, fast):
    out, _ = learnt
    table = pd.read_csv(out / "records.csv")
    mine = pd.DataFrame({
        "draught": table["d [m]"], "speed": table["V [kn]"] * 1852 / 3600, "off the bow": 180 - table["beta [deg]"],
        "h": table["Hs [m]"], "t": table["T [s]"], "rms": table["pitch [deg]"] / 2,
    })  # fmt: skip
    mine.to_csv(tmp_path / "mine.csv", index=False)
    columns = {
        "d": {"column": "draught", "unit": "m"}, "V": {"column": "speed", "unit": "m/s"},
        "beta": {"column": "off the bow", "unit": "deg"}, "Hs": {"column": "h", "unit": "m"},
        "T": {"column": "t", "unit": "s"}, "pitch": {"column": "rms", "unit": "deg", "factor": 2},
    }  # fmt: skip
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"heading_zero": "head", "columns": columns}))
    own = ("data=recording", "data.files=[mine.csv]", "data.mapping=mine.yaml", "out=own")
    ended = cli(*[word for word in TINY if not word.startswith(("data.", "inputs."))], *own)
    assert ended.code == 0, ended.err
    first, second = scores(out)["errors"], scores(tmp_path / "own")["errors"]
    assert second["testing"]["rms"] == pytest.approx(first["testing"]["rms"], rel=1e-4)
    assert "they cannot tell" in ended.out and "between" not in second


@pytest.mark.parametrize(
    "words, said",
    mainly(
        9,
        [
            (("network=wang",), "inputs of a ship's forces: write network= one of grnn, mlp, rbf"),
            (("data=simulated",), "learns records: write data=seakeeping or data=recording"),
            (("manoeuvre=zz20",), "there is no setting manoeuvre"),
            (("output.name=7",), "output: '7' names no variable: expected a word of letters"),
            (("learning=1e-9",), "learning=1e-09 and .* leave 1 to learn from: expected 2 or more"),
            (("ship=mariner", "inputs.d.values=[5,11]"), "the hull of the Mariner goes from 2.4 to 10.6 m"),
            (("+form.masts=3",), "form 'masts' is unknown"),
            (("inputs.V.possible=5",), "expected the smallest and the largest value"),
            (("data=recording", "data.files=[a.csv]"), "a.csv is not in"),
            (("sees.T=maybe",), "sees.T=maybe: expected true or false"),
            (("per=V2",), "per 'V2' is unknown"),
            (("network=rbf", "network.hidden=90000"), "network.hidden=90000: expected from 1 to "),
            (("learning=2",), "expected a share more than 0, to 1"),
            (("form.gyradius=long",), "expected a number"),
            (("inputs.d.unit=fathom",), "unit 'fathom' is unknown"),
            (("inputs.d.values=[a]",), "expected numbers in brackets"),
            (("inputs.V.possible=[null]",), "expected the smallest and the largest value"),
            (("network.scaling=centred",), "'centred' is unknown"),
            (("scoring.every=0",), "expected a whole number, 1 or more"),
            (("data=recording",), "data.files=\\[\\] names no table"),
            (("data=recording", "data.files=[a.csv]", "data.rate_hz=2"), "data.rate_hz=2 is for recordings over time"),
        ],
    ),
)
def test_what_cannot_be_used_is_refused_in_one_line(cli, words, said):
    small = [word for word in TINY if not (words[0].startswith("data=") and word.startswith("data."))]
    ended = cli(*small, *words)
    assert ended.code == 2
    assert len(ended.err.strip().splitlines()) == 1
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(ended.err)


def test_a_task_has_a_config_of_its_own():
    words = ["ship=mariner", "task=pitch", "-m", "hydra/launcher=basic"]
    kept = ["ship=mariner", "-m", "hydra/launcher=basic", "hydra/job_logging=disabled", "hydra/hydra_logging=disabled"]
    assert task_of(words, "train") == (kept, "task/pitch")
    assert task_of(["ship=mariner"], "train") == (["ship=mariner"], "train")
    with pytest.raises(InputError, match="task 'heave' is unknown; choose one of: pitch"):
        task_of(["task=heave"], "train")


@pytest.mark.slow
def test_a_sweep_sets_the_errors_of_its_jobs_side_by_side(cli, tmp_path, fast):
    ended = cli("-m", *TINY, "network.hidden=2,3", "out=sweep", "hydra/launcher=basic")
    assert ended.code == 0, ended.err
    table = pd.read_csv(tmp_path / "sweep" / "sweep.csv")
    assert set(table["network.hidden"]) == {2, 3} and (table["RMS testing [deg]"] > 0).all()
    assert (tmp_path / "sweep" / "sweep.png").is_file()


@pytest.mark.slow
def test_a_genetic_search_finds_a_structure_by_the_records_kept_for_validation(cli, tmp_path, fast):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    words = ("experiment=structure", "hydra.sweeper.n_trials=2", "out=search", "hydra/launcher=basic")
    ended = cli("-m", *TINY[:-3], "trainer.max_epochs=2", *words)
    assert ended.code == 0, ended.err
    best = yaml.safe_load((tmp_path / "search" / "optimization_results.yaml").read_text())
    table = pd.read_csv(tmp_path / "search" / "sweep.csv")
    assert best["best_value"] == pytest.approx(table["RMS validation [deg]"].min())
    assert len(table) == 2


def test_the_network_of_the_paper_sees_five_variables_as_they_are(cli, tmp_path, fast):
    ended = cli(*TINY, "experiment=cepowski2007", "out=out")
    assert ended.code == 0, ended.err
    response = load_response(tmp_path / "out" / "checkpoints" / "last.ckpt")
    assert (response.quantities.sees, response.quantities.per) == (["d", "V", "beta", "Hs", "T"], None)
    assert response.network.input_weights.shape == (1, 3, 6) and response.network.activation == "sigmoid"


def test_backpropagation_trains_the_same_network(cli, tmp_path, fast):
    words = [word for word in TINY if not word.startswith("trainer")]
    ended = cli(*words, "fit=backprop", "trainer.max_epochs=2", "fit.iterations_per_epoch=50", "out=out")
    assert ended.code == 0, ended.err
    assert scores(tmp_path / "out")["training"]["epochs"] == 2


def test_a_task_of_ones_own_builds_on_that_of_the_package(cli, tmp_path, fast):
    (tmp_path / "mine" / "task").mkdir(parents=True)
    (tmp_path / "mine" / "task" / "roll.yaml").write_text("""# @package _global_
defaults: [pitch, _self_]
task: roll
inputs: {GM: {unit: m, possible: [0, 5], meaning: metacentric height}}
sees: {GM: true, cos_beta: true}
output: {name: roll, unit: deg, possible: [0, 60], symbol: 'phi', meaning: significant roll amplitude}
per: none
""")
    draw = np.random.default_rng(0).uniform
    table = pd.DataFrame({
        "d [m]": draw(7, 9, 60), "V [kn]": draw(0, 20, 60), "beta [deg]": draw(0, 180, 60), "Hs [m]": draw(2, 5, 60),
        "T [s]": draw(8, 12, 60), "GM [m]": draw(0.5, 2, 60),
    })  # fmt: skip
    table["roll [deg]"] = 2 * table["Hs [m]"] * table["GM [m]"]
    table.to_csv(tmp_path / "rolls.csv", index=False)
    words = ("task=roll", "config_dir=mine", "data=recording", "data.files=[rolls.csv]", "network.hidden=2",
             "trainer.max_epochs=4", "scoring.every=2")  # fmt: skip
    ended = cli(*words, "out=out")
    assert ended.code == 0, ended.err
    assert "significant roll amplitude" in ended.out and scores(tmp_path / "out")["errors"]["testing"]["rms"] > 0
    computed = cli("task=roll", "config_dir=mine")
    assert computed.code == 2 and "pitch is computed from d, V, beta, Hs, T" in computed.err


def test_the_s_175_of_the_shelf_is_that_of_the_seakeeping():
    cfg = compose("task/pitch")
    assert hull_form(cfg, build(cfg.ship, "ship").particulars) == S175
