"""The compiled kernels against the numpy meaning."""

from dataclasses import replace

import numpy as np
import pytest
from score_fields import ViewField, vote_reference

from panoptic_ros.domain import VisibilityLimit
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.voting.parts import person_scores
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.soft_vote import moved
from panoptic_ros.voting.votes import at_rest, vote_points

LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)
FISHEYE = Intrinsics(np.eye(3), (0.02, -0.01, 0.003, -0.001), "fisheye")
MANY = (*LENS, 0.02, -0.01, 0.003, 1e-3, -2e-3, 5e-4, 1e-3, 0.02, -0.03)  # rational, thin prism, tilted


def setting(scenes, maps, distortion, limits=False):
    rig = scenes.ring(4, distortion)
    people = [scenes.person(0.3, 0.2), scenes.person(0.1, -0.3, 1.0)]
    views = scenes.detect(rig, people, maps).views
    if limits:
        views = [replace(view, limit=random_limit(v)) for v, view in enumerate(views)]
    return rig, people, build_scene(rig.cameras, views, 19), [ViewField(view) for view in views]


def random_limit(seed):
    """Cells of 3 to 5 m and without limits, of another number in every view; none in the last."""
    cells = np.random.default_rng(seed).integers(3000, 5000, (5 + seed, 9 - seed))
    return None if seed == 3 else VisibilityLimit(np.where(cells % 3, cells, 0).astype(np.uint16))


def points_about(people, rng):
    near = np.concatenate(people)[rng.integers(0, 38, 150)] + rng.normal(0.0, 0.04, (150, 3))
    return np.concatenate([near, rng.uniform(-6.0, 6.0, (150, 3))])


@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize("distortion", [(), LENS, FISHEYE, MANY])
@pytest.mark.parametrize("maps", ["none", "merged", "person", "mixed"])
def test_votes_are_those_of_numpy(scenes, maps, distortion, limits):
    rig, people, scene, fields = setting(scenes, maps, distortion, limits)
    rng = np.random.default_rng(0)
    points = points_about(people, rng)
    for joint in (0, 1, 5, 12):
        expected, support = vote_reference(fields, rig.cameras, joint, points)
        votes, views_found = vote_points(
            scene, np.full(len(points), joint), points, at_rest(points, scene), 0.1
        )
        assert votes == pytest.approx(expected, abs=1e-12)
        assert (views_found == support).all()
        assert expected.max() > 0.3


@pytest.mark.parametrize("maps", ["none", "merged", "person", "mixed"])
def test_scores_of_persons_are_those_of_numpy(scenes, maps):
    rig, people, scene, fields = setting(scenes, maps, LENS, limits=True)
    points = points_about(people, np.random.default_rng(1))
    joints = np.arange(len(points)) % 19
    scores, seeing = person_scores(scene, joints, points)
    assert scores.max() > 0.5
    for v, (field, camera) in enumerate(zip(fields, rig.cameras)):
        pixels, seen = camera.project(points)
        seen &= field.sees(pixels, camera.cam_from_world.apply(points)[:, 2])
        assert (seeing[:, v] == seen).all()
        for n in np.flatnonzero(seen):
            for i in range(2):
                expected = field.sample_person(i, int(joints[n]), pixels[n : n + 1])
                assert scores[n, v, i] == pytest.approx(expected[0], abs=1e-12)


def test_eq_1_divides_by_the_views_that_see_the_point(scenes):
    rig = scenes.ring(4)
    people = [scenes.person(0.0, 0.0)]
    views = scenes.detect(rig, people, score=0.8).views
    scene = build_scene(rig.cameras, views, 19)
    votes, support = vote_points(scene, np.array([1]), people[0][1:2], at_rest(people[0][1:2], scene), 0.1)
    assert votes == pytest.approx([0.8])
    assert support.tolist() == [4]
    behind = np.array([[4.5 * np.cos(0.1 * np.pi), 4.5 * np.sin(0.1 * np.pi), 1.0]])  # behind camera 0
    seen = [camera.sees(behind)[0] for camera in rig.cameras]
    assert sum(seen) in (1, 2, 3)
    assert not seen[0]


def test_a_view_behind_a_wall_neither_counts_nor_adds(scenes):
    rig = scenes.ring(4)
    people = [scenes.person(0.0, 0.0)]
    item = scenes.detect(rig, people, score=0.8)
    wall = VisibilityLimit(np.full((6, 8), 2000, np.uint16))  # 2 m before cameras that are 4 m away
    joint, head = np.array([1]), people[0][1:2]
    nobody = np.zeros((0, 19, 2)), np.zeros((0, 19)), np.zeros(0)
    blind = replace(item.views[0], points=nobody[0], scores=nobody[1], person_scores=nobody[2])
    votes = {}
    for name, first in {
        "open": item.views[0],
        "empty": blind,
        "walled": replace(blind, limit=wall),
        "dreaming": replace(item.views[0], limit=wall),
    }.items():
        scene = build_scene(rig.cameras, (first, *item.views[1:]), 19)
        votes[name] = tuple(float(x[0]) for x in vote_points(scene, joint, head, at_rest(head, scene), 0.1))
        _, seen = person_scores(scene, joint, head)
        assert seen[0].tolist() == [first.limit is None, True, True, True]
        assert moved(scene, joint, head, 0.1).points == pytest.approx(head, abs=0.01)
    assert votes == {
        "open": pytest.approx((0.8, 4)),
        "empty": pytest.approx((0.6, 3)),
        "walled": pytest.approx((0.8, 3)),
        "dreaming": pytest.approx((0.8, 3)),
    }
