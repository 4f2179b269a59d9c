import numpy as np
import pytest
from score_fields import ViewField, vote_reference

from panoptic_ros.domain import DetectionSet
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.soft_vote import BALL, MANY_VIEWS, RADII, SOFTNESS, moved
from panoptic_ros.voting.votes import PointMotion, at_rest, vote_points

LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)
FISHEYE = Intrinsics(np.eye(3), (0.02, -0.01, 0.003, -0.001), "fisheye")


def reference(fields, cameras, joint, start):
    """The soft vote in numpy, of a point whose neighbourhood all cameras cover."""
    nearest = min(cameras, key=lambda camera: camera.cam_from_world.apply(start)[2])
    place = start
    for radius in RADII[len(cameras) >= MANY_VIEWS :]:
        offsets = radius * BALL.T @ nearest.cam_from_world.rotation
        votes, _ = vote_reference(fields, cameras, joint, place + offsets)
        weights = np.exp((votes - votes.max()) / SOFTNESS)
        place = place + (weights[:, None] * offsets).sum(0) / weights.sum()
    return place


def setting(scenes, maps, lens=LENS, count=4):
    rig = scenes.ring(count, lens)
    people = [scenes.person(0.3, 0.2), scenes.person(0.1, -0.3, 1.0)]
    views = scenes.detect(rig, people, maps).views
    return rig, np.stack(people), build_scene(rig.cameras, views, 19), [ViewField(view) for view in views]


@pytest.mark.parametrize("lens", [LENS, FISHEYE])
@pytest.mark.parametrize("maps, count", [("none", 4), ("merged", 4), ("mixed", 4), ("none", MANY_VIEWS)])
def test_it_is_the_soft_vote_of_numpy(scenes, maps, count, lens):
    rig, people, scene, fields = setting(scenes, maps, lens, count=count)
    joints = np.array([1, 3, 8, 12, 2])
    starts = people[0, joints] + np.random.default_rng(0).uniform(-0.02, 0.02, (5, 3))
    points = moved(scene, joints, starts, 0.1).points
    for n, joint in enumerate(joints):
        expected = reference(fields, rig.cameras, int(joint), starts[n])
        assert points[n] == pytest.approx(expected, abs=6e-5)  # lenses bend within a ball, too


@pytest.mark.parametrize("maps", ["none", "merged"])
def test_it_comes_closer_to_the_joint(scenes, maps):
    _, people, scene, _ = setting(scenes, maps, count=6)
    true = people.reshape(-1, 3)
    starts = true + np.random.default_rng(1).uniform(-0.02, 0.02, true.shape)
    nodes = moved(scene, np.tile(np.arange(19), 2), starts, 0.1)
    assert np.linalg.norm(nodes.points - true, axis=1).max() < 0.012
    assert nodes.votes.min() > 0.7


@pytest.mark.parametrize("maps", ["none", "merged"])
def test_a_point_is_found_as_far_away_as_its_reach(scenes, maps):
    rig, people, scene, _ = setting(scenes, maps, count=6)
    joints, away = np.array([1]), np.array([[0.16, 0.12, 0.0]])  # nose; 20 cm
    near, still = np.zeros((1, 3)), np.zeros(len(rig.cameras))
    found = {
        reach: moved(
            scene, joints, people[0, joints] + away, 0.1, PointMotion(near, still, np.array([reach]))
        )
        for reach in (0.0, 0.3)
    }
    errors = {reach: np.linalg.norm(nodes.points[0] - people[0, 1]) for reach, nodes in found.items()}
    assert errors[0.3] < 0.03 < errors[0.0]


def test_where_nothing_votes_a_point_stays(scenes):
    _, _, scene, _ = setting(scenes, "none")
    away = np.array([[1.5, 1.5, 0.2], [50.0, 0.0, 1.0]])
    nodes = moved(scene, np.array([1, 1]), away, 0.1)
    assert np.array_equal(nodes.points, away)
    assert (nodes.votes == 0.0).all()
    assert moved(scene, np.zeros(0, int), np.zeros((0, 3)), 0.1).points.shape == (0, 3)


@pytest.mark.parametrize("maps", ["none", "merged", "mixed"])
def test_views_of_several_stamps_vote_where_the_joint_was_at_theirs(scenes, maps):
    rig, person = scenes.ring(6), scenes.person(0.3, 0.2)
    velocity = np.tile([1.2, -0.8, 0.1], (19, 1))
    delays = np.array([0.0, 0.04, -0.04, 0.0, 0.04, -0.02])
    views = [scenes.detect(rig, [person + late * velocity], maps).views[v] for v, late in enumerate(delays)]
    scene = build_scene(rig.cameras, DetectionSet(0, 1, views[0].skeleton_hash, tuple(views)).views, 19)
    joints, starts = np.arange(19), person + np.random.default_rng(0).uniform(-0.01, 0.01, (19, 3))
    nodes = moved(scene, joints, starts, 0.1, PointMotion(velocity, delays, np.zeros(19)))
    still = moved(scene, joints, starts, 0.1)
    error, wrong = (np.linalg.norm(each.points - person, axis=1) for each in (nodes, still))
    assert error.max() < 0.012 and np.median(wrong) > 2.0 * np.median(error)
    assert nodes.votes.min() > 0.8 and np.median(still.votes) < np.median(nodes.votes)
    assert (nodes.support >= still.support).all()


@pytest.mark.parametrize("maps", ["none", "merged"])
def test_votes_of_one_stamp_do_not_depend_on_motion(scenes, maps):
    _, people, scene, _ = setting(scenes, maps)
    joints, moving = np.arange(19), PointMotion(np.ones((19, 3)), np.zeros(4), np.zeros(19))
    nodes, still = moved(scene, joints, people[0], 0.1, moving), moved(scene, joints, people[0], 0.1)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(nodes, still))
    one = vote_points(scene, joints, people[0], at_rest(people[0], scene), 0.1)
    other = vote_points(scene, joints, people[0], moving, 0.1)
    assert all(np.array_equal(a, b) for a, b in zip(one, other))
