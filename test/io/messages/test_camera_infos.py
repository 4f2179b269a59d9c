"""The cameras that CameraInfo describes: lenses, binning, regions, rectified images."""

from dataclasses import replace

import captures
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.messages import bag_messages, camera_info_message
from panoptic_ros.io.messages.camera_infos import camera_from_info, info_topic, rectified

CAMERA = captures.RIG.cameras[0]


def test_camera_info_and_back():
    info = camera_info_message(CAMERA, 7, bag_messages())
    back = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    assert np.array_equal(back.intrinsics.matrix, CAMERA.intrinsics.matrix)
    assert np.array_equal(back.intrinsics.distortion, CAMERA.intrinsics.distortion)
    info.distortion_model, info.d = "omni", np.ones(4)
    with pytest.raises(DataError, match="camera_info of cam0: the distortion model is 'omni'; models"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    info.k = np.zeros(9)
    with pytest.raises(DataError, match="its driver is not calibrated"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    info = camera_info_message(CAMERA, 7, bag_messages())
    info.width = info.height = 0
    with pytest.raises(DataError, match="states images of 0 x 0: its driver is not calibrated"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)


@pytest.mark.parametrize("count", [8, 12, 14])
def test_camera_info_of_a_lens_with_more_terms(count):
    terms = [0.2, -0.1, 1e-3, 2e-3, 0.05, 0.1, -0.05, 0.02, 1e-3, 2e-3, 1e-3, 2e-3, 0.01, 0.02][:count]
    camera = replace(CAMERA, intrinsics=Intrinsics(CAMERA.intrinsics.matrix, terms))
    info = camera_info_message(camera, 7, bag_messages())
    assert info.distortion_model == "rational_polynomial" and len(info.d) == count
    back = camera_from_info(info, camera.name, camera.cam_from_world)
    assert np.array_equal(back.intrinsics.distortion, camera.intrinsics.distortion)


def test_binned_and_cut_images_show_the_world_where_the_whole_does():
    info = camera_info_message(CAMERA, 7, bag_messages())  # 1280 x 720
    whole = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    world = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + [0, 0, 1]
    pixels, seen = whole.project(world)
    info.binning_x, info.binning_y = 2, 4
    binned = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    assert binned.image_size == (640, 180) and seen.all()
    # A binned pixel is the mean of 2 x 4; the centre of the first lies at (0.5, 1.5) of the whole.
    assert np.allclose(binned.project(world)[0], (pixels - [0.5, 1.5]) / [2, 4], atol=1e-9)
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 200, 100, 800, 600
    cut = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    assert cut.image_size == (400, 150)
    assert np.allclose(cut.project(world)[0], (pixels - [200.5, 101.5]) / [2, 4], atol=1e-9)
    info.binning_x = info.binning_y = info.roi.width = info.roi.height = 0  # 0: not binned, to the border
    assert camera_from_info(info, CAMERA.name, CAMERA.cam_from_world).image_size == (1080, 620)


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


def test_camera_info_lies_beside_the_images():
    assert info_topic("/a/image_raw/compressed") == info_topic("/a/depth") == "/a/camera_info"
