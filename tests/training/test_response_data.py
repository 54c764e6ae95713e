import io

import numpy as np
import pandas as pd
import pytest
import torch
from fleet import unchecked
from rich.console import Console

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import Quantities, Records, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.network.perceptron import mlp
from manoeuvre_nn.seakeeping.form import S175
from manoeuvre_nn.training import session
from manoeuvre_nn.training.fits import LevenbergMarquardtFit
from manoeuvre_nn.training.response_data import (
    CONDITIONS,
    ResponseData,
    SeakeepingSettings,
    Split,
    computed_records,
    errors_of,
    grid_of,
    heading_notes,
    recorded_records,
    space_filling,
)
from manoeuvre_nn.training.response_score import ResponseScore
from manoeuvre_nn.training.scalings import response_scaling
from manoeuvre_nn.training.session import Session

UNITS = {"d": ("m", 1.0), "V": ("kn", KNOT), "beta": ("deg", DEGREE), "Hs": ("m", 1.0), "T": ("s", 1.0)}
INPUTS = [Variable(name, unit, size, "") for name, (unit, size) in UNITS.items()]
PITCH = Variable("pitch", "deg", DEGREE, "pitch")
SEES = ("d", "encounter_frequency", "wave_number_along", "T")
QUANTITIES = Quantities(INPUTS, PITCH, SEES, "Hs")
VALUES = {
    "d": [7.0, 9.0],
    "V": [0.0, 5.0, 10.0],
    "beta": [0.0, 1.0, 2.0, 3.0],
    "Hs": [2.0, 4.0],
    "T": [8.0, 10.0, 12.0],
}


def computed(**settings) -> ResponseData:
    split = Split(**{k: settings.pop(k) for k in ("learning", "validation", "seed") if k in settings})
    chosen = SeakeepingSettings(**({"method": "closed_form", "between": 20} | settings))
    return computed_records(QUANTITIES, VALUES, S175, "S-175", chosen, split=split)


@pytest.fixture(scope="module")
def data() -> ResponseData:
    made = computed(validation=0.25)
    made.setup()
    return made


def test_a_grid_has_every_combination_of_its_values():
    grid = grid_of([[1.0, 2.0], [3.0, 4.0, 5.0]])
    assert grid.tolist() == [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]]


def test_space_filling_points_lie_evenly_in_the_ranges_and_depend_on_the_seed_alone():
    grid = grid_of([[1.0, 2.0], [-3.0, 4.0, 5.0]])
    points = space_filling(grid, 64, seed=1)
    assert points.shape == (64, 2)
    for k in range(2):
        share = np.histogram(points[:, k], 8, (grid[:, k].min(), grid[:, k].max()))[0]
        assert (share == 8).all()  # a Sobol sequence of 2^6 puts 8 points into every eighth
    assert np.array_equal(points, space_filling(grid, 64, seed=1))
    assert not np.array_equal(points, space_filling(grid, 64, seed=2))


def test_records_are_split_by_sampling_and_every_record_is_in_one_set(data):
    rows = data.rows
    assert {name: len(r) for name, r in rows.items()} == {"learning": 54, "validation": 18, "testing": 72}
    assert sorted(np.concatenate(list(rows.values())).tolist()) == list(range(144))
    again, other = computed(validation=0.25), computed(validation=0.25, seed=1)
    again.setup(), other.setup()
    assert np.array_equal(again.rows["testing"], rows["testing"])
    assert not np.array_equal(np.sort(other.rows["testing"]), np.sort(rows["testing"]))


def test_the_batch_has_features_and_the_response_over_the_wave_height(data):
    x, y, x_kept, y_kept = data.train_dataloader().dataset[0]
    row = data.rows["learning"][0]
    d, _, beta, height, period = data.records.conditions[row]
    assert x[0, 0] == d and x[0, 3] == period
    assert float(x[0, 2]) == pytest.approx((2 * np.pi / period) ** 2 * abs(np.cos(beta)) / 9.81)
    assert float(y[0, 0]) == pytest.approx(data.records.values[row] / height)
    assert (len(x), len(y), len(x_kept), len(y_kept)) == (54, 54, 18, 18)


def test_linear_theory_makes_pitch_proportional_to_the_wave_height(data):
    heights = data.records.conditions[:, 3]
    low, high = data.records.values[heights == 2.0], data.records.values[heights == 4.0]
    assert high == pytest.approx(2 * low)


def test_points_between_are_random_and_inside_the_ranges(data):
    assert data.between is not None and len(data.between) == 20
    for k, name in enumerate(CONDITIONS):
        column = data.between.conditions[:, k]
        assert min(VALUES[name]) <= column.min() and column.max() <= max(VALUES[name])
        assert not set(column) & set(VALUES[name])


def test_the_ranges_of_the_records_go_with_the_variables(data):
    assert [(v.low, v.high) for v in data.quantities.inputs] == [(min(VALUES[n]), max(VALUES[n])) for n in CONDITIONS]


def test_another_order_of_the_variables_gives_the_same_records(data):
    other = computed_records(
        Quantities(INPUTS[::-1], PITCH, SEES, "Hs"), VALUES, S175, "S-175", SeakeepingSettings("closed_form", between=0)
    )
    other.setup()
    mine = {tuple(c): v for c, v in zip(data.records.conditions, data.records.values, strict=True)}
    theirs = {tuple(c[::-1]): v for c, v in zip(other.records.conditions, other.records.values, strict=True)}
    assert mine.keys() == theirs.keys()
    assert all(mine[key] == pytest.approx(theirs[key]) for key in mine)


def test_errors_are_root_mean_squares_in_the_unit_of_the_response():
    records = Records(INPUTS, PITCH, np.ones((4, 5)), np.radians([1.0, 2.0, 3.0, 4.0]))
    errors = errors_of(records, np.radians([1.0, 2.0, 3.0, 5.0]))
    assert errors["rms"] == pytest.approx(0.5) and errors["mean"] == pytest.approx(0.25)
    assert errors["largest"] == pytest.approx(1.0) and 0.9 < errors["correlation"] < 1
    assert np.isnan(errors_of(records, np.ones(4))["correlation"])


def test_scalings_take_features_to_zero_mean_or_to_plus_minus_one():
    x, y = torch.tensor([[1.0, 5.0], [3.0, 5.0], [8.0, 5.0]]).double(), torch.tensor([[2.0], [4.0], [9.0]]).double()
    standard, ranged = response_scaling("standard", x, y), response_scaling("range", x, y)
    assert standard.inputs(x).mean(0).tolist() == pytest.approx([0, 0], abs=1e-12)
    assert standard.inputs(x)[:, 0].std() == pytest.approx(1.0)
    assert ranged.inputs(x)[:, 0].tolist() == pytest.approx([-1, -3 / 7, 1])
    assert ranged.outputs(y).flatten().tolist() == pytest.approx([-1, -3 / 7, 1])
    for scaling in (standard, ranged, response_scaling("none", x, y)):
        assert torch.allclose(scaling.restore(scaling.outputs(y)), y)


def test_a_network_is_trained_and_scored_on_every_set(tmp_path):
    data = computed()
    data.setup()
    x, y, *_ = data.train_dataloader().dataset[0]
    made = Response(mlp(3, inputs=4, outputs=1), response_scaling("standard", x, y), data.quantities)
    fit = LevenbergMarquardtFit(made, iterations_per_epoch=5)
    score = ResponseScore(data, every=2)
    with unchecked():
        trained = session.run(fit, data, score, Session(4, progress=False), tmp_path, Console(file=io.StringIO()))
    first, last = trained.history[0], trained.history[-1]
    assert last["score/rms"] == last["testing/rms"] and last["learning/rms"] < first["learning/rms"]
    assert {"learning/rms", "testing/rms", "between/rms"} <= set(last)
    assert data.errors(made)["testing"]["rms"] == pytest.approx(score.best["score/rms"])  # the best network is kept
    assert "of 2 scores on the testing records" in trained.chosen


def test_tables_are_read_at_once_and_tested_without_points_between(data, tmp_path):
    pd.DataFrame(data.records.in_units()).to_csv(tmp_path / "mine.csv", index=False)
    wide = [Variable(v.name, v.unit, v.size, "", low=-100.0, high=100.0) for v in INPUTS]
    read = recorded_records(Quantities(wide, PITCH, SEES, "Hs"), ["mine.csv"], None, folder=str(tmp_path))
    read.setup()
    assert read.records.conditions == pytest.approx(data.records.conditions)
    assert read.records.values == pytest.approx(data.records.values)
    assert set(read.sets) == {"learning", "testing"}


def test_headings_that_are_reversed_are_told(data):
    turned = Records(INPUTS, PITCH, data.records.conditions.copy(), data.records.values)
    turned.conditions[:, 2] = np.pi - turned.conditions[:, 2]
    assert "heading_zero: head" in heading_notes(turned, S175)[0]
    assert heading_notes(data.records, S175) == []
    turned.conditions[:, 0] = 50.0  # no draught of this hull: nothing can be said
    assert heading_notes(turned, S175) == []
    assert heading_notes(Records(INPUTS[:4], PITCH, turned.conditions[:, :4], turned.values), S175) == []


@pytest.mark.parametrize(
    "settings, said",
    [
        ({"method": "seaway"}, "data.method 'seaway' is unknown"),
        ({"design": "random"}, "data.design 'random' is unknown"),
        ({"count": 3}, "8 records or more"),
        ({"between": -1}, "expected 0 or more"),
    ],
)
def test_settings_that_make_no_records_are_refused(settings, said):
    with unchecked(), pytest.raises(InputError, match=said):
        SeakeepingSettings(**settings)


@pytest.mark.parametrize("settings", [{"learning": 0.0}, {"learning": 1.5}, {"validation": 1.0}])
def test_shares_out_of_range_are_refused(settings):
    with pytest.raises(InputError, match="expected a share"):
        Split(**settings)


def test_variables_that_pitch_is_not_computed_from_are_refused():
    inputs = [*INPUTS[:-1], Variable("period", "s", 1.0, "")]
    with pytest.raises(InputError, match="pitch is computed from d, V, beta, Hs, T"):
        computed_records(Quantities(inputs, PITCH, ("d",)), VALUES, S175, "S-175")
    with pytest.raises(InputError, match="inputs.T.values has fewer than two"):
        computed_records(QUANTITIES, {**VALUES, "T": [8.0]}, S175, "S-175")


def test_a_variable_that_never_changes_is_refused():
    records = Records(INPUTS, PITCH, np.tile(np.arange(9.0)[:, None], (1, 5)), np.ones(9))
    records.conditions[:, 4] = 8.0
    made = ResponseData(QUANTITIES, lambda say: (records, None))
    with pytest.raises(InputError, match="T is 8 s in every record"):
        made.setup()


def test_a_scaling_without_a_shift_of_the_output_has_none_in_its_checkpoint():
    one = torch.ones(1)
    assert "output_shift" not in Scaling(one, one, one).state_dict()
    assert "output_shift" in Scaling(one, one, one, one).state_dict()
