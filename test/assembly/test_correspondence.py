import numpy as np
import pytest

from panoptic_ros.assembly.correspondence import Correspondence
from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid

LENS = np.array([-0.1, 0.02, 0.0, 0.0, 0.0])
MATRIX = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
LOOK = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # along +y, z up
CAMERAS = tuple(
    Camera(name, (640, 480), Intrinsics(MATRIX, LENS), Rigid(LOOK, -LOOK @ (x, -4.0, 1.0)))
    for name, x in (("a", 0.0), ("b", 1.0))
)
RIG = Rig(CAMERAS)
JOINTS = np.array([[0.0, 0.0, 1.0], [0.2, 0.5, 1.3], [np.nan] * 3])


def detections(offsets, scores=0.9):
    """One 2D person per offset (dx, dy) px from the projections of JOINTS; the third joint at (5, 5)."""
    views = []
    for camera in CAMERAS:
        pixels = np.where(np.isnan(JOINTS), 5.0, 0.0)[:, :2] + np.nan_to_num(camera.project(JOINTS)[0])
        points = pixels + np.array(offsets, float).reshape(-1, 1, 2)
        values = np.full(points.shape[:2], scores)
        views.append(ViewDetections(camera.name, 0, 0, (640, 480), "h", points, values, values[:, 0]))
    return DetectionSet(0, 0, "h", tuple(views))


def test_the_closest_is_found_and_missing_joints_claim_nothing():
    free = Correspondence(detections([(6.0, 0.0), (0.0, -3.0)]), RIG, 0.08)
    assert free.nearest(JOINTS).tolist() == [[1, 1], [1, 1], [-1, -1]]


def test_what_was_claimed_is_gone():
    free = Correspondence(detections([(6.0, 0.0), (0.0, -3.0)]), RIG, 0.08)
    free.claim(np.array([[1, -1], [-1, -1], [-1, -1]]))
    assert free.nearest(JOINTS).tolist() == [[0, 1], [1, 1], [-1, -1]]
    free.claim(free.nearest(JOINTS))
    free.claim(free.nearest(JOINTS))
    assert (free.nearest(JOINTS) == -1).all()


@pytest.mark.parametrize(("pixels", "expected"), [(9.9, 0), (10.1, -1)])
def test_the_gate_is_a_distance_at_the_depth_of_the_joint(pixels, expected):
    free = Correspondence(detections([(pixels, 0.0)]), RIG, 0.08)  # 500 px * 0.08 m / 4 m = 10 px
    assert free.nearest(JOINTS)[0].tolist() == [expected, expected]


def test_weak_and_missing_2d_joints_are_not_claimed():
    assert (Correspondence(detections([(0.0, 0.0)], 0.2), RIG, 0.08, 0.3).nearest(JOINTS) == -1).all()
    empty = DetectionSet(0, 0, "h", ())
    assert Correspondence(empty, RIG, 0.08).nearest(JOINTS).shape == (3, 0)
    assert (Correspondence(detections([]), RIG, 0.08).nearest(JOINTS) == -1).all()


def test_behind_a_camera_nothing_is_claimed():
    free = Correspondence(detections([(0.0, 0.0)]), RIG, 1e6)
    assert (free.nearest(JOINTS - (0.0, 20.0, 0.0)) == -1).all()
