"""The parts of the search for new people against their numpy forms."""

import numpy as np
import pytest

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.grouping import (
    PAIRS_PER_ROUND,
    NewcomerRules,
    best_pairs,
    enough_support,
)
from panoptic_ros.domain.rig_arrays import CAMERA
from panoptic_ros.solving.scene import HIDDEN, OUTSIDE, SEEN, CameraPoses, ViewVisibility, look_at


@pytest.mark.parametrize("seed", range(8))
def test_best_pairs_are_the_first_of_a_stable_sort(seed):
    rng = np.random.default_rng(seed)
    rank = np.triu(rng.integers(0, 6, (12, 12)) / 5.0, 1)  # with ties
    rank[rng.random(rank.shape) < (0.9 if seed % 2 else 0.2)] = 0.0
    left = rng.random(12) < 0.8
    there = np.where(left[:, None] & left, rank, 0.0).ravel()
    order = np.argsort(-there, kind="stable")[:PAIRS_PER_ROUND]
    expected = [divmod(i, 12) for i in order if there[i] > 0.0]
    assert [tuple(pair) for pair in best_pairs(rank, np.arange(len(left)), left)] == expected


def test_a_view_sees_whoever_has_half_of_the_known_joints_in_its_image():
    cams = CameraPoses(np.eye(3)[None].repeat(3, 0), np.zeros((3, 3)), np.ones(3))
    cameras = np.zeros(3, CAMERA)
    cameras["fy"], cameras["cy"], cameras["fold"] = 1.0, 0.5, 9.0
    cameras["width"] = cameras["height"] = 2.0
    cameras["fx"], cameras["cx"] = [1.0, 10.0, 2.0], [0.5, 0.5, -1.1]  # x of -1 to 1, -0.1 to 0.1, 0.3 to 1.3
    person = np.array([[0.0, 0, 2], [1.0, 0, 2], [np.nan] * 3, [0.0, 0, -2], [1.0, 0.2, 2]])
    sight = ViewVisibility(cameras, np.zeros(9))
    assert look_at(person, cams, sight).tolist() == [SEEN, OUTSIDE, SEEN]
    wall = np.array([9.0, 2, 1, 0, 0, 0, 0, 0, 0, 1.9, 1.9])  # of the first view, nearer than the person
    behind = look_at(person, cams, ViewVisibility(cameras, wall))
    assert behind.tolist() == [HIDDEN, OUTSIDE, SEEN]


@pytest.fixture
def rules():
    return NewcomerRules.of(AssociationConfig())


def body(size):
    return np.array([[0.0, 0, 0], [0.2, 0.0, 0.5], [np.nan] * 3, [0.0, 0.0, 1.0]]) * size


def test_two_views_must_agree_the_better_the_more_others_see_nobody(rules):
    least = [
        min(a for a in np.arange(0.0, 1.01, 0.01) if enough_support(2, seeing, a, body(1.8), rules))
        for seeing in (2, 3, 4, 5)
    ]
    assert (np.diff(least) > 0.05).all() and least[0] == pytest.approx(0.4, abs=0.011)
    assert not enough_support(2, 6, 1.0, body(1.8), rules)
    assert enough_support(3, 6, 0.0, body(1.8), rules)


def test_small_people_must_agree_better(rules):
    assert enough_support(2, 4, 0.7, body(1.8), rules)
    assert not enough_support(2, 4, 0.7, body(0.7), rules)
    assert enough_support(2, 4, 0.95, body(0.7), rules)  # a child, or half of somebody
    assert not enough_support(2, 4, 0.99, body(0.05), rules)
