"""People from parts as in the paper: refined to the least sum of squared reprojection errors."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedAssembly, seen_by, unassociated
from scipy.optimize import least_squares

from panoptic_ros.domain import ProposalSet

ROUGH = 0.02  # m, by which voxels miss the joints


@pytest.fixture
def scene(scenes):
    return scenes, scenes.ring(5), [scenes.person(0.5, 0.2), scenes.person(-0.9, -0.4, turn=2.0)]


def with_parts(item, people, skeleton, rng):
    """The set with a node near every joint of the people (J, 3) and the true parts between them."""
    count = len(skeleton)
    nodes = np.concatenate(people) + ROUGH * rng.uniform(-0.5, 0.5, (len(people) * count, 3))
    parts = [(count * p + a, count * p + b) for p in range(len(people)) for a, b in skeleton.bones]
    bones = list(range(len(skeleton.bones))) * len(people)
    ones = np.ones(len(nodes))
    return ProposalSet(
        item.association,
        nodes,
        np.tile(np.arange(count), len(people)),
        0.5 * ones,
        3 * ones,
        parts,
        bones,
        np.full(len(parts), 0.5),
    )


def without(item, views, joint):
    """The set whose views of these numbers do not show a joint of anybody."""
    changed = list(item.detections.views)
    for number in views:
        view = changed[number]
        points, scores = view.points.copy(), view.scores.copy()
        points[:, joint], scores[:, joint] = np.nan, 0.0
        changed[number] = replace(view, points=points, scores=scores)
    return seen_by(item, changed)


def moved(item, number, joint, pixels):
    """The set with one joint of everybody displaced in one view."""
    views = list(item.detections.views)
    points = views[number].points.copy()
    points[:, joint] += pixels
    views[number] = replace(views[number], points=points)
    return seen_by(item, views)


def solved(scenes, rig, item):
    stage = FedAssembly(scenes.context(rig), method="dynamic_programming")
    return stage.step(item).outputs[0]


def test_joints_are_refined_below_the_voxel(scene):
    scenes, rig, people = scene
    item = with_parts(scenes.proposals(rig, people), people, scenes.skeleton, np.random.default_rng(0))
    pose = solved(scenes, rig, item)
    assert len(pose.positions) == 2
    for person in people:
        assert np.nanmax(np.linalg.norm(pose.positions - person, axis=-1), axis=1).min() < 1e-6
    assert (pose.views >= 2).all() and np.isfinite(pose.covariances).all()


def test_a_joint_in_one_view_stays_at_its_node(scene):
    scenes, rig, people = scene
    wrist = scenes.skeleton.joint("rWrist")
    item = with_parts(scenes.proposals(rig, people), people, scenes.skeleton, np.random.default_rng(1))
    pose = solved(scenes, rig, without(item, range(1, 5), wrist))
    nodes = item.nodes[item.node_joints == wrist]
    for position in pose.positions[:, wrist]:
        assert np.linalg.norm(nodes - position, axis=1).min() == 0.0
    assert (pose.views[:, wrist] == 3).all()  # those of the node


def test_all_2d_joints_count_alike_however_far_off_they_are(scene):
    scenes, rig, people = scene
    knee, person = scenes.skeleton.joint("lKnee"), people[:1]
    item = with_parts(scenes.proposals(rig, person), person, scenes.skeleton, np.random.default_rng(2))
    item = moved(item, 2, knee, (9.0, -6.0))
    pose = solved(scenes, rig, item)
    views = [(rig.camera(view.camera), view.points[0, knee]) for view in item.detections.views]

    def errors(place):
        return np.concatenate(
            [
                (camera.intrinsics.undistort(pixels) - plane_of(camera, place))
                * focal(camera)
                / np.hypot(*camera.image_size)
                for camera, pixels in views
            ]
        )

    best = least_squares(errors, person[0][knee], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert np.linalg.norm(best - person[0][knee]) > 1e-3
    assert pose.positions[0, knee] == pytest.approx(best, abs=1e-5)


def plane_of(camera, place):
    local = camera.cam_from_world.rotation @ place + camera.cam_from_world.translation
    return local[:2] / local[2]


def focal(camera):
    return 0.5 * np.trace(camera.intrinsics.matrix[:2, :2])


def test_2d_people_are_named_and_instants_are_independent(scene):
    scenes, rig, people = scene
    item = with_parts(scenes.proposals(rig, people), people, scenes.skeleton, np.random.default_rng(3))
    stage = FedAssembly(scenes.context(rig), method="dynamic_programming")
    first = stage.step(item).outputs[0]
    detections = item.detections
    detections = replace(detections, index=1, stamp_ns=detections.stamp_ns + 40_000_000)
    later = replace(item, association=unassociated(detections, len(scenes.skeleton)))
    second = stage.step(later).outputs[0]
    assert np.array_equal(first.positions, second.positions)
    assert first.sources.cameras == tuple(view.camera for view in detections.views)
    assert (np.sort(first.sources.persons, axis=0) == [[0], [1]]).all()
    assert (first.sources.persons[0] == first.sources.persons[0, 0]).all()


def test_nobody_is_nobody(scene):
    scenes, rig, _ = scene
    pose = solved(scenes, rig, scenes.proposals(rig, []))
    assert pose.positions.shape == (0, len(scenes.skeleton), 3)
