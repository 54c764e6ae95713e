from dataclasses import replace

import pytest
import tiny
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.training.scalings import KINDS, make_scaling

X = torch.tensor([[1.0, 0.0, 0.0, 0.5], [0.8, 0.1, 0.3, 0.5], [0.6, 0.2, -0.6, 0.5]], dtype=torch.float64)
Y = torch.tensor([[3.0, 0.0, 1e-3], [4.0, 0.0, 2e-3], [5.0, 0.0, -3e-3]], dtype=torch.float64)
MIRROR = torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=torch.float64)
TUPLES = Tuples(X, Y, torch.arange(3, dtype=torch.float64), torch.zeros(3, dtype=torch.long))


def numbers(kind: str, ship=None) -> tuple[list[float], list[float], list[float]]:
    made = make_scaling(kind, ship or tiny.ships()[1], TUPLES)
    return made.shift.tolist(), made.scale.tolist(), made.output_scale.tolist()


def test_the_scaling_of_the_sources_changes_nothing():
    assert numbers("source") == ([0.0] * 4, [1.0] * 4, [1.0] * 3)


def test_centred_takes_the_approach_speed_off():
    assert numbers("centred") == ([1.0, 0.0, 0.0, 0.0], [1.0] * 4, [1.0] * 3)


def test_centred_knows_that_bis_speeds_are_not_over_the_approach_speed():
    ship = esso_190k()
    froude = ship.particulars.speed / (9.81 * ship.particulars.length) ** 0.5
    shift, *_ = numbers("centred", ship)
    assert shift == [pytest.approx(froude, rel=2e-3), 0.0, 0.0, 0.0]


def test_balanced_divides_the_outputs_by_their_root_mean_square_and_a_still_one_by_one():
    shift, scale, output = numbers("balanced")
    assert (shift, scale) == ([1.0, 0.0, 0.0, 0.0], [1.0] * 4)
    assert output == pytest.approx([(50 / 3) ** 0.5, 1.0, (14 / 3) ** 0.5 * 1e-3])


def test_standard_centres_and_normalizes_what_moves():
    made = make_scaling("standard", tiny.ships()[1], TUPLES)
    scaled = made.inputs(X)
    torch.testing.assert_close(scaled.mean(0), torch.zeros(4, dtype=torch.float64), atol=1e-12, rtol=0)
    torch.testing.assert_close(scaled[:, :3].std(0), torch.ones(3, dtype=torch.float64))
    assert made.scale[3] == 1.0 and scaled[:, 3].abs().max() == 0.0
    assert made.output_scale.tolist() == pytest.approx([1.0, 1.0, torch.std(Y[:, 2]).item()])


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_scaled_can_be_restored(kind):
    made = make_scaling(kind, tiny.ships()[1], TUPLES)
    torch.testing.assert_close(made.restore(made.outputs(Y)), Y)


def test_an_unknown_kind_is_refused_with_those_that_exist():
    with pytest.raises(InputError, match="network.scaling 'log' is unknown; choose one of: source, centred, balanced"):
        make_scaling("log", tiny.ships()[1], TUPLES)


def test_mirrored_leaves_amidships_where_it_is_and_normalizes_what_moves():
    shift, scale, output = numbers("mirrored")
    assert shift == [pytest.approx(0.8), 0.0, 0.0, 0.0]
    sizes = [0.2, (0.05 / 3) ** 0.5, (0.45 / 3) ** 0.5, 0.5]
    assert scale == pytest.approx(sizes) and output == pytest.approx([1.0, 1.0, torch.std(Y[:, 2]).item()])


@pytest.mark.parametrize("kind", ["mirrored", "speed"])
def test_the_scaled_inputs_of_the_mirrored_ship_are_the_mirrored_inputs(kind):
    made = make_scaling(kind, tiny.ships()[1], TUPLES)
    assert torch.equal(made.inputs(X * MIRROR), made.inputs(X) * MIRROR)
    standard = make_scaling("standard", tiny.ships()[1], TUPLES)
    assert not torch.allclose(standard.inputs(X * MIRROR), standard.inputs(X) * MIRROR)


@pytest.mark.parametrize("ship", [None, esso_190k()], ids=["mariner", "esso_190k"])
def test_speed_keeps_ratios_of_speeds_and_makes_the_approach_one(ship):
    known = ship or tiny.ships()[1]
    made = make_scaling("speed", known, TUPLES)
    assert made.shift.abs().max() == 0.0
    approach = torch.tensor([known.particulars.speed, 0.0, 0.0], dtype=torch.float64) / known.velocity_units
    approach = torch.cat([approach, approach.new_zeros(1)])
    torch.testing.assert_close(made.inputs(approach), torch.tensor([1.0, 0, 0, 0], dtype=torch.float64))
    slow = X * torch.tensor([0.5, 0.5, 0.5, 1.0], dtype=torch.float64)
    fast, half = made.inputs(X), made.inputs(slow)
    torch.testing.assert_close(half[:, 1:3] / half[:, :1], fast[:, 1:3] / fast[:, :1], rtol=1e-13, atol=0)
    assert made.scale[1:].tolist() == pytest.approx([(0.05 / 3) ** 0.5, (0.45 / 3) ** 0.5, 0.5])


@pytest.mark.parametrize("kind", ["mirrored", "speed"])
def test_what_does_not_move_keeps_its_scale_in_the_mirrored_kinds_too(kind):
    still = X.clone()
    still[:, 0], still[:, 3] = 0.7, 0.0
    made = make_scaling(kind, tiny.ships()[1], replace(TUPLES, inputs=still))
    assert made.scale[[0, 3]].tolist() == [1.0, 1.0] and made.inputs(still).isfinite().all()
