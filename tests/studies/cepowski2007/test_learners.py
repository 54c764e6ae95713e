"""Every way to learn, where the answer is known."""

from functools import partial

import numpy as np
import pytest
from fleet import unchecked
from tiers import only

from studies.cepowski2007 import learners, packages
from studies.cepowski2007.perceptrons import Structure, train_perceptrons

X = np.random.default_rng(0).uniform(-1.6, 1.6, (300, 2))
AT = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 2))
ALL = {
    "perceptron": (learners.PAPERS, 0.01),
    "shrunk": (learners.RECOMMENDED, 0.01),
    "back-propagation": (partial(learners.back_propagation, hidden=7), 0.3),
    "RBF": (partial(learners.radial_basis, hidden=100), 0.02),
    "GRNN": (learners.general_regression, 0.2),
    "polynomial": (learners.polynomial, 0.1),
    "trees": (packages.boosted_trees, 0.2),
    "Gaussian process": (packages.gaussian_process, 0.01),
}


@pytest.fixture(autouse=True)
def fast(monkeypatch):
    monkeypatch.setattr(learners, "DESCENT_STEPS", 1500)
    with unchecked():  # thousands of steps
        yield


def smooth(x):
    return np.sin(2 * x[:, 0]) + 0.5 * x[:, 1] ** 2


@pytest.mark.parametrize("name", only(set(ALL) - {"back-propagation", "trees", "shrunk"}, ALL))
def test_a_smooth_function_is_learnt_and_the_seed_settles_everything(name):
    learn, error = ALL[name]
    found = learn(X, smooth(X), 3)(AT)
    assert np.sqrt(np.mean((found - smooth(AT)) ** 2)) < error
    np.testing.assert_array_equal(found, learn(X, smooth(X), 3)(AT))


@pytest.mark.parametrize("name", ["GRNN", "polynomial", "Gaussian process"])
def test_the_order_of_the_records_is_of_no_account(name):
    learn, _ = ALL[name]
    order = np.random.default_rng(2).permutation(len(X))
    np.testing.assert_allclose(learn(X, smooth(X), 0)(AT), learn(X[order], smooth(X)[order], 0)(AT), atol=2e-3)


def test_a_polynomial_is_learnt_exactly():
    def cubic(x):
        return 1 + x[:, 0] * x[:, 1] ** 2 - 2 * x[:, 0]

    np.testing.assert_allclose(learners.polynomial(X[:60], cubic(X[:60]), 0)(AT), cubic(AT), atol=1e-9)


def test_few_records_get_a_simple_polynomial():
    noise = np.random.default_rng(3).normal(size=12)
    found = learners.polynomial(X[:12], X[:12, 0] + 0.3 * noise, 0)(AT)
    assert np.linalg.matrix_rank(np.column_stack([np.ones(200), AT])) == 3
    np.testing.assert_allclose(np.column_stack([np.ones(200), AT]) @ np.linalg.lstsq(
        np.column_stack([np.ones(200), AT]), found, rcond=None)[0], found, atol=1e-9)  # fmt: skip


def test_the_best_start_is_taken():
    network, errors = train_perceptrons(X, smooth(X), Structure(hidden=3, starts=4), seed=5)
    assert len(set(errors.round(9))) > 1
    found = learners.perceptron(X, smooth(X), 5, structure=Structure(hidden=3, starts=4))(X)
    assert np.mean((found - smooth(X)) ** 2) == pytest.approx(errors.min())
    assert network.rows_count == 4


def test_a_ridge_shrinks_weights():
    sizes = []
    for ridge in (0.0, 10.0):
        network, _ = train_perceptrons(X, smooth(X), Structure(ridge=ridge), seed=1)
        sizes.append(sum(float(p.detach().square().sum()) for p in network.parameters()))
    assert sizes[1] < 0.5 * sizes[0]


@pytest.mark.skipif(not packages.has_symbolic_regression(), reason="pyoperon is not installed")
def test_a_formula_is_found():
    def formula(x):
        return x[:, 0] * x[:, 1]

    np.testing.assert_allclose(packages.symbolic_regression(X, formula(X), 0, length=10)(AT), formula(AT), atol=1e-3)
