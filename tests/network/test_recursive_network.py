"""The recursive network: its published sizes, bounded outputs, and port and starboard alike."""

import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.recursive import RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.network.recursive_settings import ForceSettings


def network(seed=0, **settings):
    made = RecursiveNetwork(RecursiveSettings(**settings), seed=seed, dtype=torch.float64)
    draw = torch.Generator().manual_seed(1)
    x = torch.randn(300, made.inputs_count, generator=draw, dtype=torch.float64) * 3 + 1
    y = torch.randn(300, len(made.settings.velocities), generator=draw, dtype=torch.float64)
    made.scale_to(x, y)
    return made, x, y


@pytest.mark.parametrize(
    "settings, inputs, weights",
    [
        ({"freedom": 6, "hidden": (56, 56), "biases": False}, 56, 6608),
        ({"freedom": 6, "hidden": (54, 54)}, 56, 6372),
        ({"freedom": 4}, 44, 44 * 54 + 54 + 54 * 54 + 54 + 54 * 4),
        ({"freedom": 3, "hidden": (8,)}, 34, 34 * 8 + 8 + 8 * 3),
        ({"freedom": 4, "wind": True, "wind_nodes": True}, 50, 50 * 54 + 54 + 54 * 54 + 54 + 54 * 4),
        ({"freedom": 4, "wind": True}, 50, 44 * 54 + 54 + 54 * 54 + 54 + 54 * 4 + 7),
    ],
)
def test_inputs_and_weights_are_as_many_as_published(settings, inputs, weights):
    made = RecursiveNetwork(RecursiveSettings(**settings))
    assert (made.inputs_count, made.weights_count) == (inputs, weights)
    assert made(torch.zeros(2, 5, inputs)).shape == (2, 5, made.settings.freedom)


def test_inputs_are_those_of_table_2():
    names = RecursiveNetwork(RecursiveSettings(freedom=6)).input_names
    count = {}
    for name in names:
        count[name.partition("-")[0]] = count.get(name.partition("-")[0], 0) + 1
    assert count == {
        "thrust_starboard": 2, "thrust_port": 2, "lift_starboard": 8, "lift_port": 8, "K": 8, "M": 8, "N": 8,
        "u": 2, "v": 2, "w": 2, "p": 2, "q": 2, "r": 2,
    }  # fmt: skip


def test_joined_inputs_stand_where_their_names_say():
    made = RecursiveNetwork(RecursiveSettings(freedom=4, past=3, past_thrust=1, wind=True))
    columns, velocities = made.settings.columns, made.settings.velocities
    forces = [torch.tensor([[100.0 * k + c for c in range(len(columns))]]) for k in range(4)]
    outputs = [torch.tensor([[1000.0 * (k + 1) + c for c in range(4)]]) for k in range(2)]
    values = dict(zip(made.input_names, made.join(forces, outputs)[0].tolist(), strict=True))
    for name, value in values.items():
        quantity, _, delay = name.partition("-")
        if quantity in velocities:
            assert value == 1000.0 * (int(delay) + 1) + velocities.index(quantity)
        else:
            assert value == 100.0 * int(delay) + columns.index(quantity)
    assert "wind_X-1" in values and "wind_X-2" not in values and "N-3" in values


@pytest.mark.parametrize(
    "settings",
    [{}, {"biases": False}, {"wind": True}, {"wind": True, "wind_nodes": True}, {"freedom": 3}, {"freedom": 6}],
)
def test_a_mirrored_ship_answers_with_the_mirror_image(settings):
    made, x, _ = network(**settings)
    if made.links is not None:
        made.links.data.normal_(generator=torch.Generator().manual_seed(2))
    assert torch.allclose(made(made.mirrored(x)), made(x) * made.output_signs, atol=1e-12)
    assert torch.equal(made.mirrored(made.mirrored(x)), x)


def test_output_nodes_of_a_symmetric_network_are_given_the_mean_of_it_and_its_mirror_image():
    made, x, _ = network(about_last=False)
    alone = RecursiveNetwork(RecursiveSettings(symmetric=False, about_last=False), dtype=torch.float64)
    alone.load_state_dict(made.state_dict())

    def given(inputs):
        return ((alone(inputs) - alone.middle) / alone.half_range).atanh()

    mean = 0.5 * (given(x) + given(alone.mirrored(x)) * alone.output_signs)
    assert torch.allclose(made(x), made.middle + made.half_range * mean.tanh(), atol=1e-9)


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_network_that_gives_nothing_repeats_the_last_outputs(symmetric):
    made, x, _ = network(symmetric=symmetric, margin=9.0)
    made.weights[-1].data.zero_()
    assert torch.allclose(made(x), x[:, -8:-4], atol=1e-9)


def test_a_ship_that_goes_straight_ahead_with_all_alike_is_not_turned():
    made, _, _ = network()
    ahead = torch.tensor([1.0 if name[0] in "tu" else 0.0 for name in made.input_names], dtype=torch.float64)
    assert made(ahead)[1:].abs().max() < 1e-12


def test_outputs_stay_within_the_range_of_the_data_and_its_margin():
    made, x, y = network(symmetric=False, margin=0.1, about_last=False)
    far = made(1e3 * x)
    low, high = y.amin(0), y.amax(0)
    assert (far >= low - 0.05 * (high - low) - 1e-9).all() and (far <= high + 0.05 * (high - low) + 1e-9).all()
    assert far.amax() > 0


def test_the_scaling_drawn_into_the_weights_is_the_scaling_of_the_inputs():
    made, x, _ = network(symmetric=False, hidden=(7,), about_last=False)
    z = (x - made.shift) / made.scale
    nodes = torch.sigmoid(z @ made.weights[0] + made.biases[0])
    plain = made.middle + made.half_range * (2 * torch.sigmoid(2 * nodes @ made.weights[1]) - 1)
    assert torch.allclose(made(x), plain, atol=1e-12)


@pytest.mark.parametrize("settings", [{"symmetric": False}, {"symmetric": True, "wind": True}, {"about_last": False}])
def test_what_is_pulled_back_is_the_gradient_of_the_answer_within_and_beyond_the_range_of_the_outputs(settings):
    made, x, _ = network(hidden=(7, 5), **settings)
    draw = torch.Generator().manual_seed(2)
    for parameter in made.parameters():
        parameter.data.normal_(0.0, 0.3, generator=draw)
    count, folded = len(made.middle), made.folded()
    x = x[:6]
    x[:3, -2 * count : -count] = made.middle + made.half_range * torch.tensor([[-1.5], [1.0 + 1e-9], [0.4]])
    x.requires_grad_()
    answer = made.answer(x, folded)
    cotangent = torch.randn(answer.shape, generator=draw, dtype=x.dtype)
    (expected,) = torch.autograd.grad((answer * cotangent).sum(), x)
    back, _ = made.pulled_back(cotangent, made.nodes(x, folded)[1], folded)
    torch.testing.assert_close(back, expected)


def test_a_propeller_of_the_source_gives_no_thrust_at_an_advance_of_one_and_a_half_diameters():
    """Hess & Faller 2000, Table 3, ship 1: ``K_T = .6 - .4 J``."""
    c1, c2 = ForceSettings().thrust
    assert c1 == 0.6 and c1 + 1.5 * c2 == pytest.approx(0.0)


def test_the_wind_acts_on_the_output_nodes_in_proportion_and_still_air_not_at_all():
    made, x, _ = network(wind=True, symmetric=False, about_last=False)
    calm = RecursiveNetwork(RecursiveSettings(wind=True, symmetric=False, about_last=False), dtype=torch.float64)
    calm.load_state_dict(made.state_dict())
    made.links.data.fill_(1.0)

    def given(to, inputs):
        return ((to(inputs) - to.middle) / to.half_range).atanh()

    wind = made.input_names.index("wind_X-0")
    still = x.clone()
    still[:, wind : wind + 3] = 0.0
    assert torch.allclose(made(still), calm(still), atol=1e-12)
    push = x[:, wind : wind + 3] / made.scale[wind : wind + 3]
    assert torch.allclose(given(made, x) - given(calm, x), 0.05 * push.sum(1, keepdim=True).expand(-1, 4), atol=1e-6)


def test_an_input_that_never_changes_is_not_blown_up():
    made = RecursiveNetwork(RecursiveSettings(symmetric=False), dtype=torch.float64)
    x = torch.randn(50, made.inputs_count, dtype=torch.float64)
    x[:, 0] = 0.37
    made.scale_to(x, x[:, :4])
    assert made.scale[0] == pytest.approx(0.37)


def test_the_same_seed_draws_the_same_weights_in_either_precision():
    one, two, other = (
        RecursiveNetwork(seed=s, dtype=d) for s, d in ((3, torch.float64), (3, torch.float32), (4, torch.float64))
    )
    assert torch.equal(one.weights[0].float(), two.weights[0]) and not torch.equal(one.weights[0], other.weights[0])


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"freedom": 5}, "freedom"),
        ({"hidden": ()}, "hidden"),
        ({"past": 1, "past_thrust": 2}, "past_thrust"),
        ({"step": 0.0}, "step"),
        ({"margin": -1.0}, "margin"),
    ],
)
def test_shapes_that_make_no_sense_are_refused_in_one_line(settings, words):
    with pytest.raises(InputError, match=words) as refused:
        RecursiveSettings(**settings)
    assert "\n" not in str(refused.value)
