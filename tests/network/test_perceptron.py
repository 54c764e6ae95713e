"""The perceptrons against their equations, autograd and one another."""

import pytest
import torch
from fleet import unchecked
from torch.func import functional_call, jacrev, stack_module_state, vmap

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron, rajesh_network, wang_network


def points(count: int = 7, inputs: int = 4, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(5)
    return torch.randn(count, inputs, generator=generator, dtype=torch.float64).to(dtype)


@pytest.mark.parametrize(
    ("activation", "f"), [("sigmoid", lambda m: 1 / (1 + (-m).exp())), ("tanh", lambda m: m.sinh() / m.cosh())]
)
def test_the_outputs_are_the_weighted_sum_of_the_squashed_sums(activation, f):
    network = Perceptron((2, 3, 5, 2), activation=activation, initial="symmetric", seed=3)
    x, w, b = points(4, 3), network.input_weights, network.output_weights
    for k in range(2):
        for n in range(4):
            nodes = [f(sum(w[k, i, j] * x[n, j] for j in range(3)) + w[k, i, 3]) for i in range(5)]
            for o in range(2):
                expected = sum(b[k, o, i] * nodes[i] for i in range(5)) + b[k, o, 5]
                assert torch.isclose(network(x)[n, 2 * k + o], expected, rtol=1e-12)


def test_rows_are_the_same_outputs_sorted_by_network():
    network = Perceptron((3, 4, 6, 2), seed=1)
    x = points()
    side_by_side = network(x).reshape(7, 3, 2).movedim(1, 0)
    torch.testing.assert_close(network.rows(x), side_by_side, rtol=1e-13, atol=1e-13)


def test_leading_dimensions_of_the_inputs_are_kept():
    network = wang_network(seed=2)
    x = points(12)
    torch.testing.assert_close(network(x.reshape(3, 4, 4)), network(x).reshape(3, 4, 3), rtol=0, atol=1e-14)
    torch.testing.assert_close(network(x[0]), network(x)[0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("activation", ["sigmoid", "tanh"])
@pytest.mark.parametrize(("networks", "outputs"), [(1, 1), (3, 1), (1, 3), (2, 3)])
def test_the_analytic_jacobian_is_autograds(activation, networks, outputs):
    network = Perceptron((networks, 4, 5, outputs), activation=activation, initial="symmetric", seed=8)
    x = points(6)
    for k in range(networks):
        weights = {name: p.detach().clone() for name, p in network.named_parameters()}

        def row(first, last, k=k, weights=weights):
            changed = {
                "input_weights": weights["input_weights"].index_put((torch.tensor(k),), first),
                "output_weights": weights["output_weights"].index_put((torch.tensor(k),), last),
            }
            y = functional_call(network, changed, (x,)).reshape(6, networks, outputs)
            return y[:, k].flatten()

        by_autograd = jacrev(row, argnums=(0, 1))(weights["input_weights"][k], weights["output_weights"][k])
        expected = torch.cat([part.flatten(1) for part in by_autograd], 1)
        torch.testing.assert_close(network.jacobian(x)[k], expected, rtol=1e-12, atol=1e-13)


def test_forward_works_under_functional_call_and_vmap():
    networks = [rajesh_network(6, seed=seed) for seed in range(4)]
    parameters, buffers = stack_module_state(networks)
    x = points()
    together = vmap(lambda p, b: functional_call(networks[0], (p, b), (x,)))(parameters, buffers)
    for network, y in zip(networks, together, strict=True):
        torch.testing.assert_close(y, network(x), rtol=1e-12, atol=1e-13)


def test_wangs_m_counts_sigmoids_alone():
    network = wang_network(hidden=11)
    assert network.input_weights.shape == (3, 11, 5)
    assert network.output_weights.shape == (3, 1, 12)
    assert network.rows_count == 3


def test_rajeshs_m_counts_the_bias_node():
    network = rajesh_network(hidden=15)
    assert network.input_weights.shape == (1, 14, 5)
    assert network.output_weights.shape == (1, 3, 15)
    assert network(points()).shape == (7, 3)


@pytest.mark.parametrize(
    ("initial", "low", "high", "mean", "deviation"),
    [("uniform", 0, 1, 0.5, 12**-0.5), ("symmetric", -1, 1, 0.0, 3**-0.5), ("normal", -9, 9, 0.0, 0.3)],
)
def test_first_weights_have_the_distribution_that_was_asked_for(initial, low, high, mean, deviation):
    network = Perceptron((4, 4, 500, 5), initial=initial, spread=0.3, seed=4)
    for weights in network.parameters():
        assert low <= weights.min() and weights.max() < high
        assert abs(weights.mean() - mean) < 0.05 * deviation
        assert abs(weights.std() / deviation - 1) < 0.05


def test_the_papers_networks_start_as_the_papers_say():
    assert min(p.min() for p in wang_network(seed=1).parameters()) >= 0
    assert min(p.min() for p in rajesh_network(seed=1).parameters()) < -0.5


def test_the_seed_alone_decides_the_first_weights():
    torch.manual_seed(1)
    first = wang_network(seed=7)
    torch.manual_seed(2)
    state = torch.get_rng_state()
    again, other = wang_network(seed=7), wang_network(seed=8)
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.equal(first.input_weights, again.input_weights)
    assert not torch.equal(first.input_weights, other.input_weights)


def test_single_precision_starts_at_the_rounded_weights_and_stays_single():
    single, double = (rajesh_network(seed=3, dtype=dtype) for dtype in (torch.float32, torch.float64))
    assert torch.equal(single.input_weights, double.input_weights.float())
    x = points(dtype=torch.float32)
    assert single(x).dtype == single.rows(x).dtype == single.jacobian(x).dtype == torch.float32


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: wang_network(hidden=0), "network.hidden=0"),
        (lambda: rajesh_network(hidden=1), "network.hidden=1"),
        (lambda: Perceptron((3, 0, 11, 1)), "at least 1"),
        (lambda: Perceptron((0, 4, 5, 1)), "at least 1"),
        (lambda: wang_network(activation="relu"), "sigmoid, tanh"),
        (lambda: wang_network(initial="xavier"), "uniform, symmetric, normal"),
        (lambda: wang_network(initial="normal", spread=0.0), "network.spread=0.0"),
    ],
)
def test_a_bad_setting_is_refused_in_one_line(make, word):
    with unchecked(), pytest.raises(InputError, match=word) as caught:
        make()
    assert "\n" not in str(caught.value)
