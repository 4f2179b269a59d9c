from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.assembly.dynamic_programming import Correspondence
from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.simulation.studio import scaled

LENS = np.array([-0.1, 0.02, 0.0, 0.0, 0.0])
MATRIX = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
LOOK = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # along +y, z up
CAMERAS = tuple(
    Camera(name, (640, 480), Intrinsics(MATRIX, LENS), Rigid(LOOK, -LOOK @ (x, -4.0, 1.0)))
    for name, x in (("a", 0.0), ("b", 1.0))
)
RIG = Rig(CAMERAS)
JOINTS = np.array([[0.0, 0.0, 1.0], [0.2, 0.5, 1.3], [-0.3, 0.3, 0.7]])


def detections(offsets, scores=0.9):
    """One 2D person per offset (dx, dy) px from the projections of JOINTS; the third joint is far off."""
    views = []
    for camera in CAMERAS:
        pixels = camera.project(JOINTS)[0] + np.array([[0.0], [0.0], [50.0]])
        points = pixels + np.array(offsets, float).reshape(-1, 1, 2)
        values = np.full(points.shape[:2], scores)
        views.append(ViewDetections(camera.name, 0, 0, (640, 480), "h", points, values, values[:, 0]))
    return DetectionSet(0, 0, "h", tuple(views))


def matcher(item, gate=10.0, shift=(0.0, 0.0, 0.0), rig=RIG):
    return Correspondence(item, rig, JOINTS + shift, np.arange(3), gate)


ALL = np.arange(3)


def test_the_closest_is_found():
    free = matcher(detections([(6.0, 0.0), (0.0, -3.0)]))
    assert free.claims_of(ALL).tolist() == [[1, 1], [1, 1], [-1, -1]]
    assert free.claims_of(ALL[1:2]).tolist() == [[1, 1]]


def test_what_was_claimed_is_gone():
    free = matcher(detections([(6.0, 0.0), (0.0, -3.0)]))
    free.claim(ALL, np.array([[1, -1], [-1, -1], [-1, -1]]))
    assert free.claims_of(ALL).tolist() == [[0, 1], [1, 1], [-1, -1]]
    free.claim(ALL, free.claims_of(ALL))
    free.claim(ALL, free.claims_of(ALL))
    assert (free.claims_of(ALL) == -1).all()


@pytest.mark.parametrize(("pixels", "expected"), [(9.9, 0), (10.1, -1)])
def test_the_gate_is_a_distance_in_the_image(pixels, expected):
    free = matcher(detections([(pixels, 0.0)]))
    assert free.claims_of(ALL)[0].tolist() == [expected, expected]


@pytest.mark.parametrize(("pixels", "expected"), [(19.8, 0), (20.2, -1)])
def test_the_gate_grows_with_the_image(pixels, expected):
    large = Rig(tuple(scaled(camera, 2.0) for camera in CAMERAS))
    views = [
        replace(view, image_size=(1280, 960), points=camera.project(JOINTS)[0][None] + (pixels, 0.0))
        for view, camera in zip(detections([(0.0, 0.0)]).views, large.cameras)
    ]
    free = matcher(DetectionSet(0, 0, "h", tuple(views)), rig=large)
    assert free.claims_of(ALL)[0].tolist() == [expected, expected]


def test_missing_2d_joints_are_not_claimed():
    assert (matcher(detections([(0.0, 0.0)], 0.0)).claims_of(ALL) == -1).all()
    empty = DetectionSet(0, 0, "h", ())
    assert matcher(empty).claims_of(ALL).shape == (3, 0)
    assert (matcher(detections([])).claims_of(ALL) == -1).all()


def test_behind_a_camera_nothing_is_claimed():
    free = matcher(detections([(0.0, 0.0)]), gate=1e6, shift=(0.0, -20.0, 0.0))
    assert (free.claims_of(ALL) == -1).all()
