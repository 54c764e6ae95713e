import numpy as np
import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import Quantities, Records, Response, Variable, check_records
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.network.perceptron import mlp

SPEED = Variable("V", "kn", KNOT, "speed", low=0.0, high=10.0)
HEADING = Variable("beta", "deg", DEGREE, "heading", low=0.0, high=3.0)
HEIGHT = Variable("Hs", "m", 1.0, "wave height", low=1.0, high=5.0)
PITCH = Variable("pitch", "deg", DEGREE, "pitch")
INPUTS = (SPEED, HEADING, HEIGHT)
SEES = ("V", "cos_beta")
CONDITIONS = torch.tensor([[5.0, 0.4, 2.0], [7.0, 1.1, 3.0]], dtype=torch.float64)


def response(per: str | None = "Hs") -> Response:
    count = len(SEES)
    scaling = Scaling(
        torch.arange(count, dtype=torch.float64), torch.full((count,), 2.0, dtype=torch.float64),
        torch.tensor([3.0], dtype=torch.float64), torch.tensor([0.5], dtype=torch.float64),
    )  # fmt: skip
    return Response(mlp(4, inputs=count, outputs=1), scaling, Quantities(INPUTS, PITCH, SEES, per))


def test_a_network_sees_variables_and_cosines_in_the_order_that_is_asked_for():
    quantities = Quantities(INPUTS, PITCH, ("cos_beta", "V"), "Hs")
    seen = quantities.features(CONDITIONS)
    assert torch.allclose(seen, torch.stack([CONDITIONS[:, 1].cos(), CONDITIONS[:, 0]], 1))
    assert torch.equal(quantities.factor(CONDITIONS), CONDITIONS[:, 2])
    assert torch.equal(Quantities(INPUTS, PITCH, ("V",)).factor(CONDITIONS), torch.ones(2, dtype=torch.float64))


def test_linear_theory_gives_frequency_of_encounter_and_wave_number_along_the_ship():
    sea = (SPEED, HEADING, Variable("T", "s", 1.0, "period"))
    quantities = Quantities(sea, PITCH, ("encounter_frequency", "wave_number_along"))
    following, head, beam = torch.tensor([[10.0, 0.0, 8.0], [10.0, torch.pi, 8.0], [10.0, torch.pi / 2, 8.0]]).double()
    wave = 2 * np.pi / 8
    assert quantities.features(following).tolist() == pytest.approx([wave - wave**2 * 10 / 9.81, wave**2 / 9.81])
    assert quantities.features(head).tolist() == pytest.approx([wave + wave**2 * 10 / 9.81, wave**2 / 9.81])
    assert quantities.features(beam).tolist() == pytest.approx([wave, 0.0], abs=1e-7)


def test_the_response_is_the_restored_output_of_the_network_times_its_factor():
    made = response()
    network, (weights, outer) = made.network, (p.detach() for p in made.network.parameters())
    z = (Quantities(INPUTS, PITCH, SEES).features(CONDITIONS) - torch.tensor([0.0, 1.0])) / 2
    y = torch.tanh(z @ weights[0, :, :-1].T + weights[0, :, -1]) @ outer[0, 0, :-1] + outer[0, 0, -1]
    assert torch.allclose(made(CONDITIONS), (3 * y + 0.5) * CONDITIONS[:, 2])
    assert network(z).shape == (2, 1)


def test_the_response_doubles_with_the_wave_height_and_is_even_in_the_heading():
    made, other = response(), CONDITIONS * torch.tensor([1.0, -1.0, 2.0])
    assert torch.allclose(made(other), 2 * made(CONDITIONS))
    assert not torch.allclose(response(None)(other), 2 * response(None)(CONDITIONS))


def test_ranges_of_the_records_are_kept_with_the_weights():
    made, other = response(), response()
    other.ranges.zero_()
    other.load_state_dict(made.state_dict())
    assert [(v.low, v.high) for v in other.inputs] == [(0.0, 10.0), (0.0, 3.0), (1.0, 5.0)]


def test_records_are_told_in_the_units_of_the_edge():
    records = Records(INPUTS, PITCH, CONDITIONS.numpy(), np.array([0.01, 0.02]))
    told = records.in_units()
    assert list(told) == ["V [kn]", "beta [deg]", "Hs [m]", "pitch [deg]"]
    assert told["V [kn]"][0] == pytest.approx(5 * 3600 / 1852)
    assert told["pitch [deg]"][1] == pytest.approx(np.degrees(0.02))


@pytest.mark.parametrize(
    "change, said",
    [
        ({"name": "two words"}, "expected a word"),
        ({"symbol": "V^^2"}, "write letters"),
        ({"low": 3.0, "high": 3.0}, "is no range"),
    ],
)
def test_what_is_no_variable_is_refused(change, said):
    with pytest.raises(InputError, match=said):
        Variable(**({"name": "V", "unit": "kn", "size": KNOT, "meaning": "speed"} | change))


@pytest.mark.parametrize(
    "sees, per, said",
    [
        ((), None, "sees nothing"),
        (("period",), None, "'period' is unknown"),
        (("encounter_frequency",), None, "made of T, which is none of the inputs"),
        (("V",), "T", "per 'T' is unknown"),
    ],
)
def test_what_cannot_be_seen_is_refused(sees, per, said):
    with pytest.raises(InputError, match=said):
        Quantities(INPUTS, PITCH, sees, per)


def test_a_response_of_nothing_is_refused():
    with pytest.raises(InputError, match="inputs: there are none"):
        Quantities((), PITCH, ("V",))


def test_records_that_are_too_few_or_not_finite_are_refused():
    many = Records(INPUTS, PITCH, np.ones((9, 3)), np.full(9, 0.1))
    check_records(many)
    with pytest.raises(InputError, match="too few"):
        check_records(many.at(np.arange(3)))
    many.conditions[4, 1] = np.nan
    with pytest.raises(InputError, match="record 5: beta is nan"):
        check_records(many)
