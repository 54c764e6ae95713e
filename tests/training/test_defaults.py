"""What is taken where nothing is said: from Python what the commands take, and units and choices as they are named."""

from dataclasses import fields, replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
import yaml
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.problem import Estimate
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.training import ensemble
from manoeuvre_nn.training.closed_loop_fit import ClosedLoopSettings, as_stored, taken_up
from manoeuvre_nn.training.recursive_windows import RecursiveFitSettings
from manoeuvre_nn.training.rollout_refinement import Refinement
from manoeuvre_nn.training.rollout_score import GENERALIZATION, MONITOR, RolloutScore
from manoeuvre_nn.training.settings import NOISE_UNITS, expand, noise_in_si


def said(name: str) -> dict:
    """What a config of the commands says of a fit."""
    return yaml.safe_load((CONF / "fit" / f"{name}.yaml").read_text())["fit"]


def test_python_takes_what_the_commands_take():
    fit = said("ensemble")
    assert Refinement() == Refinement(**fit["refine"])
    assert ensemble.DEFAULT_STOPS == Stops(epochs=fit["epochs"], goal=fit["goal"], min_fall=fit["min_fall"])
    for config, default in (("closed_loop", ClosedLoopSettings()), ("recursive", RecursiveFitSettings())):
        for name in {field.name for field in fields(default)} - {"prior"}:
            value = getattr(default, name)
            assert said(config)[name] == (list(value) if isinstance(value, tuple) else value), name


@pytest.mark.parametrize("setting", NOISE_UNITS)
def test_the_unit_of_a_noise_is_that_of_its_name(setting):
    channel, *unit = setting.split("_", 1)
    assert noise_in_si({setting: 2.0}) == {channel: approx(2.0 * (DEGREE if unit else 1.0))}


@pytest.mark.parametrize("sd", [-1.0, float("nan"), 1e7])
def test_noise_is_a_number_that_a_sensor_may_have(sd):
    with pytest.raises(InputError, match="data.noise.x=.*: expected a standard deviation"):
        noise_in_si({"x": sd})


def test_a_network_is_chosen_by_the_error_that_the_fit_states_or_else_by_the_held_out_runs():
    with unchecked():
        scorer = RolloutScore(held_out=SimpleNamespace())
    scorer.history = [{"epoch": 1.0, MONITOR: 0.1}, {"epoch": 2.0, MONITOR: 0.2}]
    assert "epoch 1, the best of 2 scores on these very manoeuvres" in scorer.how_chosen()
    scorer.history = [row | {GENERALIZATION: 3.0 - row["epoch"]} for row in scorer.history]
    assert "epoch 2, the best of 2 by the error over training and held-out runs together" in scorer.how_chosen()


@pytest.mark.parametrize("every, epochs, scored", [(1, 3, [1, 2, 3]), (4, 6, [4, 6]), (2, 4, [2, 4]), (9, 5, [5])])
def test_every_so_many_epochs_and_the_last_are_scored_counted_from_one(monkeypatch, every, epochs, scored):
    with unchecked():
        scorer = RolloutScore(held_out=SimpleNamespace(), every=every)
        monkeypatch.setattr(scorer, "score", lambda trainer, module: {MONITOR: 0.1})
        for epoch in range(epochs):
            trainer = Mock(should_stop=False, current_epoch=epoch, max_epochs=epochs, callback_metrics={})
            scorer.on_train_epoch_end(trainer, Mock())
    assert [row["epoch"] for row in scorer.history] == scored and scorer.scored(epochs)


def test_steps_are_chosen_by_predicting_each_twelfth_of_the_time_from_the_others(monkeypatch):
    trained_on, predicted = [], []

    def problem(x, y):
        trained_on.append(x[:, 0].tolist())
        return SimpleNamespace(full=lambda w: w, output_weights=lambda w: w)

    def with_weights(inside, outside):
        assert len(inside) == 4, "members"
        return lambda x: predicted.append(x[:, 0].tolist()) or torch.zeros(len(x), 3)

    network = SimpleNamespace(members=9, least_squares=problem, with_weights=with_weights)
    monkeypatch.setattr(ensemble, "_start", lambda network, member: torch.zeros(1, 5))
    monkeypatch.setattr(ensemble, "minimise", lambda problem, start, **_: SimpleNamespace(weights=start))
    x = torch.arange(240.0)[:, None].repeat(1, 4)
    with unchecked():
        assert ensemble.steps_that_predict(network, x, torch.ones(240, 3), Stops(epochs=2)) == 2
    assert [len(rows) for rows in trained_on] == [220] * 12 and sum(predicted, []) == x[:, 0].tolist()
    assert all(sorted(a + b) == x[:, 0].tolist() for a, b in zip(trained_on, predicted, strict=True))


@pytest.mark.parametrize(
    "errors, best",
    [
        ((5.0, 7.0, 6.0, 3.0, 4.0, 4.0, 4.0), 12),  # it gets better again after two worse ones
        ((5.0, 7.0, 6.0, 6.0, 3.0, 4.0, 4.0), 3),  # but after three no more are tried
    ],
)
def test_steps_are_tried_until_three_in_turn_are_worse(monkeypatch, errors, best):
    tried = dict(zip(ensemble.STEP_TRIALS, errors, strict=True))

    def go_on(problem, start, *, stops, **_):
        return SimpleNamespace(weights=start + stops.epochs)  # so many steps in all

    network = SimpleNamespace(
        members=1,
        least_squares=lambda x, y: SimpleNamespace(full=lambda w: w, output_weights=lambda w: w),
        with_weights=lambda inside, _: lambda x: torch.full((len(x), 3), tried[int(inside[0, 0])] ** 0.5),
    )
    monkeypatch.setattr(ensemble, "_start", lambda network, member: torch.zeros(1, 5))
    monkeypatch.setattr(ensemble, "minimise", go_on)
    with unchecked():
        found = ensemble.steps_that_predict(network, torch.zeros(24, 4), torch.zeros(24, 3), Stops(epochs=80))
    assert found == best


def test_an_estimation_goes_on_from_whole_numbers_alone():
    part = np.ones((3, 9))
    first = Estimate(
        (part, part), np.ones(4), np.ones(6), np.ones(3), (np.ones((3, 6)),), (np.ones((2, 3)),), np.eye(4), np.ones(6)
    )
    first = replace(first, cost=1.0, evidence=2.0, moved=0.1)
    stored = as_stored(first)
    assert taken_up(first, stored).values.tolist() == [1.0] * 4
    damaged = part.copy()
    damaged[1, 2] = np.nan
    with pytest.raises(InputError, match="states is damaged"):
        taken_up(first, as_stored(replace(first, states=(part, damaged))))


def test_a_name_of_hundreds_of_folders_is_told_with_its_beginning(tmp_path):
    with pytest.raises(InputError, match=r"^score: (x/){100} is not in .*; it holds no recording$"):
        expand(tmp_path, ["x/" * 500], "score")
