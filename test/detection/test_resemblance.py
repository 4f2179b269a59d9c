"""Distances of 2D people, against their definition in numpy."""

import numpy as np
import pytest

from panoptic_ros.detection.resemblance import COMMON, apart


def defined(points, seen, others, known):
    """The lower median over common joints, as a share of the larger of both boxes' longer sides."""
    shares = np.full((len(points), len(others)), np.inf)
    for i, k in np.ndindex(*shares.shape):
        both = seen[i] & known[k]
        if both.sum() >= COMMON:
            gaps = np.sort(np.linalg.norm(points[i, both] - others[k, both], axis=-1))
            tall = max(np.ptp(points[i, seen[i]], axis=0).max(), np.ptp(others[k, known[k]], axis=0).max())
            shares[i, k] = gaps[(len(gaps) - 1) // 2] / tall
    return shares


@pytest.mark.parametrize("seed", range(3))
def test_they_are_medians_over_common_joints(seed):
    rng = np.random.default_rng(seed)
    points, others = rng.uniform(0, 300, (5, 8, 2)), rng.uniform(0, 300, (4, 8, 2))
    scores, there = np.where(rng.uniform(size=(5, 8)) < 0.7, 0.5, 0.0), rng.uniform(size=(4, 8)) < 0.6
    wanted = defined(points, scores > 0.0, others, there)
    assert np.isfinite(wanted).any() and np.isinf(wanted).any()
    np.testing.assert_allclose(apart(points, scores, others, there), wanted)
    np.testing.assert_allclose(apart(others, there, points, scores), wanted.T)


def test_frozen_and_transposed_arrays_are_taken_as_they_are():
    points = np.asfortranarray(np.random.default_rng(4).uniform(0, 300, (3, 5, 2)))
    points.setflags(write=False)
    scores = np.ones((3, 5))
    np.testing.assert_array_equal(np.diag(apart(points, scores, points, scores)), np.zeros(3))


def test_of_nobody_there_are_none_and_few_common_joints_are_none():
    points, scores = np.zeros((2, 4, 2)), np.ones((2, 4))
    assert apart(points, scores, np.zeros((0, 1, 2)), np.zeros((0, 1), bool)).shape == (2, 0)
    few = scores * (np.arange(4) < COMMON - 1)
    assert np.isinf(apart(points, few, points, scores)).all()
