import json
import re
from html import unescape

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from conftest import TINY, TINY_ENSEMBLE
from pages import unexplained
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from manoeuvre_nn.commands.provenance import hyperparameters
from manoeuvre_nn.report.interactive import scripts
from manoeuvre_nn.training.checkpoint import read_checkpoint

CHANNELS = {"t [s]", "u [m/s]", "v [m/s]", "r [rad/s]", "x [m]", "y [m]", "psi [rad]", "delta [rad]"}


def scores(out) -> dict:
    return json.loads((out / "scores.json").read_text())


def numbers(out) -> dict:
    """What a run found, and not how long it took."""
    found = scores(out)
    del found["training"]["seconds"]
    return found


def test_scores_have_the_agreed_form(done):
    found = scores(done)
    parts = {"verdict", "scores", "mean_dev_L", "baselines", "trained_on", "training", "seed", "chosen", "versions"}
    assert set(found) == parts
    assert set(found["baselines"]) == {"linear", "taylor", "true terms"}
    assert found["baselines"]["true terms"]["zz20"] < found["baselines"]["linear"]["zz20"]
    for group, name in (("scores", "zz20"), ("trained_on", "zz35")):
        judged = found[group][name]
        assert set(judged) == {"dev_L", "nrmse", "status", "criteria", "reference"}
        assert set(judged["nrmse"]) == {"u", "v", "r", "psi"}
        assert judged["dev_L"] > 0 and all(np.isfinite(list(judged["nrmse"].values())))
    assert found["mean_dev_L"] == found["scores"]["zz20"]["dev_L"]
    assert set(found["training"]["relrmse"]) == {"g1", "g2", "g3"}
    assert (found["training"]["epochs"], found["training"]["samples"], found["seed"]) == (4, 61, 0)
    assert found["training"]["stopped"] == "all epochs done"


def test_the_page_says_with_the_scores_what_the_model_may_be_used_for(done):
    verdict, page = scores(done)["verdict"], (done / "report.html").read_text()
    assert verdict["word"] == "usable" and verdict["sentence"].startswith(
        "Usable for manoeuvres like zz20, rudder to 20"
    )
    assert verdict["sentence"] in page and 'class="verdict fine"' in page


@pytest.mark.slow
def test_a_useless_model_is_told_as_such_everywhere_and_its_criteria_are_not_judged(fast, cli, tmp_path):
    trained = ("data.length=41", "network.hidden=2", "score=[{zz10: {duration: 250}}]")
    ended = cli("manoeuvre=zz35", *TINY, *trained, f"out={tmp_path / 'out'}")
    assert ended.code == 0, ended
    verdict, page = scores(tmp_path / "out")["verdict"], (tmp_path / "out" / "report.html").read_text()
    assert verdict["word"] == "do not use" and set(verdict["missed"]) == {"zz10"}
    assert "met" not in ended.out.split() and 'class="verdict poor"' in page and 'class="good">met' not in page
    banner = unescape(page.partition('class="verdict poor">')[2].partition("</p>")[0])
    assert verdict["sentence"].startswith("Do not use: zz10") and banner.startswith(verdict["sentence"])
    assert verdict["sentence"] in " ".join(ended.out.split())


def test_scores_are_strict_json(done):
    def refuse(constant):
        raise AssertionError(f"{constant} is no json")

    json.loads((done / "scores.json").read_text(), parse_constant=refuse)


def test_the_prediction_can_be_read_back_and_has_the_score_that_is_told(done):
    table = pd.read_csv(done / "predictions" / "zz20.csv")
    assert set(table.columns) >= CHANNELS
    assert table.notna().all().all() and (np.diff(table["t [s]"]) > 0).all()
    assert table["u [m/s]"][0] == pytest.approx(15 * 1852 / 3600, rel=0.02)
    assert table["delta [rad]"].abs().max() == pytest.approx(np.radians(20), rel=1e-6)
    past = scores(done)["scores"]["zz20"]["criteria"].get("overshoot_1_deg")
    assert past is None or np.degrees(table["psi [rad]"].max()) >= 20 + 0.9 * past


def test_the_report_stands_alone(done):
    page = (done / "report.html").read_text().replace(scripts()[0], "")
    fetched = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]+)""", page) + re.findall(r"url\(([^)]+)\)", page)
    assert fetched and all(address.startswith(("data:", "#")) for address in fetched)
    assert "<script src" not in page and "@import" not in page
    assert "zz20" in page and "max_epochs: 4" in page and unexplained(page) == set()


def test_figures_and_checkpoints_are_there(done):
    assert {p.name for p in (done / "checkpoints").iterdir()} == {"best.ckpt", "last.ckpt"}
    drawn = {p.name for p in (done / "figures").iterdir()}
    assert {"zz20_track.png", "zz20_time_series.png", "training_forces.png", "training_learning.png"} <= drawn
    assert read_checkpoint(done / "checkpoints" / "last.ckpt")["epoch"] == 3
    (done / "config.yaml").read_text().index("hidden: 3")


def test_the_dashboard_can_be_read_back(done):
    events = EventAccumulator(str(done / "tensorboard"), size_guidance={"images": 0, "scalars": 0}).Reload()
    tags = events.Tags()
    assert {"3 training/mse", "1 held-out/dev_L", "4 zz20/nrmse_psi", "3 training/relrmse_g2"} <= set(tags["scalars"])
    errors = events.Scalars("3 training/mse")
    assert [e.step for e in errors] == sorted({e.step for e in errors}) and len(errors) == 4
    assert {"2 tracks/zz20", "5 figures/training forces"} <= set(tags["images"])
    final = events.Scalars("1 held-out/dev_L zz20")[-1].value
    assert final == pytest.approx(scores(done)["scores"]["zz20"]["dev_L"], rel=1e-5)
    summaries = {data.plugin_data.plugin_name for data in events.summary_metadata.values()}
    assert "hparams" in summaries and "custom_scalars" in summaries
    assert min(tags["scalars"]) == "1 held-out/dev_L" and not any("epoch" in tag for tag in tags["scalars"])


def test_the_table_of_settings_tells_choices_and_what_was_typed(done):
    told = hyperparameters(yaml.safe_load((done / "config.yaml").read_text()), done)
    assert {"ship": "mariner", "seed": 0, "network.hidden": 3, "data.length": 60}.items() <= told.items()
    assert {"network", "fit", "data"} <= set(told)
    assert not {"trainer.progress", "fit.damping.mu", "network.dtype", "format", "name", "versions.numpy"} & set(told)


def test_the_same_command_in_the_same_folder_has_nothing_to_do(done, cli):
    before = (done / "scores.json").stat().st_mtime_ns
    ended = cli(*TINY, f"out={done}")
    assert ended.code == 0 and "holds this run already: nothing to do" in ended.out
    assert (done / "scores.json").stat().st_mtime_ns == before


def test_other_settings_in_the_same_folder_are_refused(done, cli):
    before = numbers(done)
    ended = cli(*TINY, f"out={done}", "network.hidden=4")
    assert ended.code == 2 and len(ended.err.splitlines()) == 1
    assert "network.hidden=3, this one has network.hidden=4" in ended.err
    assert numbers(done) == before


@pytest.mark.slow
def test_the_same_command_in_another_folder_gives_the_same_numbers(done, cli, fast, tmp_path):
    torch.manual_seed(12345)
    np.random.seed(12345)  # noqa: NPY002  whatever depends on the global random state would differ now
    assert cli(*TINY, f"out={tmp_path}/again").code == 0
    assert numbers(tmp_path / "again") == numbers(done)
    assert cli(*TINY, "seed=1", f"out={tmp_path}/other").code == 0
    assert numbers(tmp_path / "other")["mean_dev_L"] != numbers(done)["mean_dev_L"]


def test_more_epochs_in_the_same_folder_go_on_where_the_run_ended(done, cli, fast, tmp_path):
    few = [*TINY, f"out={tmp_path}/run", "trainer.max_epochs=2"]
    assert cli(*few).code == 0
    ended = cli(*TINY, f"out={tmp_path}/run")
    assert ended.code == 0 and "after epoch 2" in ended.out
    assert numbers(tmp_path / "run") == numbers(done)


@pytest.mark.slow
def test_backpropagation_on_a_tanker_runs_too(cli, fast, tmp_path):
    ended = cli("ship=great_lakes_bulker", "network=wang", "fit=backprop", "fit.iterations_per_epoch=5",
                "fit.batch_size=8", "trainer.max_epochs=2", "data.length=100", "data.validation=.2",
                "network.dtype=float32", "scoring.solver=rollout", "score=[{zz20: {duration: 100}}]",
                f"out={tmp_path}/run")  # fmt: skip
    assert ended.code == 0
    assert np.isfinite(scores(tmp_path / "run")["mean_dev_L"])


@pytest.mark.slow
def test_a_run_in_wind_and_current_says_so_and_is_judged_in_them_too(cli, fast, tmp_path, done):
    ended = cli(*TINY, "effect=[wind_steady,current]", "effect.wind_steady.speed=12")
    assert ended.code == 0, ended.err
    told = " ".join(ended.out.split())
    assert "with a steady wind (speed=12 m/s, from_deg=90) and a current (speed=0.5 m/s, toward_deg=90)" in told
    (out,) = tmp_path.glob("outputs/*/*")
    assert out.name.endswith("_mariner_zz35_wind_steady_current")
    settings = yaml.safe_load((out / "config.yaml").read_text())["effect"]
    assert (settings["wind_steady"]["speed"], settings["current"]["toward_deg"]) == (12, 90.0)
    assert "a steady wind (speed=12 m/s" in (out / "report.html").read_text()
    assert scores(out)["scores"]["zz20"]["dev_L"] > scores(done)["scores"]["zz20"]["dev_L"], "the model is not told"


def test_an_empty_command_shows_what_it_would_use(cli):
    ended = cli("--cfg", "job")
    assert ended.code == 0 and "max_epochs:" in ended.out and "manoeuvre_nn.ship.mariner.mariner" in ended.out


@pytest.mark.slow  # a fit that goes on is in tests/training/test_ensembles.py, a spread in tests/scoring
def test_the_default_ensemble_is_scored_with_its_spread_and_goes_on_after_a_kill(cli, fast, tmp_path):
    words = [*TINY_ENSEMBLE, f"out={tmp_path}/run"]
    assert cli(*words, "trainer.max_epochs=1").code == 0
    assert "spread_L" not in scores(tmp_path / "run")["scores"]["zz20"]  # one member has nobody to disagree with
    ended = cli(*words)
    assert ended.code == 0 and "after epoch 1" in ended.out and "spread" in ended.out
    found = numbers(tmp_path / "run")
    assert found["scores"]["zz20"]["spread_L"] > 0
    assert found["training"]["stopped"] == "all members trained"
    assert cli(*TINY_ENSEMBLE, f"out={tmp_path}/at_once").code == 0
    assert numbers(tmp_path / "at_once") == found


@pytest.mark.slow  # noise ends members early in tests/training/test_ensembles.py
def test_noisy_accelerations_get_no_more_steps_than_predict(cli, fast, tmp_path):
    noisy = [
        *TINY_ENSEMBLE,
        "data.noise.r_deg_s=.02",
        "data.noise.v=.02",
        "fit.epochs=20",
        "score=[{zz20: {duration: 20}}]",
    ]
    assert cli(*noisy, f"out={tmp_path}/run").code == 0
    stored = torch.load(tmp_path / "run" / "checkpoints" / "last.ckpt", weights_only=True)["state_dict"]
    assert 0 <= int(stored["steps"]) < 20


@pytest.mark.slow
def test_the_ships_own_terms_may_be_known_before_the_network(cli, fast, tmp_path):
    assert cli(*TINY_ENSEMBLE, "linear=own", f"out={tmp_path}/run").code == 0
    assert scores(tmp_path / "run")["scores"]["zz20"]["dev_L"] < 1e-4


@pytest.mark.parametrize(
    "words, advice",
    [
        (
            ["network=wang", "fit=ensemble"],
            "write fit=backprop or bayesian or levenberg_marquardt, or network=hull_rudder or hull",
        ),
        (["network=cubic", "fit=backprop"], "write fit=closed_loop, or network=mlp or rajesh or wang"),
        (["fit=backprop"], "write fit=ensemble, or network=mlp or rajesh or wang"),
        (["network.scaling=standard"], "mirrored"),
        (["network.members=0"], "at least 2 nodes, 1 member"),
        (["fit.refine.steps=-1"], "steps"),
    ],
)
def test_what_does_not_go_together_is_refused_before_computing(cli, words, advice, tmp_path):
    short = "data.length=60", "score=[{zz20: {duration: 60}}]"
    ended = cli(*short, *words, f"out={tmp_path}/run")
    assert ended.code == 2 and len(ended.err.splitlines()) == 1 and advice in ended.err
