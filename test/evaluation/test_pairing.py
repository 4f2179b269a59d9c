"""Properties of pairing and matching, against brute force."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.evaluation.pairing import GATE, match_people, nearest_frames


def total(distances):
    """What matching minimises, with the cost of leaving somebody out above every match."""
    return sum(np.nanmean(row) for row in distances)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 10_000))
def test_matching_equals_brute_force(truths, results, seed):
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0, 0.8, (truths, 1, 3)) + np.zeros((1, 4, 1))
    result = rng.uniform(0, 0.8, (results, 1, 3)) + np.zeros((1, 4, 1))
    pairs, distances = match_people(truth, result)
    cost = np.linalg.norm(truth[:, None, 0] - result[None, :, 0], axis=-1)
    best = (0, 0.0)
    for order in permutations(range(max(truths, results)), truths):
        chosen = [cost[i, k] for i, k in enumerate(order) if k < results and cost[i, k] <= GATE]
        best = max(best, (len(chosen), -sum(chosen)))
    assert len(pairs) == best[0]
    assert np.isclose(-total(distances), best[1])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-30, 30), max_size=12), st.integers(1, 12))
def test_every_result_frame_serves_once_and_within_half_a_period(jitter, frames):
    truth = 1000 + 50 * np.arange(frames)
    result = np.array([1000 + 50 * i + shift for i, shift in enumerate(jitter)], np.int64)
    partners = nearest_frames(truth, result)
    used = [k for k in partners if k is not None]
    assert len(used) == len(set(used))
    for i, k in enumerate(partners):
        if k is not None and frames > 1:
            assert abs(truth[i] - result[k]) <= 25


def test_fewer_than_three_common_joints_are_no_match():
    truth = np.zeros((1, 5, 3))
    result = np.full((1, 5, 3), np.nan)
    result[0, :2] = 0.0
    assert not len(match_people(truth, result)[0])
    result[0, 2] = 0.1
    assert len(match_people(truth, result)[0]) == 1
