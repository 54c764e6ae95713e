"""Cepowski 2007 done again: records, splits and scores where the answer is known, and every chapter in miniature."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.response import Records
from manoeuvre_nn.core.units import DEGREE, GRAVITY
from studies.cepowski2007 import computed, formula, learners, networks, perceptrons, ranking, records, rivals, scores
from studies.cepowski2007.learners import polynomial
from studies.cepowski2007.published import grid_conditions, published_pitch
from studies.cepowski2007.records import AS_PRINTED, INPUTS, OUTPUT, PHYSICAL, RecordSets
from studies.reproduction.section import ComputingEffort

QUICK = ComputingEffort(quick=True, starts=1)


def quiet(what):
    assert what


def published_sets(method="closed_form", say=quiet, *, seed=0, spread=0):
    """Eq. 3 as if it were the ship."""
    low, high = (np.array([getattr(v, end) for v in INPUTS]) for end in ("low", "high"))
    draw = np.random.default_rng(seed)
    places = [grid_conditions(), draw.uniform(low, high, (100, 5)), draw.uniform(low, high, (spread, 5))]
    return RecordSets(method, *(Records(INPUTS, OUTPUT, c, published_pitch(c)) for c in places))


def a_third(*given, **more):
    """Every third record of the grid: all values of all inputs still."""
    sets = published_sets(*given, **more)
    return replace(sets, grid=replace(sets.grid, conditions=sets.grid.conditions[::3], values=sets.grid.values[::3]))


@pytest.fixture
def small(monkeypatch):
    """Chapters with Eq. 3 for the ship, and less to do."""
    for module in (computed, formula, networks, ranking, rivals):
        monkeypatch.setattr(module, "record_sets", a_third if module in (networks, ranking) else published_sets)
    monkeypatch.setattr(networks, "COUNTS", (50, 100))
    monkeypatch.setattr(networks, "QUICK_SPLITS", 2)
    monkeypatch.setattr(ranking, "QUICK_SPLITS", 2)
    monkeypatch.setattr(networks, "LEFT_OUT", (("d", 0, (7,)), ("Hs", 3, (3,))))
    monkeypatch.setattr(networks, "CURES", (networks.CURES[0], networks.CURES[11]))
    monkeypatch.setattr(rivals, "QUICK_COUNTS", (60, 120))
    monkeypatch.setattr(rivals, "COUNT", 400)
    monkeypatch.setattr(perceptrons, "ITERATIONS", 40)
    monkeypatch.setattr(learners, "DESCENT_STEPS", 200)
    monkeypatch.setattr(learners, "MAX_WIDTH_STEPS", 1)
    with unchecked():  # thousands of steps
        yield


def claim(section, what):
    return next(c for c in section.claims if what in c.what)


def test_records_are_the_papers_grid_and_others_lie_between():
    sets = records.record_sets("closed_form", quiet, seed=1, spread=64)
    assert (len(sets.grid), len(sets.between), len(sets.spread)) == (4400, 800, 64)
    low, high = sets.grid.conditions.min(0), sets.grid.conditions.max(0)
    for some in (sets.between, sets.spread):
        assert (some.conditions >= low).all()
        assert (some.conditions <= high).all()
    np.testing.assert_allclose(low, [v.low for v in INPUTS])
    # A Sobol sequence fills every fourth of each range with as many points.
    counts = np.histogram(sets.spread.conditions[:, 4], np.linspace(low[4], high[4], 5))[0]
    assert counts.tolist() == [16] * 4
    assert np.corrcoef(sets.grid.values, published_pitch(sets.grid.conditions))[0, 1] > 0.9


def test_halves_are_the_whole_and_few_records_leave_all_others_to_test():
    grid = published_sets().grid
    learnt, tested = scores.halves(grid, 3)
    assert len(learnt) == len(tested) == 2200
    both = np.concatenate([learnt.conditions, tested.conditions])
    assert len(np.unique(both, axis=0)) == 4400
    few, rest = scores.halves(grid, 3, 100)
    assert (len(few), len(rest)) == (50, 4350)


def test_what_is_left_out_is_not_learnt():
    learnt, out = scores.without(published_sets().grid, 0, 7.0)
    assert set(out.conditions[:, 0]) == {7.0}
    assert set(learnt.conditions[:, 0]) == {5.0, 9.0, 11.0}
    assert len(learnt) == 2200


def test_a_response_over_the_wave_height_is_proportional_to_it():
    made = scores.approximate(polynomial, PHYSICAL, published_sets().grid)
    low, high = grid_conditions()[:1], grid_conditions()[:1].copy()
    high[:, 3] = 2 * low[:, 3]
    assert made.pitch(high) == approx(2 * made.pitch(low))


def test_errors_are_root_mean_squares_in_degrees():
    grid = published_sets().grid
    off = replace(grid, values=grid.values + 2 * DEGREE)
    made = scores.Approximation(published_pitch, 0.0)
    assert made.rms(grid) == approx(0.0, abs=1e-12)
    assert made.rms(off) == approx(2.0)


def test_both_kinds_of_inputs_are_what_they_say():
    assert AS_PRINTED.per is None
    assert [v.name for v in AS_PRINTED.inputs] == list(AS_PRINTED.sees)
    assert PHYSICAL.per == "Hs"
    assert "Hs" not in PHYSICAL.sees


def test_the_chapter_of_the_records_finds_eq_3_in_itself(small):
    section = computed.chapter(QUICK, quiet)
    assert claim(section, "records").verdict == "holds"
    assert claim(section, "correlation of our records").ours == approx(1.0)
    assert claim(section, "RMS difference").ours == approx(0.0, abs=1e-9)
    assert claim(section, "if beta = 0").verdict == "does not hold"
    assert [plot.name for plot in section.plots] == ["figure_3", "figure_4", "figure_5", "figure_6"]
    panel = section.plots[0].panels[1]
    assert panel.title == "d = 7 m"
    assert panel.lines[1].y[[0, 5, 10]] == approx([1.65, 0.52, 2.99], abs=0.01)


def test_the_chapter_of_the_formula_gives_the_network_as_text(small):
    section = formula.chapter(QUICK, quiet)
    assert all(c.verdict == "holds" for c in section.claims if c.where == "Eq. 3")
    assert claim(section, "formula (LaTeX").verdict == "holds"
    rows = section.tables["Its nodes: psi = H_s (b + sum_h B_h tanh(w_h + W_h x)), x scaled"]
    assert len(rows) == 8
    assert [len(plot.panels[0].lines) for plot in section.plots] == [3, 3, 3]


def test_the_nodes_in_the_table_are_the_network(small):
    sets = published_sets()
    model = formula.recommended_response(scores.halves(sets.grid, 0, 800)[0])
    *nodes, bias = formula.node_table(model)
    *scaled, out = formula.scaling_table(model)
    d, V, beta, height, T = sets.between.conditions.T
    omega = 2 * np.pi / T
    z = {
        "d": d, "T": T, "encounter_frequency": omega - omega**2 * V * np.cos(beta) / GRAVITY,
        "wave_number_along": omega**2 * abs(np.cos(beta)) / GRAVITY,
    }  # fmt: skip
    x = {row["of"]: (z[row["of"]] - row["shift"]) / row["scale"] for row in scaled}
    y = bias["B"] + sum(n["B"] * np.tanh(n["w"] + sum(n[name] * x[name] for name in x)) for n in nodes)
    found = height * (out["shift"] + out["scale"] * y)
    np.testing.assert_allclose(found, model.at(sets.between.conditions), rtol=1e-4, atol=1e-7)


@pytest.mark.slow
def test_the_chapter_of_the_networks_tells_every_table(small):
    section = networks.chapter(QUICK, quiet)
    assert max(claim(section, f"{which} RMS of 5-7-1").ours for which in ("learning", "testing")) < 0.13
    (errors, cures, left, placed) = section.tables.values()
    assert [row["splits"] for row in errors] == [2, 2, 2, 1, 1, 1, 1]
    assert [len(cures), len(left), len(placed)] == [2, 2, 2]
    assert section.plots[0].panels[0].log_y


def test_the_chapter_of_sensitivity_ranks_the_inputs(small):
    section = ranking.chapter(QUICK, quiet)
    assert claim(section, "every input counts").verdict == "holds"
    table = section.tables["5-7-1, first split"]
    assert table[0]["input"] == "beta"
    assert table[0]["error ratio, mean"] > table[-1]["error ratio, mean"] > 1


@pytest.mark.slow
def test_the_chapter_of_rivals_scores_all_on_the_same_splits(small):
    section = rivals.chapter(QUICK, quiet)
    table, curve = section.tables.values()
    assert {row["method"] for row in table} == set(rivals.METHODS)
    assert len(table) == 2 * len(rivals.METHODS)
    assert [row["records"] for row in curve] == [60, 120]
    assert len(section.plots[0].panels) == 2
