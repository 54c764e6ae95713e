"""Normal equations by blocks against those of the dense Jacobian."""

import pytest
import torch
from fleet import unchecked
from levenberg import lm

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.least_squares import gram
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import minimise

ROWS, SAMPLES, HIDDEN = 3, 37, 5  # a number of samples that no processor likes


def given(
    outputs: int = 3, activation: str = "tanh", own: bool = False
) -> tuple[Perceptron, torch.Tensor, torch.Tensor]:
    network = Perceptron((ROWS, 4, HIDDEN, outputs), activation=activation, initial="symmetric", seed=4)
    generator = torch.Generator().manual_seed(7)
    x = torch.randn(SAMPLES, 4, generator=generator, dtype=torch.float64)
    y = torch.randn(ROWS if own else 1, SAMPLES, outputs, generator=generator, dtype=torch.float64)
    return network, x, y if own else y[0]


def flat(network: Perceptron) -> torch.Tensor:
    return torch.cat([p.detach().flatten(1) for p in network.parameters()], 1)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid"])
@pytest.mark.parametrize("outputs", [1, 3])
@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("max_elements", [2e7, 1e3, 1.0])
def test_blocks_give_the_products_of_the_dense_jacobian(activation, outputs, own, max_elements):
    network, x, y = given(outputs, activation, own)
    problem = OneHidden(x, y, HIDDEN, activation=activation, max_elements=max_elements)
    mse, carry = problem.evaluate(flat(network))
    normal, gradient = problem.linearise(flat(network), carry)
    jacobian, errors = network.jacobian(x), (network.rows(x) - y).detach().flatten(1)
    torch.testing.assert_close(mse, errors.square().mean(1), rtol=1e-13, atol=0)
    torch.testing.assert_close(normal, jacobian.mT @ jacobian, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(gradient, (jacobian.mT @ errors[..., None])[..., 0], rtol=1e-12, atol=1e-12)


def test_products_of_rows_on_another_device_stay_there():
    products = gram(torch.empty(ROWS, HIDDEN, SAMPLES, device="meta"))
    assert products.shape == (ROWS, HIDDEN, HIDDEN) and products.device.type == "meta"


def test_some_rows_of_a_problem_are_the_problem_of_those_rows():
    network, x, y = given(own=True)
    rows = torch.tensor([2, 0])
    whole = OneHidden(x, y, HIDDEN, activation="tanh")
    for all_, some in zip(
        whole.normal_equations(flat(network)), whole.take(rows).normal_equations(flat(network)[rows]), strict=True
    ):
        torch.testing.assert_close(all_[rows], some, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("damping", ["trainlm", "nielsen"])
def test_the_optimizer_walks_the_same_way_with_either(damping):
    ends = []
    for structured in (True, False):
        network, x, y = given(own=True)
        problem = OneHidden(x, y, HIDDEN, activation="tanh")
        way = {"jacobian": lambda network=network, x=x: network.jacobian(x)}
        if structured:
            way = {"normal": lambda problem=problem, network=network: problem.normal_equations(flat(network))}
        optimizer = lm(network.parameters(), rows=ROWS, damping=damping, **way)
        with unchecked():
            for _ in range(4):
                optimizer.step(lambda network=network, x=x, y=y: (network.rows(x) - y).flatten(1))
        ends.append(flat(network))
    torch.testing.assert_close(ends[0], ends[1], rtol=1e-8, atol=1e-9)


def test_what_does_not_fit_together_is_refused():
    network, x, y = given()
    with unchecked(), pytest.raises(InputError, match="36 targets"):
        OneHidden(x, y[1:], HIDDEN)
    with pytest.raises(InputError, match="sigmoid, tanh"):
        OneHidden(x, y, HIDDEN, activation="relu")
    with unchecked(), pytest.raises(InputError, match="expected one of them"):
        lm(network.parameters(), jacobian=lambda: x, normal=lambda: (x, y))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_gram_matrix_is_the_product_with_the_transpose(dtype):
    generator = torch.Generator().manual_seed(1)
    rows = torch.randn(3, 7, 40, generator=generator, dtype=dtype, requires_grad=True)
    for part in (rows, rows[:, ::2], rows[:0]):
        found = gram(part)
        assert found.dtype == dtype and not found.requires_grad
        torch.testing.assert_close(found, (part @ part.mT).detach())
        assert torch.equal(found, found.mT)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid"])
def test_networks_of_several_sizes_are_one_batch(activation):
    """Each row goes its way as if it were alone and had no more nodes; its silent nodes stay as they were."""
    _, x, y = given(activation=activation)
    network = Perceptron((4, 4, HIDDEN, 3), activation=activation, initial="symmetric", seed=4)
    start, sizes = flat(network), torch.tensor([2, HIDDEN, 3, 2])
    stops = Stops(epochs=6)
    with unchecked():
        whole = minimise(OneHidden(x, y, HIDDEN, activation=activation, sizes=sizes), start, stops=stops)
        for k, size in enumerate(sizes.tolist()):
            full = OneHidden(x, y, HIDDEN, activation=activation)
            inner, outer = full.split(start[k : k + 1])
            less = torch.cat([inner[:, :size].flatten(1), outer[..., [*range(size), HIDDEN]].flatten(1)], 1)
            alone = minimise(OneHidden(x, y, size, activation=activation), less, stops=stops)
            assert float(whole.mse[k]) == pytest.approx(float(alone.mse), rel=1e-6)
            assert int(whole.epochs[k]) == int(alone.epochs)
            found = full.split(whole.weights[k : k + 1])
            assert torch.equal(found[0][:, size:], inner[:, size:])
            assert torch.equal(found[1][..., size:HIDDEN], outer[..., size:HIDDEN])
    assert len(set(whole.mse.tolist())) == 4
    with pytest.raises(InputError, match="sizes from 0 to 6: expected from 1 to 5 nodes"):
        OneHidden(x, y, HIDDEN, sizes=torch.tensor([0, 6]))
