"""Every logger holds the numbers over epochs, the last scores and the settings, and goes on in a resumed run."""

import csv
from pathlib import Path

import pytest
import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny import lm, train

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.training import loggers
from manoeuvre_nn.training.loggers import ToCsv, ToMLflow, ToTensorBoard

SETTINGS, SCORES = {"network": "wang", "network.hidden": 3}, {"zz20/dev_L": 0.125}


def ended(out, *chosen, epochs: int = 2) -> None:
    trained, _ = train(lm(), out, max_epochs=epochs, loggers=chosen)
    for logger in trained.loggers:
        logger.end(SETTINGS, SCORES, trained.epochs)


def rows(out) -> list[dict[str, str]]:
    with (out / "csv/metrics.csv").open() as file:
        return list(csv.DictReader(file))


def test_several_loggers_at_once_each_hold_the_last_scores_and_the_settings(tmp_path):
    ended(tmp_path, ToCsv(), ToTensorBoard())
    told = [chosen.open(tmp_path / "other").shown_by(Path("out/a")) for chosen in (ToCsv(), ToTensorBoard())]
    assert told == ["numbers over epochs: out/a/csv/metrics.csv", "dashboard: tensorboard --logdir out"]
    assert rows(tmp_path)[-1]["zz20/dev_L"] == "0.125" and rows(tmp_path)[0]["train/mse"]
    assert yaml.safe_load((tmp_path / "csv/hparams.yaml").read_text()) == SETTINGS
    board = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert board.Scalars("1 held-out/dev_L zz20")[-1].value == 0.125
    assert b"network.hidden" in b"".join(path.read_bytes() for path in (tmp_path / "tensorboard").iterdir())


def test_a_resumed_run_keeps_the_rows_of_its_first_epochs(tmp_path):
    ended(tmp_path, ToCsv(), epochs=2)
    before = rows(tmp_path)
    ended(tmp_path, ToCsv(), epochs=4)
    after = rows(tmp_path)
    assert [row["step"] for row in after[: len(before)]] == [row["step"] for row in before]
    assert {int(row["step"]) for row in after if row["train/mse"]} == {0, 1, 2, 3}


def test_mlflow_holds_figures_too_and_a_resumed_run_is_the_same_one(tmp_path, monkeypatch):
    mlflow = pytest.importorskip("mlflow")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(loggers.FILES_ALLOWED, "true")
    monkeypatch.delenv(loggers.STORE, raising=False)
    picture = tmp_path / "track.png"
    picture.write_bytes(b"png")
    for epochs in (2, 4):
        trained, _ = train(lm(), tmp_path / "hidden=3", max_epochs=epochs, loggers=[ToMLflow()])
        (logger,) = trained.loggers
        logger.add_picture("zz20/track", picture, trained.epochs)
        logger.end(SETTINGS, SCORES, trained.epochs)
    client = mlflow.tracking.MlflowClient((tmp_path / "mlruns").as_uri())
    (run,) = client.search_runs([client.get_experiment_by_name("manoeuvre-nn").experiment_id])
    assert run.info.run_name == "hidden=3" and run.info.status == "FINISHED"
    assert run.data.params == {name: str(value) for name, value in SETTINGS.items()}
    assert run.data.metrics["zz20/dev_L"] == 0.125
    assert {m.step for m in client.get_metric_history(run.info.run_id, "train/mse")} == {0, 1, 2, 3}
    assert [file.path for file in client.list_artifacts(run.info.run_id, "figures")] == ["figures/track.png"]


def test_a_logger_that_is_not_installed_is_said_in_a_line(monkeypatch):
    monkeypatch.setattr(loggers, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'manoeuvre-nn\[mlflow\]'"):
        ToMLflow()
