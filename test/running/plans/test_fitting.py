"""A rig fitted to images of bags: binned, cut, resized, or with width and height exchanged."""

from contextlib import contextmanager
from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, camera_info_message, image_message
from panoptic_ros.running.plans.bag_topics import BagChoice, image_streams
from panoptic_ros.running.plans.fitting import fit_to_bags

RIG = Rig(tuple(captures.look_at(f"cam{k}", (4.0, k - 0.5, 1.5), size=(64, 48), focal=40.0) for k in (0, 1)))


@contextmanager
def opened(path, size, change=None):
    """A bag with images of that size of cam0, beside the CameraInfo of the rig, if any, and its streams."""
    with BagWriter(path) as bag:
        for camera in RIG.cameras:
            width, height = size if camera.name == "cam0" else camera.image_size
            frame = ViewFrame(camera.name, 5, 0, np.zeros((height, width, 3), np.uint8))
            bag.write(f"/{camera.name}/image_raw", 5, image_message(frame, bag_messages()))
            info = camera_info_message(camera, 5, bag_messages())
            if change is not None and camera.name == "cam0":
                change(info)
            if change is not None:
                bag.write(f"/{camera.name}/camera_info", 5, info)
    with BagReader(path) as bag:
        yield {stream: bag for stream in image_streams(BagChoice(), [bag], RIG, "panoptic19")}, [bag]


def fit(path, size, change=None, policy="strict", rig=RIG):
    with opened(path, size, change) as (bag_of, bags):
        return fit_to_bags(rig, bag_of, bags, policy)


def binned(info):
    info.binning_x = info.binning_y = 2


def cut(info):
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 8, 4, 40, 30


@pytest.mark.parametrize(
    ("size", "change", "scale", "shift"), [((32, 24), binned, 0.5, 0.25), ((40, 30), cut, 1.0, (8.0, 4.0))]
)
def test_camera_info_tells_how_images_were_binned_or_cut(tmp_path, size, change, scale, shift):
    fitted, (line,) = fit(tmp_path / "bag", size, change)
    assert f"images of {size[0]}x{size[1]} are binned or cropped from 64x48" in line
    assert fitted.names == RIG.names and fitted.camera("cam0").image_size == size
    assert fitted.camera("cam1") is RIG.camera("cam1")
    point = np.array([0.1, 0.2, 1.3])
    expected = scale * RIG.camera("cam0").project(point)[0] - shift
    np.testing.assert_allclose(fitted.camera("cam0").project(point)[0], expected, atol=1e-9)


def test_images_of_another_size_need_a_policy(tmp_path):
    with pytest.raises(DataError, match=r"topic /cam0/image_raw: .* images are 32x24 .*size policy 'scale'"):
        fit(tmp_path / "a", (32, 24))
    with pytest.raises(DataError, match="images are 32x24"):
        fit(tmp_path / "b", (32, 24), lambda info: None)  # CameraInfo of the whole: the images were resized
    fitted, (line,) = fit(tmp_path / "c", (32, 24), None, "scale")
    assert fitted.camera("cam0").image_size == (32, 24) and "calibrated at 64x48, images are 32x24" in line


def test_a_driver_without_calibration_changes_nothing(tmp_path):
    def uncalibrated(info):
        info.width = info.height = 0

    fitted, notices = fit(tmp_path / "bag", (64, 48), uncalibrated)
    assert notices == () and fitted.camera("cam0") is RIG.camera("cam0")


def test_width_and_height_of_the_rig_that_are_exchanged(tmp_path):
    exchanged = replace(RIG, cameras=(replace(RIG.cameras[0], image_size=(48, 64)), RIG.cameras[1]))
    fitted, (line,) = fit(tmp_path / "bag", (64, 48), rig=exchanged)
    assert fitted.camera("cam0").image_size == (64, 48) and "taken as exchanged" in line
