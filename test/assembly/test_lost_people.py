"""People whom every list of 2D people lost are found among the nodes, and nobody is invented."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedAssembly, unassociated

from panoptic_ros.assembly.lost_people import explained, lost_people
from panoptic_ros.domain import DetectionSet, ProposalSet, ScoreMaps


def with_nodes(item, people, skeleton, views=4, vote=0.4, extra=()):
    """The set with nodes at all joints (P, J, 3) of people, ghosts (joint, place), and a map that says so."""
    nodes = [(j, place) for person in people for j, place in enumerate(person)] + list(extra)
    count = len(nodes)
    shown = np.arange(len(skeleton))
    maps = ScoreMaps(
        (8, 8),
        np.eye(2, 3),
        shown,
        np.full(len(shown), -1),
        np.zeros((len(shown), 2)),
        np.ones((len(shown), 2)),
        np.full(len(shown), 200),
    )
    detections = item.detections
    detections = DetectionSet(
        detections.index,
        detections.stamp_ns,
        detections.skeleton_hash,
        tuple(replace(view, maps=maps) for view in detections.views),
    )
    return ProposalSet(
        unassociated(detections, len(skeleton)),
        np.array([place for _, place in nodes]).reshape(-1, 3),
        [j for j, _ in nodes],
        np.full(count, vote),
        np.full(count, views),
        np.empty((0, 2)),
        [],
        [],
    )


def ghosts(rng, skeleton, count=30):
    return [(int(rng.integers(len(skeleton))), rng.uniform([-3, -3, 0], [3, 3, 2])) for _ in range(count)]


@pytest.fixture
def scene(scenes):
    return scenes, scenes.ring(5), scenes.person(0.5, 0.2), scenes.person(-0.9, -0.4, turn=2.0)


def test_a_person_without_2d_people_is_found_from_nodes_and_kept(scene):
    scenes, rig, seen, lost = scene
    rng = np.random.default_rng(0)
    stage = FedAssembly(scenes.context(rig))
    for index in range(4):
        item = scenes.proposals(rig, [seen], index=index)
        item = with_nodes(item, [seen, lost], scenes.skeleton, extra=ghosts(rng, scenes.skeleton))
        pose = stage.step(item).outputs[0]
        gaps = np.nanmean(np.linalg.norm(pose.positions - lost, axis=-1), axis=1)
        assert gaps.min() < 0.05
        assert len(pose.positions) == 2
        row = int(gaps.argmin())
        assert np.isfinite(pose.positions[row, :, 0]).mean() > 0.8
        assert (pose.views[row][np.isfinite(pose.positions[row, :, 0])] >= 3).all()


def test_two_lost_people_are_two(scene):
    scenes, rig, one, two = scene
    item = with_nodes(scenes.proposals(rig, []), [one, two], scenes.skeleton)
    found = lost_people(item, np.empty((0, 19, 3)), scenes.skeleton)
    assert len(found) == 2
    for person in (one, two):
        assert np.linalg.norm(found - person, axis=-1).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("change", [{"views": 2}, {"vote": 0.1}])
def test_few_views_and_weak_votes_make_nobody(scene, change):
    scenes, rig, seen, lost = scene
    item = with_nodes(scenes.proposals(rig, [seen]), [seen, lost], scenes.skeleton, **change)
    assert len(lost_people(item, seen[None], scenes.skeleton)) == 0


def test_ghosts_and_known_people_make_nobody(scene):
    scenes, rig, seen, _ = scene
    rng = np.random.default_rng(1)
    mirrored = seen[list(scenes.skeleton.mirror)]  # maps show both sides at both
    item = with_nodes(
        scenes.proposals(rig, [seen]), [seen, mirrored], scenes.skeleton, extra=ghosts(rng, scenes.skeleton)
    )
    assert len(lost_people(item, seen[None], scenes.skeleton)) == 0


def test_explained_by_hand(scenes):
    skeleton, person, mirror = scenes.skeleton, scenes.person(), np.array(scenes.skeleton.mirror)
    wrist, other = skeleton.joint("lWrist"), skeleton.joint("rWrist")
    nodes = np.stack([person[wrist] + 0.1, person[other], person[wrist] + 0.2])
    joints = np.array([wrist, wrist, wrist])
    assert explained(nodes[:2] * [1, 1, 1], joints[:2], person[None], mirror).tolist() == [False, True]
    assert explained(nodes[:1] - 0.05, joints[:1], person[None], mirror).tolist() == [True]
    assert not explained(nodes, joints, np.full((1, 19, 3), np.nan), mirror).any()
