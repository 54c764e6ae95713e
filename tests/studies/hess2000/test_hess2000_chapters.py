"""Hess & Faller 2000 done again: rivals where the answer is known, and every chapter in miniature."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from manoeuvre_nn.network.recursive import RecursiveSettings
from studies.hess2000 import architecture, gated, rivals, tables, training
from studies.hess2000.runs import SHIPS, PlannedRun, RunSet, sail
from studies.reproduction.section import ComputingEffort

QUICK = ComputingEffort(quick=True, starts=1)


def quiet(what):
    assert what


@pytest.fixture(scope="module")
def runs():
    """Short overshoots of 20 deg, one of them to port."""
    ship = SHIPS[2]()
    sides = ("starboard", "port", "starboard", "starboard")
    plans = [
        PlannedRun(replace(overshoot(20.0, side, cycles=2.0), speed=speed * KNOT))
        for side, speed in zip(sides, (25.0, 24.0, 24.5, 25.5), strict=True)
    ]
    with unchecked():
        sailed = sail(ship, plans)
    return RunSet(ship, tuple(sailed[:2]), (sailed[2],), (sailed[3],))


def perfect(runs):
    return training.TrainedSimulator("perfect", list, 0.0, 0)


def test_a_perfect_prediction_has_no_error_in_any_set(runs):
    found = training.measures_of(perfect(runs), runs)
    assert set(found.index.unique("set")) == {"all", "validation", "unseen"}
    assert found["percent"].to_numpy() == approx(0.0)
    assert found["correlation"].to_numpy() == approx(1.0)


def test_the_weights_of_the_best_generalization_are_kept(runs):
    line = torch.nn.Linear(1, 1)
    scale = iter([1.2, 1.05, 1.5])

    def predict(recordings):
        factor = next(scale)
        torch.nn.init.constant_(line.bias, factor)
        return [r.with_channels(u=factor * r["u"]) for r in recordings]

    best = training.BestWeights.of(line, predict, runs)
    for k in range(3):
        best.test(k, 0.0)
    history = best.restore()
    assert float(line.bias) == approx(1.05) and list(history["update"]) == [0.0, 1.0, 2.0]
    assert training.TrainedSimulator("", predict, 0.0, 0, history).stopped == 0.5


def test_linear_regression_finds_a_linear_map_that_is_alike_to_both_sides():
    network = rivals.LinearStep(RecursiveSettings())
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(400, network.inputs_count, generator=generator, dtype=torch.float64)
    matrix = torch.randn(network.inputs_count, 4, generator=generator, dtype=torch.float64)
    y = 0.5 * (x @ matrix + (network.mirrored(x) @ matrix) * network.output_signs)
    network.scale_to(x, y)
    network.learn(x[:300], y[:300])
    torch.testing.assert_close(network.answer(x[300:], network.folded()), y[300:], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("kind", gated.HIDDEN)
def test_gated_cells_have_the_size_of_the_papers_network_and_know_no_side(runs, kind):
    network = gated.GatedSimulator(kind, runs.ship, 0)
    assert network.weights_count == approx(6608, rel=0.02)
    run = runs.training[0]
    odd = ("v", "p", "r", "phi", "psi", "y", "delta", "delta_starboard", "delta_port")
    other = run.with_channels(**{name: -run[name] for name in odd})
    here, there = network.predict([run, other])
    for name in ("u", "v", "p", "r", "phi", "psi", "x", "y"):
        sign = -1 if name in odd else 1
        assert there[name] == approx(sign * here[name], abs=1e-3 * np.abs(here[name]).max()), name
    assert here["u"][0] == approx(run["u"][0], rel=1e-4) and here["psi"][0] == approx(run["psi"][0], abs=1e-6)


def test_the_printed_cells_agree_with_their_scales_and_6608_weights_with_56_nodes():
    found = architecture.chapter(QUICK, quiet)
    verdicts = {claim.what: claim.verdict for claim in found.claims}
    assert verdicts["total"] == "holds" and verdicts["correlation of psi over all runs"] == "does not hold"
    assert verdicts["weights of 56-56 nodes without biases"] == "holds"
    assert [c.what for c in found.claims if c.where == "Tables 4 to 6" and c.verdict != "holds"] == []


@pytest.mark.slow
@pytest.mark.parametrize("table", ["T5", "T6"])
def test_every_table_in_miniature(monkeypatch, runs, table):
    monkeypatch.setattr(tables, "run_set", lambda *_: runs)
    monkeypatch.setattr(training, "QUICK_UPDATES", 4)
    monkeypatch.setattr(training, "QUICK_SCORES", 2)
    monkeypatch.setattr(gated, "QUICK_UPDATES", 2)
    monkeypatch.setattr(rivals, "QUICK_EPOCHS", 1)
    monkeypatch.setattr(rivals, "SERIES", {"cubic": rivals.SERIES["cubic"]})
    monkeypatch.setattr(tables, "SERIES", rivals.SERIES)
    with unchecked():
        found = tables.table_chapter(table, QUICK, quiet)
    assert sum(claim.where == f"Table {table[1:]}" for claim in found.claims) == 40
    assert {row["by"] for row in found.tables["Percent errors"]} == {"paper", "ours, median", "ours, seed 0"}
    if table == "T6":
        rows = found.tables["Rivals, unseen runs: percent errors"]
        assert [row["simulator"] for row in rows][-2:] == ["LSTM", "GRU"] and len(rows) == 6
        series = next(row for row in rows if row["simulator"] == rivals.SERIES["cubic"])
        assert series["y"] < 20 and np.isnan(series["phi"])
    assert len(found.plots) == 4
