"""Block tridiagonal normal equations against dense algebra."""

import numpy as np
import pytest

from manoeuvre_nn.numerics.chain import Chain


@pytest.fixture(params=[(1, 3), (2, 1), (7, 3), (5, 9)])
def system(request):
    n, k = request.param
    rng = np.random.default_rng(0)
    dense = np.zeros((n * k, n * k))
    for block in range(n):
        width = min(2, n - block) * k
        factor = rng.standard_normal((width, width + 2))
        dense[block * k : block * k + width, block * k : block * k + width] += factor @ factor.T
    blocks = dense.reshape(n, k, n, k).transpose(0, 2, 1, 3)
    on = np.stack([blocks[i, i] for i in range(n)])
    below = np.stack([blocks[i + 1, i] for i in range(n - 1)]) if n > 1 else np.zeros((0, k, k))
    return Chain(on, below), dense


def test_solutions_and_determinant_are_those_of_the_dense_matrix(system):
    chain, dense = system
    right = np.random.default_rng(1).standard_normal((chain.samples, chain.size, 2))
    solved = chain.unwhiten(chain.whiten(right)).reshape(-1, 2)
    np.testing.assert_allclose(solved, np.linalg.solve(dense, right.reshape(-1, 2)), atol=1e-9)
    assert chain.log_det == pytest.approx(np.linalg.slogdet(dense)[1])


def test_no_right_hand_side_has_no_solution(system):
    chain, _ = system
    none = np.zeros((chain.samples, chain.size, 0))
    assert chain.whiten(none).shape == (chain.samples * chain.size, 0)
    assert chain.unwhiten(chain.whiten(none)).shape == none.shape


def test_whitened_vectors_have_the_inner_products_of_the_inverse(system):
    chain, dense = system
    right = np.random.default_rng(2).standard_normal((chain.samples, chain.size, 3))
    white, flat = chain.whiten(right), right.reshape(-1, 3)
    np.testing.assert_allclose(white.T @ white, flat.T @ np.linalg.inv(dense) @ flat, rtol=1e-9)


def test_covariances_are_the_blocks_of_the_inverse(system):
    chain, dense = system
    n, k = chain.samples, chain.size
    inverse = np.linalg.inv(dense).reshape(n, k, n, k).transpose(0, 2, 1, 3)
    on, below = chain.covariances
    for i in range(n):
        np.testing.assert_allclose(on[i], inverse[i, i], atol=1e-9)
    for i in range(n - 1):
        np.testing.assert_allclose(below[i], inverse[i + 1, i], atol=1e-9)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        Chain(-np.eye(2)[None], np.zeros((0, 2, 2)))


def test_no_right_hand_side_gives_no_solution(system):
    chain, _ = system
    none = np.zeros((chain.samples, chain.size, 0))
    assert chain.unwhiten(chain.whiten(none)).shape == none.shape
