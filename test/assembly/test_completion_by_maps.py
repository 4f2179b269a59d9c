"""Voted nodes stand for joints that the 2D people lack."""

from dataclasses import replace

import numpy as np
from fed_stages import FedAssembly, seen_by

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.map_votes import node_doubts
from panoptic_ros.domain import ScoreMaps


def with_nodes(item, nodes, joint):
    """The set with nodes of one joint, from a detector with score maps."""
    maps = ScoreMaps((4, 4), np.eye(2, 3), [joint], [-1], np.zeros((1, 2)), np.ones((1, 2)), [200])
    views = tuple(replace(view, maps=maps) for view in item.detections.views)
    count = len(nodes)
    return replace(
        seen_by(item, views),
        nodes=nodes,
        node_joints=[joint] * count,
        node_scores=[0.5] * count,
        node_views=[2] * count,
    )


def test_a_lost_joint_comes_from_its_node(scenes):
    rig, truth = scenes.ring(4), scenes.person()
    wrist = scenes.skeleton.joint("lWrist")

    def change(i, points, scores):
        points[:, wrist] = np.nan

    node = truth[wrist] + [0.0, 0.02, 0.0]
    first = scenes.proposals(rig, [truth], index=0)
    second = with_nodes(scenes.proposals(rig, [truth], index=1, change=change), [node, node + 1.0], wrist)
    stage = FedAssembly(scenes.context(rig))
    stage.step(first)
    pose = stage.step(second).outputs[0]
    assert np.array_equal(pose.positions[0, wrist], node)
    assert pose.views[0, wrist] == 2 and pose.scores[0, wrist] == 0.5
    variance = AssemblyConfig().node_sigma ** 2 + node_doubts(np.array([0.5]))
    assert np.allclose(pose.covariances[0, wrist], variance * np.eye(3))
    off = FedAssembly(scenes.context(rig), vote_distance=0.0, held_sigma=0.0)
    off.step(first)
    assert np.isnan(off.step(second).outputs[0].positions[0, wrist]).all()


def test_nodes_with_few_votes_are_doubted_more():
    doubts = np.sqrt(node_doubts(np.array([0.1, 0.3, 0.5, 0.9])))
    assert (np.diff(doubts) < 0.0).all() and doubts[0] > 0.1 and doubts[-1] < 0.02
