"""Explaining away: what the 2D people tell already is not searched for again, what they lack is."""

import numpy as np
import pytest
from fed_stages import FedVoting

from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections
from panoptic_ros.geometry import Rigid
from panoptic_ros.stage import StageContext
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.peaks import KnownNodes, find_peaks
from panoptic_ros.voting.proposals import NodeProposals
from panoptic_ros.voting.scene import build_scene

NAMES = ("nodes", "node_joints", "node_scores", "node_views", "parts", "part_bones", "part_scores")


def stage_of(scenes, rig, **config):
    config = VotingConfig(**{"without_maps": True, "parts": True} | config)
    return FedVoting(config, StageContext(rig, scenes.skeleton))


def without_people(item, which, views=None):
    """The set with these people cut out of the lists of 2D people, their blobs left in the maps."""
    kept = [
        ViewDetections(
            v.camera,
            v.stamp_ns,
            v.frame_number,
            v.image_size,
            v.skeleton_hash,
            np.delete(v.points, which, 0),
            np.delete(v.scores, which, 0),
            np.delete(v.person_scores, which),
            v.maps,
        )
        if views is None or k in views
        else v
        for k, v in enumerate(item.views)
    ]
    return DetectionSet(item.index, item.stamp_ns, item.skeleton_hash, tuple(kept))


def at(item, stamp_ns, index=0):
    views = [
        ViewDetections(
            v.camera,
            stamp_ns,
            index,
            v.image_size,
            v.skeleton_hash,
            v.points,
            v.scores,
            v.person_scores,
            v.maps,
        )
        for v in item.views
    ]
    return DetectionSet(index, stamp_ns, item.skeleton_hash, tuple(views))


def farthest_joint(proposals, joints, but=()):
    """How far the joints (J, 3) of a person are from the nearest node of their kind, the worst of all."""
    gaps = [
        np.linalg.norm(proposals.nodes[proposals.node_joints == j] - place, axis=1).min(initial=9.0)
        for j, place in enumerate(joints)
        if j not in but
    ]
    return max(gaps)


@pytest.mark.parametrize("maps", ["none", "merged", "person", "mixed"])
def test_one_node_for_each_joint_of_known_people(scenes, maps):
    rig = scenes.ring(6, (-0.1, 0.02, 0.001, -0.001))
    people = [scenes.person(0.5, 0.3), scenes.person(-0.6, -0.5, 2.0)]
    proposals = stage_of(scenes, rig).step(scenes.detect(rig, people, maps)).outputs[0]
    assert max(farthest_joint(proposals, person) for person in people) < 0.015
    counts = np.bincount(proposals.node_joints, minlength=19)
    assert counts.min() == 2 and counts.sum() <= 42  # seeds alone give more where rays of two people cross


def test_finds_a_person_that_the_lists_of_2d_people_lack(scenes):
    rig = scenes.ring(6)
    people = [scenes.person(0.5, 0.3), scenes.person(-0.6, -0.5, 2.0)]
    item = without_people(scenes.detect(rig, people, "merged"), 1)
    proposals = stage_of(scenes, rig).step(item).outputs[0]
    assert farthest_joint(proposals, people[0]) < 0.015
    assert farthest_joint(proposals, people[1], but=(0, 2)) < 0.02  # Neck and BodyCenter have no maps


def test_finds_a_joint_that_a_known_person_lacks(scenes):
    rig = scenes.ring(5)
    item = scenes.detect(rig, [scenes.person(0.2, 0.1)], "merged")
    views = []
    for v in item.views:
        points, scores = v.points.copy(), v.scores.copy()
        points[:, 5], scores[:, 5] = np.nan, 0.0
        views.append(
            ViewDetections(
                v.camera,
                v.stamp_ns,
                0,
                v.image_size,
                v.skeleton_hash,
                points,
                scores,
                v.person_scores,
                v.maps,
            )
        )
    item = DetectionSet(0, 1000, item.skeleton_hash, tuple(views))
    assert farthest_joint(stage_of(scenes, rig).step(item).outputs[0], scenes.person(0.2, 0.1)) < 0.02


def test_2d_people_of_two_views_still_give_nodes_without_maps(scenes):
    rig = scenes.ring(5)
    people = [scenes.person(0.5, 0.3), scenes.person(-0.6, -0.5, 2.0)]
    item = without_people(scenes.detect(rig, people), 1, views=(0, 2, 4))
    proposals = stage_of(scenes, rig).step(item).outputs[0]
    assert max(farthest_joint(proposals, person) for person in people) < 0.02


def test_explained_peaks_give_no_seeds_and_others_stay(scenes):
    rig = scenes.ring(4)
    people = [scenes.person(0.5, 0.3), scenes.person(-0.6, -0.5, 2.0)]
    for maps in ("none", "merged"):
        scene = build_scene(rig.cameras, scenes.detect(rig, people, maps).views, 19)
        peaks = find_peaks(scene, 0.1)
        one = np.ones(19)
        nodes = NodeProposals(people[0], np.arange(19), one, one)
        moving = np.tile([3.0, 0.0, 0.0], (19, 1))
        left_start, left = KnownNodes(nodes, 0.0 * moving, np.zeros(4)).unexplained(scene, peaks)
        assert len(peaks.pixels) == 4 * 19 * 2 and len(left) == 4 * 19
        assert left_start.tolist() == list(range(4 * 19 + 1))
        late = KnownNodes(nodes, moving, np.array([0.0, 0.0, 0.0, 0.1]))  # there 30 cm farther on
        assert len(late.unexplained(scene, peaks).pixels) == 5 * 19


def test_the_same_after_reset_and_flush_and_whatever_the_order_of_views(scenes):
    rig = scenes.ring(5)
    people = [scenes.person(0.4, 0.3), scenes.person(-0.3, -0.4, 2.0)]
    moved = [p + (0.05, 0.02, 0.0) for p in people]
    items = [at(scenes.detect(rig, p, "merged"), 33_000_000 * k, k) for k, p in enumerate((people, moved))]
    turned = [DetectionSet(i.index, i.stamp_ns, i.skeleton_hash, i.views[::-1]) for i in items]
    stage = stage_of(scenes, rig)
    first = [stage.step(item).outputs[0] for item in items]
    stage.stage.reset()
    second = [stage.step(item).outputs[0] for item in turned]
    stage.stage.flush()
    third = [stage.step(item).outputs[0] for item in items]
    for a, b, c in zip(first, second, third):
        for name in NAMES:
            assert np.array_equal(getattr(a, name), getattr(b, name)), name
            assert np.array_equal(getattr(a, name), getattr(c, name)), name


def test_a_camera_that_sees_nothing_changes_nothing(scenes):
    rig = scenes.ring(7)
    item = scenes.detect(rig, [scenes.person(0.1, 0.2), scenes.person(-0.7, 0.2)], "merged")
    away = rig.cameras[0]
    turned = np.diag([-1.0, 1.0, -1.0]) @ away.cam_from_world.rotation
    blind = Camera("blind", (640, 480), away.intrinsics, Rigid(turned, -turned @ away.centre))
    view = ViewDetections(
        "blind", item.stamp_ns, 0, (640, 480), item.skeleton_hash, np.zeros((0, 19, 2)), np.zeros((0, 19)), ()
    )
    more = DetectionSet(0, item.stamp_ns, item.skeleton_hash, (*item.views, view))
    one = stage_of(scenes, rig).step(item).outputs[0]
    two = stage_of(scenes, Rig((*rig.cameras, blind))).step(more).outputs[0]
    for name in NAMES:
        assert np.allclose(getattr(one, name), getattr(two, name), atol=1e-9), name
