"""World frame of a rig: marked floor points, a measured distance, and what moving a rig keeps."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.evaluation.rig_frame import MarkedFloor, moved_rig, scaled_rig, world_on_floor
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import rotations_of

MARKS = np.array([[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.3, 0.9, 0.0], [-0.5, 0.4, 0.0]])
NAMES = ("a", "b", "c", "d")


def ring(count=4):
    """Cameras on a circle that look at the middle of the floor, with a covariance."""
    cameras = []
    for c in range(count):
        angle = 2.0 * np.pi * c / count
        position = np.array([3.0 * np.cos(angle), 3.0 * np.sin(angle), 2.0])
        ahead = -position / np.linalg.norm(position)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        intrinsics = Intrinsics(np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), np.zeros(5))
        root = np.random.default_rng(c).standard_normal((15, 15)) * 1e-3
        pose = Rigid(rotation, -rotation @ position)
        cameras.append(Camera(f"cam{c}", (1280, 720), intrinsics, pose, covariance=root @ root.T))
    return Rig(tuple(cameras))


def moved_world(seed=0):
    rng = np.random.default_rng(seed)
    return Rigid(rotations_of(rng.uniform(-1.0, 1.0, (1, 3)))[0], rng.uniform(-2.0, 2.0, 3))


def marks_of(rig, points=MARKS):
    return np.stack([camera.project(points)[0] for camera in rig.cameras], axis=1)


def test_marked_points_give_the_floor():
    rig = ring()
    pixels = marks_of(rig)
    pixels[0, 2:] = np.nan  # two views are enough
    found = moved_rig(
        elsewhere := moved_rig(rig, moved_world()), world_on_floor(elsewhere, MarkedFloor(NAMES, pixels))
    )
    assert found.up == (0.0, 0.0, 1.0)
    for own, true in zip(found.cameras, rig.cameras):
        np.testing.assert_allclose(own.centre, true.centre, atol=1e-7)
        np.testing.assert_allclose(own.cam_from_world.rotation, true.cam_from_world.rotation, atol=1e-7)


def test_the_covariance_moves_with_the_world():
    rig, world = ring(1), moved_world(3)
    camera, found = rig.cameras[0], moved_rig(rig, world).cameras[0]
    point = np.array([[0.4, -0.3, 0.9]])
    step = 1e-6
    pixels = []
    for own, at in ((camera, point), (found, world.apply(point))):
        columns = []
        for k in range(6):
            change = np.zeros(6)
            change[k] = step
            pose = own.cam_from_world
            turn = rotations_of(change[None, :3])[0] @ pose.rotation
            bent = replace(own, cam_from_world=Rigid(turn, pose.translation + change[3:]))
            columns.append((bent.project(at)[0] - own.project(at)[0])[0] / step)
        by_pose = np.stack(columns, axis=1)
        pixels.append(by_pose @ own.covariance[:6, :6] @ by_pose.T)
    np.testing.assert_allclose(pixels[1], pixels[0], rtol=1e-4)


def test_a_scaled_rig_sees_scaled_points_at_the_same_pixels():
    rig = ring()
    found = scaled_rig(rig, 1.1)
    np.testing.assert_allclose(marks_of(found, 1.1 * MARKS), marks_of(rig), atol=1e-9)
    np.testing.assert_allclose(found.cameras[0].covariance[3, 3], 1.21 * rig.cameras[0].covariance[3, 3])


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda pixels: (NAMES[:2], pixels[:2]), "2 points on the floor; mark at least 3"),
        (
            lambda pixels: (NAMES, np.where(np.arange(4)[None, :, None] > 0, np.nan, pixels)),
            "point a is marked in 1",
        ),
        (
            lambda pixels: (NAMES, pixels + 60.0 * (np.arange(16).reshape(4, 4, 1) == 9)),
            "floor point c: its mark",
        ),
    ],
)
def test_wrong_marks_are_named(change, message):
    rig = ring()
    with pytest.raises(CalibrationError, match=message):
        world_on_floor(rig, MarkedFloor(*change(marks_of(rig))))


def test_points_on_one_line_give_no_floor():
    rig = ring()
    line = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    with pytest.raises(CalibrationError, match="lie on one line"):
        world_on_floor(rig, MarkedFloor(NAMES[:3], marks_of(rig, line)))
