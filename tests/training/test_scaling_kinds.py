import pytest
import tiny
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.training.scalings import KINDS, make_scaling

X = torch.tensor([[1.0, 0.0, 0.0, 0.5], [0.8, 0.1, 0.3, 0.5], [0.6, 0.2, -0.6, 0.5]], dtype=torch.float64)
Y = torch.tensor([[3.0, 0.0, 1e-3], [4.0, 0.0, 2e-3], [5.0, 0.0, -3e-3]], dtype=torch.float64)
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
