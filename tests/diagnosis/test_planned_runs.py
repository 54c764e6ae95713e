"""Runs of which only rudder and warm-up are known are predicted with bands and prove nothing."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked
from sailed import sailed, write_runs

from manoeuvre_nn.diagnosis import forecast
from manoeuvre_nn.diagnosis.answers import write_answer
from manoeuvre_nn.diagnosis.case import Case, Question, RunSettings, read_runs
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.repair import predict, recorded
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.report.diagnosis_figures import draw_diagnosis
from manoeuvre_nn.report.diagnosis_html import diagnosis_html
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
NAMES = ("zz1", "tc1", "zz2", "tc2")
HELD_OUT = ("tc1", "zz2")
GIVEN = ("t", "delta", "delta_order")


def case_of(folder: Path, *planned: str, given=GIVEN) -> Case:
    tables = {name: table[::2].copy() for name, table in zip(NAMES, sailed(0.4), strict=True)}
    for name in planned:
        tables[name].loc[tables[name].t > 40, [c for c in tables[name] if c not in given]] = np.nan
    settings = RunSettings(HELD_OUT, rudder_positive_to="port")
    return read_runs(write_runs(folder, tables), SHIP, settings)


@cache
def answered() -> tuple[Case, Diagnosis]:
    """The whole recordings, and the answer without those of ``tc1`` after its warm-up."""
    with TemporaryDirectory() as place, unchecked():
        whole = case_of(Path(place, "whole"))
        case = case_of(Path(place, "planned"), "tc1")
        return whole, diagnose(Question(case, CalmWater(case.hull), [Current(SHIP)]))


@pytest.mark.parametrize("given", [GIVEN, (*GIVEN, "n"), ("t", "delta")])
def test_a_planned_run_is_no_held_out_one(tmp_path, given):
    case = case_of(tmp_path, "tc1", given=given)
    assert [run.name for run in case.planned] == ["tc1"] and [run.name for run in case.held_out] == ["zz2"]
    assert "Nothing was recorded after the warm-up of tc1: predicted with bands, no proof." in case.undecided


def test_planned_runs_alone_prove_nothing_and_that_is_said(tmp_path):
    case = case_of(tmp_path, *HELD_OUT)
    assert case.held_out == [] and len(case.planned) == 2
    said = "No held-out run was recorded to its end: nothing is proved, and an effect is only proposed."
    assert said in case.undecided


def test_bands_hold_what_was_recorded_as_often_as_they_say():
    whole, d = answered()
    (planned,) = d.forecasts
    record = recorded(next(run for run in whole.runs if run.name == "tc1"), whole.warmup)
    there = record.notna().all(axis=1)  # between samples there is nothing to compare
    record, bands = record[there], planned.after[there]
    inside = {
        c: np.mean((record[c] >= bands[f"{c}_low"]) & (record[c] <= bands[f"{c}_high"])) for c in record.columns[1:]
    }
    assert min(inside.values()) > 0.85 and 0.92 < np.mean(list(inside.values())) < 0.99, inside
    assert np.hypot(planned.after.x - record.x, planned.after.y - record.y).mean() < 2.0
    width = planned.after.y_high - planned.after.y_low
    assert width.iloc[-1] > 1.5 * width.iloc[0] and width.iloc[-1] < 20.0
    assert np.isnan(planned.recorded.x).all() and np.isnan(list(planned.rmse_after.values())).all()


def test_a_planned_run_is_written_and_shown_but_does_not_count(tmp_path):
    _, d = answered()
    assert d.model == ["current"] and [p.run for p in d.proofs] == ["zz2"]
    write_answer(d, tmp_path)
    after = pd.read_csv(tmp_path / "predictions/after/tc1.csv")
    assert [*after.columns][:8] == ["t", "x", "y", "psi", "u", "v", "r", "u_log"] and "psi_high" in after
    assert after.psi.between(0, 360).all() and ((after.psi_low < after.psi) & (after.psi < after.psi_high)).all()
    assert (tmp_path / "predictions/before/tc1.csv").is_file()
    figures = draw_diagnosis(d)
    assert "planned/tc1" in figures and "channels/tc1" not in figures
    diagnosis_html(d, {}, tmp_path / "page.html")
    assert "Planned runs" in (tmp_path / "page.html").read_text()


def test_predictions_have_the_errors_of_coefficients_that_the_fitted_runs_do_not_show(tmp_path, monkeypatch):
    """Here each draw has the same ones: the most likely run is then that of a ship with such coefficients."""
    case = case_of(tmp_path)
    turn, nothing = [run for run in case.held_out if run.name == "tc1"], Hypothesis((), ())
    with unchecked():
        data_set = whitened_data_set(CalmWater(SHIP), [run.between(0.0, 55.0) for run in case.fitted])
        known = forecast.known_of(data_set, MarginalLikelihood(data_set).evaluate(nothing))
        errors = 0.1 * np.random.default_rng(2).standard_normal(len(data_set.rotation))
        monkeypatch.setattr(forecast, "unseen_scatter", lambda *_: errors)
        monkeypatch.setattr(forecast, "DRAWS", 10)  # the first is looked at
        ((drawn, *_),) = forecast.drawn_tables(known, nothing, turn, case.warmup)
        combinations = known.mean[: data_set.combinations]
        alike, without = (
            predict(known.corrected(combinations, c), nothing, turn, case.warmup, known.latency)[0].psi.iloc[-1]
            for c in (errors, 0.0)
        )
    assert abs(alike - without) > 10.0 and drawn.psi.iloc[-1] == pytest.approx(alike, abs=0.1 * abs(alike - without))


@pytest.mark.usefixtures("unchecked_types")
def test_what_is_periodic_with_its_own_phase_has_weights_of_each_run_and_none_beforehand():
    """A planned run is predicted without it, and its bands hold sizes as in the fitted runs: here 5 and 1, 7 and 1."""
    effect = Formula(SHIP, ["N r", "N cos periodic_by_run", "N sin periodic_by_run"], period_s=50.0)
    fitted = Hypothesis((effect,), (np.array([[0.2, 3.0, 4.0, 50.0], [0.2, -3.0, -4.0, 50.0]]),))
    assert [(f.parameter.name, f.runs) for f in fitted.unknowns()] == [
        ("w1", (0, 1)), ("w2", (0,)), ("w2", (1,)), ("w3", (0,)), ("w3", (1,)), ("period_s", (0, 1)),
    ]  # fmt: skip
    assert effect.timed == [] and fitted.prior_sds([600.0, 600.0])[1] == effect.declared[1].spread
    planned = fitted.in_other_runs([1])
    assert planned.values[0].tolist() == [[0.2, 0.0, 0.0, 50.0]]
    drawn = fitted.in_other_runs([0] * 8000)
    drawn.values[0][::4000, 1:3] = drawn.values[0][1, 1:3] = 7.0
    drawn.values[0][::4000, 1:3] = 0.0
    forecast._draw_sizes(drawn, fitted, 4000, np.random.default_rng(0))
    sizes = drawn.values[0]
    assert (sizes[[0, 4000], 1:3] == 0.0).all() and (sizes[1, 1:3] == 7.0).all(), "the likeliest run; what a run tells"
    assert sizes[2:, 1:3].std(axis=0) == pytest.approx([3.0, 4.0], rel=0.05)
    assert abs(sizes[2:, 1:3].mean(axis=0)) == pytest.approx(0.0, abs=0.2)
    assert (sizes[:, 0] == 0.2).all() and (sizes[:, 3] == 50.0).all()
    question = SimpleNamespace(case=SimpleNamespace(planned=[SimpleNamespace(name="p1")]))
    (said,) = forecast.unplaced_events(question, SimpleNamespace(hypothesis=fitted))
    assert said == "Size and phase of a force without a name in p1 are not known beforehand: predicted without it."
