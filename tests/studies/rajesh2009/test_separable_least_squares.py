"""Variable projection against differences, against the full problem and against plain least squares."""

import pytest
import torch

from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import minimise
from studies.rajesh2009.separable import Separable

SAMPLES, HIDDEN = 61, 4


def data() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(3)
    x = 2 * torch.rand(SAMPLES, 2, generator=generator, dtype=torch.float64) - 1
    a, b = x.T
    return x, torch.stack([torch.sin(2 * a + b), a * b, torch.exp(-b)], 1)


def weights(rows: int = 2, activation: str = "tanh") -> torch.Tensor:
    network = Perceptron((rows, 2, HIDDEN, 3), activation=activation, initial="normal", spread=1.5, seed=1)
    return network.input_weights.detach().flatten(1)


def errors(problem: Separable, w: torch.Tensor) -> torch.Tensor:
    return problem.evaluate(w)[1][-1].flatten(1)


def differences(problem: Separable, w: torch.Tensor) -> torch.Tensor:
    """Jacobian of the projected errors by central differences."""
    h = 1e-6
    moves = h * torch.eye(w.shape[1], dtype=w.dtype)
    return torch.stack([(errors(problem, w + move) - errors(problem, w - move)) / (2 * h) for move in moves], -1)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid"])
@pytest.mark.parametrize("kaufman", [False, True])
def test_the_gradient_is_that_of_the_projected_error(activation, kaufman):
    x, y = data()
    problem, w = Separable(x, y, HIDDEN, activation=activation, kaufman=kaufman), weights(activation=activation)
    mse, carry = problem.evaluate(w)
    _, gradient = problem.linearise(w, carry)
    h = 1e-6
    for k, move in enumerate(h * torch.eye(w.shape[1], dtype=w.dtype)):
        slope = (problem.evaluate(w + move)[0] - problem.evaluate(w - move)[0]) / (2 * h)
        torch.testing.assert_close(2 / problem.residuals * gradient[:, k], slope, rtol=1e-5, atol=1e-9)
    assert (mse > 0).all()


def test_golub_and_pereyras_products_are_those_of_the_projected_errors():
    x, y = data()
    problem, w = Separable(x, y, HIDDEN, activation="tanh", kaufman=False), weights()
    normal, _ = problem.linearise(w, problem.evaluate(w)[1])
    jacobian = differences(problem, w)
    torch.testing.assert_close(normal, jacobian.mT @ jacobian, rtol=1e-5, atol=1e-6)


def test_kaufmans_products_are_the_full_ones_with_the_output_weights_eliminated():
    x, y = data()
    w = weights()
    problem, full = Separable(x, y, HIDDEN, activation="tanh"), OneHidden(x, y, HIDDEN, activation="tanh")
    normal, gradient = problem.linearise(w, problem.evaluate(w)[1])
    whole, slope = full.normal_equations(torch.cat([w, problem.output_weights(w).flatten(1)], 1))
    inner = problem.parameters
    mixed = whole[:, :inner, inner:]
    reduced = whole[:, :inner, :inner] - mixed @ torch.linalg.solve(whole[:, inner:, inner:], mixed.mT)
    torch.testing.assert_close(normal, reduced, rtol=1e-7, atol=1e-8)
    torch.testing.assert_close(gradient, slope[:, :inner], rtol=1e-8, atol=1e-9)
    assert slope[:, inner:].abs().max() < 1e-9  # the output weights are the best ones


def test_output_weights_are_those_of_plain_least_squares():
    x, y = data()
    problem, w = Separable(x, y, HIDDEN, activation="tanh"), weights(1)
    network = Perceptron((1, 2, HIDDEN, 3), activation="tanh")
    network.input_weights.data = w.unflatten(1, (HIDDEN, 3))
    nodes = torch.tanh(x @ w.reshape(HIDDEN, 3)[:, :2].T + w.reshape(HIDDEN, 3)[:, 2])
    best = torch.linalg.lstsq(torch.cat([nodes, torch.ones(SAMPLES, 1, dtype=x.dtype)], 1), y).solution
    torch.testing.assert_close(problem.output_weights(w)[0], best.T, rtol=1e-8, atol=1e-9)
    network.output_weights.data = problem.output_weights(w)
    torch.testing.assert_close(
        problem.evaluate(w)[0], (network.rows(x) - y).detach().square().mean()[None], rtol=1e-10, atol=0
    )


@pytest.mark.parametrize("kaufman", [False, True])
def test_nodes_that_saturate_or_run_together_do_no_harm(kaufman):
    x, y = data()
    w = weights(1)
    w[:, :3] = torch.tensor([0.0, 0.0, 50.0])  # always 1, as the bias is
    w[:, 3:6] = w[:, 6:9]  # the same node twice
    problem = Separable(x, y, HIDDEN, activation="tanh", kaufman=kaufman)
    mse, carry = problem.evaluate(w)
    assert all(part.isfinite().all() for part in problem.linearise(w, carry))
    found = minimise(problem, w, stops=Stops(epochs=30))
    assert float(found.mse) < (0.5 if kaufman else 1.0) * float(mse)


@pytest.mark.parametrize("kaufman", [False, True])
def test_a_map_of_as_many_nodes_is_found_again(kaufman):
    x, _ = data()
    true = Perceptron((1, 2, HIDDEN, 3), activation="tanh", initial="symmetric", seed=8)
    y = true(x).detach()
    start = true.input_weights.detach().flatten(1) + 0.1 * torch.cos(torch.arange(12.0, dtype=torch.float64))
    found = minimise(Separable(x, y, HIDDEN, activation="tanh", kaufman=kaufman), start, stops=Stops(epochs=60))
    torch.testing.assert_close(found.weights, true.input_weights.detach().flatten(1), rtol=1e-5, atol=1e-6)
    assert float(found.mse) < 1e-16
