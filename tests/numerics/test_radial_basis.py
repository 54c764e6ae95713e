import math

import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.radial_basis import (
    gaussian_nodes,
    k_means,
    neighbour_distances,
    ridge_by_press,
    squared_distances,
)

DOUBLE = {"dtype": torch.float64}


def drawn(*shape: int, seed: int = 0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), **DOUBLE)


def test_nodes_are_gaussian():
    centres, widths = torch.tensor([[0.0, 0.0], [3.0, 4.0]], **DOUBLE), torch.tensor([1.0, 5.0], **DOUBLE)
    found = gaussian_nodes(torch.zeros(1, 2, **DOUBLE), centres, widths)
    assert found[0].tolist() == pytest.approx([1.0, math.exp(-0.5)])


def test_k_means_finds_separate_clusters_from_any_start():
    middles = torch.tensor([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]], **DOUBLE)
    x = (middles[:, None] + 0.1 * drawn(3, 50, 2)).reshape(-1, 2)
    means = x.reshape(3, 50, 2).mean(1)
    for seed in range(5):
        found = k_means(x, 3, seed=seed)
        assert torch.cdist(means, found).min(1).values.max() < 1e-12


def test_as_many_centres_as_points_are_the_points():
    x = drawn(12, 2)
    assert torch.cdist(x, k_means(x, 12)).min(1).values.max() < 1e-7


def test_centres_of_repeated_points_are_among_them():
    x = torch.ones(6, 2, **DOUBLE)
    assert torch.equal(k_means(x, 3), torch.ones(3, 2, **DOUBLE))
    assert torch.equal(neighbour_distances(x, 2), torch.ones(6, **DOUBLE))


@pytest.mark.parametrize("count", [0, 7])
def test_more_centres_than_records_are_refused(count):
    with pytest.raises(InputError, match="expected from 1 to 6"):
        k_means(drawn(6, 2), count)


def test_distances_are_those_to_the_nearest_others():
    centres = torch.tensor([[0.0], [1.0], [3.0]], **DOUBLE)
    found = neighbour_distances(centres, 2)
    torch.testing.assert_close(found, torch.tensor([(1 + 9) / 2, (1 + 4) / 2, (4 + 9) / 2], **DOUBLE).sqrt())
    assert neighbour_distances(centres[:1], 2) == 1.0


def test_a_node_at_every_record_interpolates():
    x, y = drawn(25, 2), drawn(25, 1, seed=1)
    nodes = gaussian_nodes(x, x, neighbour_distances(x, 2))
    found = ridge_by_press(nodes, y, [0.0])
    torch.testing.assert_close(nodes @ found.weights[:, :-1].mT + found.weights[:, -1], y, atol=1e-7, rtol=0)
    assert found.mse < 1e-14


@pytest.mark.parametrize("ridge", [0.0, 0.03])
def test_press_is_the_error_of_fits_without_the_record(ridge):
    nodes, y = drawn(30, 4), drawn(30, 2, seed=1)
    found = ridge_by_press(nodes, y, [ridge])

    def fitted(a, b):
        """Weights by the normal equations, the bias last and not shrunk."""
        a = torch.cat([a, torch.ones(len(a), 1, **DOUBLE)], 1)
        system = a.mT @ a + found.ridge * torch.diag(torch.tensor([1.0, 1, 1, 1, 0], **DOUBLE))
        return torch.linalg.solve(system, a.mT @ b)

    wrong = []
    for k in range(30):
        kept = torch.arange(30) != k
        weights = fitted(nodes[kept], y[kept])
        wrong.append(nodes[k] @ weights[:-1] + weights[-1] - y[k])
    assert found.press == pytest.approx(float(torch.stack(wrong).square().mean()), rel=1e-9)
    torch.testing.assert_close(found.weights, fitted(nodes, y).mT)


def test_the_ridge_is_chosen_that_foretells_best():
    nodes, y = drawn(40, 30), drawn(40, 1, seed=1)  # noise: the more the weights are shrunk the better
    ridges = [1e-6, 1e-2, 1.0, 100.0]
    alone = [ridge_by_press(nodes, y, [ridge]).press for ridge in ridges]
    chosen = ridge_by_press(nodes, y, ridges)
    assert chosen.press == min(alone) == alone[-1]


def test_two_nodes_that_are_one_are_no_obstacle():
    nodes = drawn(20, 1).expand(-1, 2)
    y = 3 * nodes[:, :1] + 1
    found = ridge_by_press(nodes, y, [0.0])
    torch.testing.assert_close(nodes @ found.weights[:, :-1].mT + found.weights[:, -1], y)
    assert found.weights.abs().max() < 4


def test_nothing_to_choose_from_is_refused():
    with pytest.raises(InputError, match="at least one"):
        ridge_by_press(drawn(5, 2), drawn(5, 1), [])


def test_distances_of_points_that_are_close_and_far_from_zero_keep_their_digits():
    x, apart = 1e6 + drawn(5, 3), 2.0**-12 * drawn(4, 3, seed=1).round()
    found = squared_distances(x, x[0] + apart)
    torch.testing.assert_close(found[0], apart.square().sum(1), rtol=1e-12, atol=0.0)
