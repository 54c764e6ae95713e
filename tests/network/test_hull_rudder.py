"""The ensemble that knows of sides, hull and rudder, against its formula, its symmetries and its laws of speed."""

import copy
import itertools

import pytest
import torch
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import MAX_SEED
from manoeuvre_nn.network.hull_rudder import MIN_SPEED_PRIME, HullRudder, HullRudderSettings

KINDS = [
    {"symmetric": symmetric, "modular": modular, "speed_law": law, "library": library}
    for symmetric, modular, law, library in itertools.product(
        (True, False), (True, False), ("approach", "shaft"), ("none", "linear", "quadratic")
    )
]
MIRROR = torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=torch.float64)
SIDES = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)


def test_two_nodes_are_the_fewest_one_for_the_hull_and_one_for_the_rudder():
    assert HullRudderSettings(2, 1).hidden == 2
    with pytest.raises(InputError, match="at least 2 nodes"):
        HullRudderSettings(1, 1)


def called(kind: dict) -> str:
    return "-".join(str(value) for value in kind.values())


def made(hidden: int = 5, members: int = 3, **options) -> HullRudder:
    """A network whose output weights are not 0."""
    network = HullRudder(HullRudderSettings(hidden, members, **{"spread": 0.8} | options), seed=3)
    drawn = torch.randn(network.output_weights.shape, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    network.output_weights.data.copy_(drawn)
    return network.requires_grad_(False)


def points(count: int = 9) -> torch.Tensor:
    x = torch.randn(count, 4, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    x[:, 0] = 0.4 + 0.6 * torch.rand(count, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    return x


def written_out(network: HullRudder, k: int, x: torch.Tensor, hull_first: bool) -> torch.Tensor:
    """A member at one point by the sums of the docstring, term by term; ``hull_first``: even nodes are the hull's."""
    u, v, r, delta = x.tolist()
    n, shaft_law = float(network.shaft), network.speed_law == "shaft"
    b = [u * u, u * n, n * n] if shaft_law else [1.0]
    z = [v / u, r / u, delta] if shaft_law else [u, v, r, delta]
    mirrored = [-v / u, -r / u, -delta] if shaft_law else [u, -v, -r, -delta]
    w, weights = network.input_weights[k], network.output_weights[k]

    def node(h: int, inputs: list[float]) -> torch.Tensor:
        return torch.tanh(sum(w[h, i] * inputs[i] for i in range(len(inputs))) + w[h, -1])

    always = b if shaft_law else [1.0, u, u * u] if network.symmetric else [1.0]
    across, along, turn = z[-3:]
    odd = [] if network.library == "none" else [q * factor for q in (across, along, turn) for factor in b]
    if network.library == "quadratic":
        odd += [p * b[0] for p in (abs(across) * across, abs(across) * along, abs(along) * across, abs(along) * along)]
    y = []
    for o, sign in enumerate((1.0, -1.0, -1.0)):
        total, c = torch.zeros((), dtype=torch.float64), iter(weights[o])
        for h in range(len(w)):
            side = node(h, z) + (sign * node(h, mirrored) if network.symmetric else 0.0)
            for factor in b[:1] if hull_first and h % 2 == 0 else b:
                total = total + next(c) * factor * side
        for t in always + [0.0 if o == 0 else q for q in odd]:
            total = total + next(c) * t
        assert next(c, None) is None
        y.append(total)
    return torch.stack(y)


@pytest.mark.parametrize("kind", KINDS, ids=called)
def test_every_member_is_the_sum_that_it_is_said_to_be(kind):
    network, x = made(members=2, **kind), points(4)
    network.shaft.fill_(0.7)
    found = network.each(x.expand(2, -1, -1))
    for k, n in itertools.product(range(2), range(4)):
        torch.testing.assert_close(found[k, n], written_out(network, k, x[n], kind["modular"]), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS, ids=called)
def test_the_columns_and_those_of_a_fit_are_what_the_outputs_are_linear_in(kind):
    network, x = made(members=1, **kind), points()
    d, w = network.least_squares(x, network(x).detach()), network.input_weights[0]
    side, other = (torch.tanh(z @ w[:, :-1].T + w[:, -1]) for z in (d.z, d.z * d.mirror))
    for o in range(3):
        nodes = (side + d.parity[o] * other)[:, d.node] * d.factors[d.factor].T
        columns = torch.cat([nodes, d.library[o].T], 1)
        torch.testing.assert_close(network.columns(x, 0)[o], columns.T, rtol=1e-11, atol=1e-12)
        torch.testing.assert_close(columns @ network.output_weights[0, o], network(x)[:, o], rtol=1e-11, atol=1e-12)


def without_offsets(network: HullRudder) -> HullRudder:
    """The same without what a propeller or an odd hull adds to sway and yaw."""
    nodes, always = len(network.node), 3
    network.output_weights[:, 1:, nodes : nodes + always] = 0.0
    return network


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind["symmetric"]], ids=called)
def test_the_mirrored_ship_has_mirrored_forces_to_the_last_bit(kind):
    network, x = without_offsets(made(**kind)), points()
    assert torch.equal(network(x * MIRROR), network(x) * SIDES)
    ahead = points()
    ahead[:, 1:] = 0.0
    assert network(ahead)[:, 1:].abs().max() == 0.0 and network(ahead)[:, 0].abs().min() > 1e-6


def test_only_the_library_pushes_a_straight_course_to_one_side():
    network, x = made(speed_law="approach"), points()
    x[:, 1:] = 0.0
    u, offsets = x[:, 0], network.output_weights[:, 1:, len(network.node) : len(network.node) + 3]
    expected = torch.stack([torch.ones_like(u), u, u**2], 1) @ offsets.mT
    torch.testing.assert_close(network.each(x.expand(3, -1, -1))[..., 1:], expected, rtol=1e-12, atol=1e-13)


def test_a_ship_that_is_not_symmetric_is_not_mirrored():
    network, x = made(symmetric=False), points()
    assert ((network(x * MIRROR) - network(x) * SIDES).abs().amax(0) > 0.1).all()


@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_the_hull_does_not_see_the_rudder_and_the_rest_does(law):
    network, x = made(hidden=6, speed_law=law, library="none"), points()
    turned = x.clone()
    turned[:, 3] += 0.5
    hull = network.node % 2 == 0
    for kept, moves in ((hull, False), (~hull, True)):
        part = copy.deepcopy(network)
        part.output_weights[..., : len(hull)] *= kept
        assert torch.equal(part(x), part(turned)) is not moves
    assert (network.input_weights[:, ::2, -2] == 0).all() and (network.input_weights[:, 1::2] != 0).all()
    assert (network.input_weights[:, ::2, [0, 1, -1]] != 0).all()


def test_without_modules_every_node_sees_the_rudder():
    network = made(modular=False, speed_law="shaft")
    assert network.sees.all() and (network.input_weights != 0).all()
    assert torch.bincount(network.node).tolist() == [3] * 5


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind["speed_law"] == "shaft"], ids=called)
def test_forces_are_quadratic_in_all_speeds_together(kind):
    network, x = made(**kind), points()
    faster = x * torch.tensor([2.0, 2.0, 2.0, 1.0], dtype=torch.float64)
    assert torch.equal(network.at_shaft(2.0)(faster), 4 * network(x)), "powers of 2 leave no rounding"
    slower = x * torch.tensor([0.3, 0.3, 0.3, 1.0], dtype=torch.float64)
    torch.testing.assert_close(network.at_shaft(0.3)(slower), 0.09 * network(x), rtol=1e-10, atol=1e-13)


def test_the_shaft_turns_the_forces_by_a_parabola_and_leaves_the_hull_alone():
    network, x = made(hidden=6, speed_law="shaft", symmetric=False), points()
    ratios = (0.0, 0.5, 1.0, 2.0)
    y = [network.at_shaft(n).each(x.expand(3, -1, -1)) for n in ratios]
    bend = 4 * (y[2] - 2 * y[1] + y[0])  # twice the factor of n^2
    torch.testing.assert_close(y[3], y[0] + 2 * (y[2] - y[0]) + bend, rtol=1e-10, atol=1e-11)
    hull = (network.node % 2 == 0) & (network.factor == 0)
    assert torch.equal(hull, network.node % 2 == 0), "hull nodes have u^2 alone"
    network.output_weights[..., : len(hull)] *= hull
    network.output_weights[..., len(hull) :] = 0.0
    assert torch.equal(network.at_shaft(2.0)(x), network(x)) and network(x).abs().min() > 0


def test_another_shaft_speed_shares_the_weights_and_leaves_the_first_network_as_it_was():
    network, x = made(speed_law="shaft"), points()
    before = network(x)
    other = network.at_shaft(0.5)
    assert float(other.shaft) == 0.5 and float(network.shaft) == 1.0
    assert torch.equal(network(x), before) and not torch.allclose(other(x), before)
    assert other.input_weights is network.input_weights and other.output_weights is network.output_weights
    network.output_weights *= 2
    torch.testing.assert_close(network(x), 2 * before, rtol=1e-13, atol=0)
    torch.testing.assert_close(other.at_shaft(2.0)(x), 2 * before, rtol=1e-13, atol=0)
    assert network.at_shaft(1.0) is network


def test_a_network_that_knows_no_shaft_stays_the_same_at_any():
    network = made(speed_law="approach")
    assert network.at_shaft(0.5) is network


def test_a_ship_that_lies_still_has_finite_forces():
    network, x = made(speed_law="shaft", library="quadratic"), points(3)
    x[:, 0] = torch.tensor([0.0, -0.2, MIN_SPEED_PRIME], dtype=torch.float64)
    x[:, 1:] = x[:1, 1:]
    y = network(x)
    assert y.isfinite().all() and torch.equal(y[0], y[2]) and torch.equal(y[1], y[2])


def test_the_answer_is_the_median_of_the_members_and_of_two_in_the_middle_their_mean():
    network, x = made(members=5), points()
    each = network.each(x.expand(5, -1, -1))
    ordered = each.sort(dim=0).values
    torch.testing.assert_close(network(x), ordered[2], rtol=0, atol=0)
    network.trained.fill_(4)
    ordered = each[:4].sort(dim=0).values
    torch.testing.assert_close(network(x), (ordered[1] + ordered[2]) / 2, rtol=1e-14, atol=0)


def test_a_member_gone_astray_is_ignored():
    network, x = made(members=3), points()
    network.output_weights[2] *= 1e9
    each = network.each(x.expand(3, -1, -1))[:2]
    assert ((network(x) >= each.amin(0)) & (network(x) <= each.amax(0))).all()


@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_only_trained_members_answer_and_all_before_any_is(law):
    network, x = made(members=4, speed_law=law), points()
    each = network.each(x.expand(4, -1, -1))
    assert each.shape == (4, 9, 3)
    torch.testing.assert_close(network(x), each.quantile(0.5, dim=0))
    for k in (1, 2, 3, 4):
        network.trained.fill_(k)
        torch.testing.assert_close(network(x), each[:k].quantile(0.5, dim=0), rtol=1e-13, atol=1e-14)
    network.trained.fill_(1)
    network.output_weights[1:] = torch.nan
    torch.testing.assert_close(network(x), each[0], rtol=1e-13, atol=1e-14)


def test_members_have_inputs_of_their_own():
    network, x = made(members=3), points(12).reshape(3, 4, 4)
    found = network.each(x)
    for k in range(3):
        torch.testing.assert_close(found[k], network.each(x[k].expand(3, -1, -1))[k], rtol=1e-13, atol=1e-14)
    torch.testing.assert_close(network.each(x, 2), found[:2], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS, ids=called)
def test_inputs_may_each_name_the_member_that_answers(kind):
    network, x = made(**kind), points(6)
    named = torch.tensor([2, 0, 0, 1, 2, 1])
    each = network.each(x.expand(3, -1, -1))
    torch.testing.assert_close(network.of(x, named), each[named, torch.arange(6)], rtol=1e-11, atol=1e-12)


def test_other_weights_make_another_network_and_leave_the_first_as_it_was():
    network, x = made(members=4, speed_law="shaft").at_shaft(0.8), points()
    network.trained.fill_(3)
    before, each = network(x), network.each(x.expand(4, -1, -1))
    other = network.with_weights(network.input_weights[1:3], network.output_weights[1:3])
    assert other.members == int(other.trained) == 2 and float(other.shaft) == float(network.shaft) == 0.8
    torch.testing.assert_close(other(x), each[1:3].mean(0), rtol=1e-11, atol=1e-12)
    assert int(network.trained) == 3 and network.members == 4 and torch.equal(network(x), before)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_leading_dimensions_of_the_inputs_are_kept(batch, law):
    network, x = made(speed_law=law), points(6)
    count = int(torch.tensor(batch).prod()) if batch else 1
    y = network(x[:count].reshape(*batch, 4))
    assert y.shape == (*batch, 3)
    torch.testing.assert_close(y.reshape(-1, 3), network(x)[:count], rtol=1e-13, atol=1e-14)


def test_first_weights_are_those_of_seed_member_and_trial_whoever_asks():
    torch.manual_seed(1)
    network = HullRudder(HullRudderSettings(6, 4), seed=5)
    torch.manual_seed(2)
    again, larger = HullRudder(HullRudderSettings(6, 4), seed=5), HullRudder(HullRudderSettings(6, 9), seed=5)
    assert torch.equal(network.input_weights, again.input_weights)
    assert torch.equal(network.input_weights, larger.input_weights[:4])
    for k in range(4):
        assert torch.equal(network.drawn(k), network.input_weights[k])
    others = [
        HullRudder(HullRudderSettings(6, 1), seed=seed).drawn(k, trial)
        for seed in (5, 6)
        for k in (0, 1)
        for trial in (0, 1, 2)
    ]
    others += [HullRudder(HullRudderSettings(6, 1), seed=MAX_SEED - k).drawn(0) for k in (0, 1)]  # of the largest, too
    free = [weights[network.sees] for weights in others]
    assert all((a != b).all() for a, b in itertools.combinations(free, 2))
    assert network.output_weights.abs().max() == 0.0


def test_first_weights_spread_as_asked():
    many = HullRudder(HullRudderSettings(200, 20, modular=False, spread=0.6))
    drawn = many.input_weights.detach()
    assert float(drawn.mean()) == pytest.approx(0.0, abs=0.02)
    assert float(drawn.std()) == pytest.approx(0.6, rel=0.02)
    half, whole = (HullRudder(HullRudderSettings(4, 1, spread=spread)).input_weights for spread in (0.3, 0.6))
    torch.testing.assert_close(2 * half, whole)


@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_single_precision_stays_single_and_agrees(law):
    network, x = made(speed_law=law, library="quadratic"), points()
    single = HullRudder(
        HullRudderSettings(5, 3, spread=0.8, speed_law=law, library="quadratic"), seed=3, dtype=torch.float32
    )
    assert torch.equal(single.input_weights, network.input_weights.float())
    single.output_weights.data.copy_(network.output_weights)
    y = single(x.float())
    assert y.dtype == single.drawn(0).dtype == torch.float32
    torch.testing.assert_close(y.double(), network(x), rtol=1e-4, atol=1e-4)
    assert single.at_shaft(0.5)(x.float()).dtype == torch.float32
    assert single.double()(x).dtype == torch.float64


@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_a_state_that_is_stored_is_the_network_again(law, tmp_path):
    network, x = made(speed_law=law), points()
    network.trained.fill_(2)
    network = network.at_shaft(0.8)
    torch.save(network.state_dict(), tmp_path / "network.pt")
    other = HullRudder(HullRudderSettings(5, 3, speed_law=law), seed=99)
    other.load_state_dict(torch.load(tmp_path / "network.pt", weights_only=True))
    assert torch.equal(other(x), network(x)) and int(other.trained) == 2
    assert float(other.shaft) == (0.8 if law == "shaft" else 1.0)


def test_gradients_reach_the_inputs():
    network, x = made(), points(2).requires_grad_()
    with unchecked():
        assert torch.autograd.gradcheck(network, (x,))


def test_scalings_that_fit_are_named():
    assert made(speed_law="approach").scalings == ("mirrored",)
    assert made(speed_law="shaft").scalings == ("speed",)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"hidden": 1}, "network.hidden=1, network.members=16: expected at least 2 nodes, 1 member"),
        ({"members": 0}, "network.hidden=12, network.members=0: expected at least 2 nodes, 1 member"),
        ({"spread": 0.0}, "network.spread=0.0: expected a standard deviation, more than 0"),
        ({"spread": float("nan")}, "network.spread=nan: expected a standard deviation, more than 0"),
        ({"shrink": -0.1}, "network.shrink=-0.1: expected a ridge, 0 or more"),
        ({"shrink": float("nan")}, "network.shrink=nan: expected a ridge, 0 or more"),
        ({"speed_law": "froude"}, "network.speed_law 'froude' is unknown; choose one of: approach, shaft"),
        ({"library": "cubic"}, "network.library 'cubic' is unknown; choose one of: none, linear, quadratic"),
    ],
)
def test_settings_that_make_no_sense_are_refused_in_one_line(settings, told):
    with unchecked(), pytest.raises(InputError) as refusal:
        HullRudder(HullRudderSettings(**settings))
    assert str(refusal.value) == told
