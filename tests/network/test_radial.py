import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network import radial
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.numerics.radial_basis import neighbour_distances, ridge_by_press


def drawn(*shape: int, seed: int = 0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def fitted() -> RadialBasis:
    network, x = RadialBasis(3, 10, 2), drawn(40, 3)
    network.place(x)
    network.widths.copy_(neighbour_distances(network.centres, 2))
    network.output_weights.copy_(ridge_by_press(network.nodes(x), drawn(40, 2, seed=1), [1e-6]).weights)
    return network


def stored(count: int = 40) -> GeneralRegression:
    network = GeneralRegression(3, 2)
    network.store(drawn(count, 3), drawn(count, 2, seed=1), torch.tensor([0.5, 0.6, 0.7], dtype=torch.float64))
    return network


def test_outputs_of_radial_basis_functions_are_their_formula():
    network, x = fitted(), drawn(3, seed=2)
    nodes = torch.exp(-(x - network.centres).square().sum(1) / (2 * network.widths**2))
    expected = network.output_weights[:, :-1] @ nodes + network.output_weights[:, -1]
    torch.testing.assert_close(network(x), expected)


@pytest.mark.parametrize("make", [fitted, stored])
def test_any_leading_dimensions_and_any_memory_give_the_same(make, monkeypatch):
    network, x = make(), drawn(4, 5, 3, seed=3)
    whole = network(x)
    assert whole.shape == (4, 5, 2)
    monkeypatch.setattr(radial, "MAX_ELEMENTS", 100)
    torch.testing.assert_close(network(x), whole)


@pytest.mark.parametrize("make", [lambda: RadialBasis(3, 10, 2), lambda: GeneralRegression(3, 2)])
def test_an_untrained_network_answers_0(make):
    assert not make()(drawn(5, 3)).any()


@pytest.mark.parametrize(
    ("full", "empty"), [(fitted, lambda: RadialBasis(3, 10, 2)), (stored, lambda: GeneralRegression(3, 2))]
)
def test_a_checkpoint_brings_all_that_the_network_has_learnt(full, empty):
    network, other, x = full(), torch.nn.Sequential(empty()), drawn(6, 3, seed=4)
    other.load_state_dict(torch.nn.Sequential(network).state_dict())
    assert torch.equal(other(x), network(x))


def test_records_of_other_inputs_are_refused():
    with pytest.raises(RuntimeError, match="size mismatch"):
        GeneralRegression(4, 2).load_state_dict(stored().state_dict())


@pytest.mark.parametrize("make", [lambda: RadialBasis(0), lambda: RadialBasis(3, 0), lambda: GeneralRegression(3, 0)])
def test_networks_of_nothing_are_refused(make):
    with pytest.raises(InputError, match="at least 1"):
        make()


def test_types_are_kept():
    network = GeneralRegression(3, 1, dtype=torch.float32)
    network.store(drawn(5, 3), drawn(5, 1), torch.ones(3, dtype=torch.float64))
    assert network(drawn(2, 3).float()).dtype == RadialBasis(3, 5, 1, dtype=torch.float32)(drawn(2, 3).float()).dtype
