"""The cameras that CameraInfo describes, of raw and of rectified images."""
import captures
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import bag_messages, camera_info_message
from panoptic_ros.io.messages.images import camera_from_info, rectified

CAMERA = captures.RIG.cameras[0]


def test_camera_info_and_back():
    info = camera_info_message(CAMERA, 7, bag_messages())
    back = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    assert np.array_equal(back.intrinsics.matrix, CAMERA.intrinsics.matrix)
    assert np.array_equal(back.intrinsics.distortion, CAMERA.intrinsics.distortion)
    info.k = np.zeros(9)
    with pytest.raises(DataError, match="its driver is not calibrated"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    info.distortion_model, info.d = "rational_polynomial", np.ones(8)
    with pytest.raises(DataError, match="'rational_polynomial'; supported: plumb_bob and equidistant"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)


def test_rectified_images_show_the_world_where_opencv_puts_it():
    info = camera_info_message(CAMERA, 7, bag_messages())
    turn = Rotation.from_rotvec([0.02, -0.05, 0.01]).as_matrix()
    projection = np.array([[900.0, 0, 650, -120], [0, 900, 350, 0], [0, 0, 1, 0]])
    info.d, info.r, info.p = np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]), turn.reshape(9), projection.reshape(12)
    raw = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    before_it = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + [0, 0, 4]
    world = CAMERA.cam_from_world.inverse().apply(before_it)
    pixels, _ = raw.project(world)
    expected = cv2.undistortPoints(
        pixels[:, None], raw.intrinsics.matrix, info.d, R=turn, P=projection[:, :3]
    )[:, 0]
    found, seen = rectified(raw, info).project(world)
    assert seen.all() and np.abs(found - expected).max() < 1e-3


def test_what_cannot_be_rectified():
    info = camera_info_message(CAMERA, 7, bag_messages())
    info.p = np.zeros(12)
    with pytest.raises(DataError, match="cannot be rectified"):
        rectified(CAMERA, info)
