"""Pieces that the missing force is cut into: those of least cost, found without a call for every pair of rows."""

import cProfile
from itertools import combinations

import numpy as np
import pytest

from manoeuvre_nn.diagnosis.locate import _level_pieces


def cost(z, edges, penalty):
    pieces = zip(edges, edges[1:], strict=False)
    return sum(((z[a:b] - z[a:b].mean(axis=0)) ** 2).sum() + penalty for a, b in pieces)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("penalty", [2.0, 12.0])
def test_no_other_pieces_cost_less(seed, penalty):
    random = np.random.default_rng(seed)
    z = random.standard_normal((14, 2))
    z[random.integers(0, 7) : random.integers(8, 14)] += random.uniform(-6, 6, 2)
    ways = [[0, *inner, 14] for k in range(4) for inner in combinations(range(3, 12), k)]
    allowed = [edges for edges in ways if min(np.diff(edges)) >= 3]
    assert _level_pieces(z, 3, penalty) == min(allowed, key=lambda edges: cost(z, edges, penalty))


def test_a_day_is_cut_with_a_few_calls_a_row():
    z, profile = np.random.default_rng(0).standard_normal((1000, 3)), cProfile.Profile()
    assert profile.runcall(_level_pieces, z, 3, 80.0) == [0, 1000]
    assert sum(entry.callcount for entry in profile.getstats()) < 20 * len(z)
