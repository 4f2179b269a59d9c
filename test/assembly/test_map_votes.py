"""Joints go to the votes of maps, one person each, and to plausible ones only."""

import numpy as np
from fed_stages import unassociated

from panoptic_ros.assembly.judgement import JointEstimates
from panoptic_ros.assembly.map_votes import (
    VoteNoise,
    chosen_nodes,
    difference,
    move_to_votes,
    vote_sigmas,
)
from panoptic_ros.domain import DetectionSet, ProposalSet, ScoreMaps, SkeletonModel, ViewDetections
from panoptic_ros.simulation.skeleton import SKELETON

HASH = "cafe0123"
PAIR = SkeletonModel("pair", ("neck", "nose"), 0, ((0, 1),), 1)
ARMS = SkeletonModel("arms", ("neck", "left", "right"), 0, ((0, 1), (0, 2)), 0, ((1, 2),))


def view(camera, joints):
    count = len(joints)
    maps = ScoreMaps(
        (8, 8), np.eye(2, 3), joints, [-1] * count, np.zeros((count, 2)), np.ones((count, 2)), [200] * count
    )
    return ViewDetections(camera, 0, 0, (32, 32), HASH, np.zeros((0, 2, 2)), np.zeros((0, 2)), [], maps)


def proposals(nodes, joints, shown=(0,), votes=None, cameras="ab"):
    count = len(nodes)
    votes = np.full(count, 0.5) if votes is None else votes
    return ProposalSet(
        unassociated(DetectionSet(0, 0, HASH, tuple(view(camera, list(shown)) for camera in cameras)), 2),
        np.reshape(nodes, (-1, 3)),
        joints,
        votes,
        np.full(count, 2),
        np.zeros((0, 2)),
        [],
        [],
    )


def choose(positions, item, expected=None, skeleton=PAIR):
    positions = np.array(positions, float)
    expected = np.full_like(positions, np.nan) if expected is None else np.array(expected, float)
    return chosen_nodes(positions, expected, item, 0.08, skeleton).tolist()


def test_joint_goes_to_the_node_beside_it():
    item = proposals([[0.03, 0, 1], [0.53, 0, 1]], [0, 1])
    assert choose([[[0.0, 0, 1], [0.5, 0, 1]]], item) == [[0, -1]]  # no map shows joint 1


def test_a_vote_counts_as_sure_as_it_is_against_the_triangulated_joint():
    places = np.array([[[0.0, 0, 1], [0.5, 0, 1]], [[9.0, 0, 1], [9.5, 0, 1]]])
    own = np.array([1e-8, 4e-4, 9.0])[:, None, None] * np.eye(3)  # sure, as sure as the vote, not at all
    for covariance, moved in zip(own, (0.0, 0.015, 0.03)):
        covariances, ones = np.tile(covariance, (2, 2, 1, 1)), np.ones((2, 2))
        joints = JointEstimates(places.copy(), covariances.copy(), ones, np.full((2, 2), 3), 0.0 * ones)
        item = proposals([[0.03, 0, 1]], [0])
        noise = VoteNoise(0.08, np.full(2, 0.02), 0.03)
        move_to_votes(joints, np.full_like(places, np.nan), item, PAIR, noise)
        np.testing.assert_allclose(joints.positions[0, 0], [moved, 0, 1], atol=1e-4)
        np.testing.assert_array_equal(joints.positions[1], places[1])
        np.testing.assert_array_equal(joints.covariances, covariances)


def test_votes_are_less_sure_in_the_torso():
    sigmas = vote_sigmas(SKELETON, 0.003, 0.01)
    joints = [SKELETON.joint(name) for name in ("lHip", "rShoulder", "lKnee", "Nose")]
    np.testing.assert_array_equal(sigmas[joints], [0.01, 0.01, 0.003, 0.003])


def test_far_nodes_and_single_maps_change_nothing():
    people = [[[0.0, 0, 1], [np.nan] * 3]]
    assert choose(people, proposals([[0.7, 0, 1]], [0])) == [[-1, -1]]
    assert choose(people, proposals([[0.02, 0, 1]], [0], cameras="a")) == [[-1, -1]]
    assert choose(np.empty((0, 2, 3)), proposals([[0.02, 0, 1]], [0])) == []


def test_a_missing_joint_gets_a_node_where_it_should_be():
    people, item = [[[0.0, 0, 1], [np.nan] * 3]], proposals([[0.02, 0, 1]], [1], shown=[1])
    assert choose(people, item) == [[-1, -1]]
    assert choose(people, item, expected=[[[0, 0, 1]] * 2]) == [[-1, 0]]
    assert choose(people, item, expected=[[[0, 0, 1], [0.4, 0, 1]]]) == [[-1, -1]]


def test_one_node_serves_one_person():
    people = [[[0.0, 0, 1], [0, 0, 0]], [[0.06, 0, 1], [0, 0, 0]]]
    assert choose(people, proposals([[0.05, 0, 1]], [0])) == [[-1, -1], [0, -1]]


def test_the_node_where_the_joint_should_be_beats_the_one_where_views_put_it():
    people, expected = [[[0.4, 0, 1], [0, 0, 0]]], [[[0.02, 0, 1], [0, 0, 0]]]
    item = proposals([[0.4, 0, 1], [0.0, 0, 1]], [0, 0], votes=[0.3, 0.5])
    assert choose(people, item, expected) == [[1, -1]]
    assert choose(people, item) == [[0, -1]]  # without guidance the views decide


def test_a_bone_unlike_that_of_the_other_side_is_not_believed():
    people = [[[0.0, 0, 1], [0.3, 0, 1], [-0.5, 0, 1]]]  # the right arm is too long
    item = proposals([[-0.5, 0, 1], [-0.31, 0, 1]], [2, 2], shown=[2], votes=[0.3, 0.3])
    assert choose(people, item, skeleton=ARMS) == [[-1, -1, 1]]


def bone_differences(places, person, joint, skeleton):
    bones, mirror = np.array(skeleton.bones), np.array(skeleton.mirror)
    return [difference(np.array(place), np.array(person), joint, bones, mirror) for place in places]


def test_bone_differences_by_hand():
    person = [[0.0, 0, 1], [0.3, 0, 1], [np.nan] * 3]
    places = [[-0.3, 0, 1], [-0.36, 0, 1], [-3.0, 0, 1]]
    assert np.allclose(bone_differences(places, person, 2, ARMS), [0.0, 0.5 * (0.06 / 0.06) ** 2, 18.0])
    uneven = [[9.0] * 3, [0.3, 0, 1], [-0.4, 0, 1]]
    assert np.allclose(bone_differences([[0.0, 0, 1]], uneven, 0, ARMS), 0.5 * (0.1 / 0.06) ** 2 * 2)
    assert bone_differences(places, person[:2], 1, PAIR) == [0.0] * 3


def test_nodes_far_from_where_a_joint_should_be_are_not_looked_at():
    item = proposals([[0.15, 0, 1], [0.4, 0, 1]], [0, 0], votes=[0.5, 0.9])
    expected = [[[0.0, 0, 1], [np.nan] * 3]]
    assert choose([[[0.4, 0, 1], [9.0, 0, 1]]], item, expected) == [[1, -1]]  # it was triangulated there
    assert choose([[[0.6, 0, 1], [9.0, 0, 1]]], item, expected) == [[0, -1]]
