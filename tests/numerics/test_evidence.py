import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from manoeuvre_nn.numerics.evidence import WeightDecay, nothing_shrunk


def linear(count: int = 60, weights: int = 5, noise: float = 0.3):
    """A linear model: design (1, n, p) and targets (1, n)."""
    generator = torch.Generator().manual_seed(3)
    a = torch.randn(1, count, weights, generator=generator, dtype=torch.float64)
    w = torch.tensor([[0.5, -0.4, 0.3, 0.0, 0.1]], dtype=torch.float64)[:, :weights]
    y = (a @ w[..., None])[..., 0] + noise * torch.randn(1, count, generator=generator, dtype=torch.float64)
    return a, y


def solved(a, y, prior: WeightDecay):
    normal, gradient = prior.normal_equations(a.mT @ a, -(a.mT @ y[..., None])[..., 0], torch.zeros_like(a[:, 0]))
    w = -torch.linalg.solve(normal, gradient)
    return w, (a @ w[..., None])[..., 0] - y


def at_rest(a, y) -> WeightDecay:
    prior = nothing_shrunk(a[:, 0])
    for _ in range(200):
        w, e = solved(a, y, prior)
        prior = prior.again(a.mT @ a, e, w)
    return prior


def marginal(a, y, alpha: float, beta: float) -> float:
    """Log density of the data, the weights integrated out by hand."""
    design = a[0].numpy()
    covariance = np.eye(len(design)) / beta + design @ design.T / alpha
    return float(multivariate_normal(np.zeros(len(design)), covariance).logpdf(y[0].numpy()))


def test_the_evidence_of_a_linear_model_is_the_density_of_its_data():
    a, y = linear()
    one = torch.ones(1, dtype=torch.float64)
    prior = WeightDecay(2.5 * one, 7.0 * one, one)
    w, e = solved(a, y, prior)
    assert float(prior.log_evidence(a.mT @ a, e, w)) == pytest.approx(marginal(a, y, 2.5, 7.0), rel=1e-10)


def test_prior_and_noise_come_to_rest_where_the_data_are_most_likely():
    a, y = linear()
    prior = at_rest(a, y)
    best = minimize(lambda z: -marginal(a, y, *np.exp(z)), [0.0, 0.0], method="Nelder-Mead",
                    options={"xatol": 1e-8, "fatol": 1e-10})  # fmt: skip
    assert [float(prior.alpha), float(prior.beta)] == pytest.approx(list(np.exp(best.x)), rel=1e-4)


def test_effective_weights_are_the_trace_of_the_hat_matrix():
    a, y = linear()
    prior = at_rest(a, y)
    inner = torch.linalg.inv(a.mT @ a + prior.ratio * torch.eye(5, dtype=torch.float64))
    assert float(prior.effective) == pytest.approx(float((a @ inner @ a.mT)[0].trace()), rel=1e-9)
    assert 3 < float(prior.effective) < 5


def test_stacked_residuals_have_the_normal_equations():
    a, y = linear()
    prior, w = at_rest(a, y), torch.ones(1, 5, dtype=torch.float64)
    e = (a @ w[..., None])[..., 0] - y
    rows = prior.residuals(e, w)
    stacked = torch.cat([a, prior.ratio.sqrt() * torch.eye(5, dtype=torch.float64)[None]], 1)
    normal, gradient = prior.normal_equations(a.mT @ a, (a.mT @ e[..., None])[..., 0], w)
    torch.testing.assert_close(normal, stacked.mT @ stacked)
    torch.testing.assert_close(gradient, (stacked.mT @ rows[..., None])[..., 0])


def test_weights_that_no_datum_determines_do_not_count_and_more_weights_than_data_are_no_obstacle():
    a, y = linear()
    a = torch.cat([a, 0 * a[..., :1]], 2)
    prior = nothing_shrunk(a[:, 0])
    w = torch.ones(1, 6, dtype=torch.float64)
    assert float(prior.again(a.mT @ a, (a @ w[..., None])[..., 0] - y, w).effective) == 5
    few, values = a[:, :3], y[:, :3]
    found = prior.again(few.mT @ few, (few @ w[..., None])[..., 0] - values, w)
    assert torch.isfinite(torch.stack([found.alpha, found.beta])).all()
    assert float(found.beta) > 0


def test_a_problem_whose_errors_are_no_numbers_does_not_stop_the_others():
    a, y = linear()
    both, targets = torch.cat([a, a * torch.nan]), torch.cat([y, y])
    w = torch.ones(2, 5, dtype=torch.float64)
    prior = nothing_shrunk(w)
    found = prior.again(both.mT @ both, (both @ w[..., None])[..., 0] - targets, w)
    alone = nothing_shrunk(w[:1]).again(a.mT @ a, (a @ w[:1, :, None])[..., 0] - y, w[:1])
    assert float(found.alpha[0]) == pytest.approx(float(alone.alpha[0]))
    assert (float(found.alpha[1]), float(found.beta[1])) == (0.0, 1.0)
