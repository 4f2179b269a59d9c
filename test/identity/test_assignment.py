"""Pairs of rows and columns, where staying alone costs the gate."""

from itertools import permutations

import numpy as np
import pytest

from panoptic_ros.identity.assignment import best_pairs


def test_one_good_pair_beats_two_poor_ones():
    assert best_pairs(np.array([[1.0, 9.0], [9.0, np.inf]]), 10.0) == [(0, 0)]
    assert best_pairs(np.array([[1.0, 4.0], [4.0, np.inf]]), 10.0) == [(0, 1), (1, 0)]


def test_a_pair_that_costs_the_gate_is_none():
    assert best_pairs(np.array([[10.0, np.nan], [np.inf, 9.9]]), 10.0) == [(1, 1)]
    assert best_pairs(np.zeros((0, 3)), 10.0) == []


@pytest.mark.parametrize("seed", range(20))
def test_the_sum_of_cost_minus_gate_is_least(seed):
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.0, 12.0, (4, 3 + seed % 3))
    cost[rng.random(cost.shape) < 0.3] = np.inf
    worth = np.minimum(np.pad(cost - 10.0, ((0, 0), (0, 4)), constant_values=0.0), 0.0)
    least = min(sum(worth[i, k] for i, k in enumerate(ks)) for ks in permutations(range(len(worth[0])), 4))
    assert sum(cost[pair] - 10.0 for pair in best_pairs(cost, 10.0)) == pytest.approx(least)
