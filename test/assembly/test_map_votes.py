"""Joints go to the votes of maps, one person each, and nowhere else."""
import numpy as np

from panoptic_ros.assembly.map_votes import moved_to_votes
from panoptic_ros.domain import DetectionSet, ProposalSet, ScoreMaps, ViewDetections

HASH = "cafe0123"


def view(camera, joints):
    count = len(joints)
    maps = ScoreMaps(
        (8, 8), np.eye(2, 3), joints, [-1] * count, np.zeros((count, 2)), np.ones((count, 2)), [200] * count
    )
    return ViewDetections(camera, 0, 0, (32, 32), HASH, np.zeros((0, 2, 2)), np.zeros((0, 2)), [], maps)


def proposals(nodes, joints, views):
    count = len(nodes)
    return ProposalSet(
        DetectionSet(0, 0, HASH, tuple(views)), np.reshape(nodes, (-1, 3)), joints, np.full(count, 0.5),
        np.full(count, 2), np.zeros((0, 2)), [], [],
    )  # fmt: skip


BOTH = [view("a", [0]), view("b", [0])]


def test_joint_goes_to_the_node_within_the_gate():
    positions = np.array([[[0.0, 0, 1], [0.5, 0, 1]]])
    item = proposals([[0.03, 0, 1], [0.53, 0, 1]], [0, 1], BOTH)
    moved = moved_to_votes(positions, item, 0.08)
    assert moved[0, 0].tolist() == [0.03, 0, 1]
    assert moved[0, 1].tolist() == [0.5, 0, 1]  # no map shows joint 1
    assert positions[0, 0, 0] == 0.0


def test_far_nodes_missing_joints_and_single_maps_change_nothing():
    positions = np.array([[[0.0, 0, 1], [np.nan] * 3]])
    assert np.array_equal(
        moved_to_votes(positions, proposals([[0.2, 0, 1]], [0], BOTH), 0.08), positions, equal_nan=True
    )
    one = proposals([[0.02, 0, 1]], [0], [view("a", [0]), view("b", [1])])
    assert np.array_equal(moved_to_votes(positions, one, 0.08), positions, equal_nan=True)


def test_one_node_serves_one_person():
    positions = np.array([[[0.0, 0, 1], [0, 0, 0]], [[0.06, 0, 1], [0, 0, 0]]])
    moved = moved_to_votes(positions, proposals([[0.05, 0, 1]], [0], BOTH), 0.08)
    assert moved[:, 0, 0].tolist() == [0.0, 0.05]
