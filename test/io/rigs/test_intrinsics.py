"""Intrinsics without poses: ROS camera_info files, JSON, and rigs whose poses mean nothing."""

import json

import numpy as np
import pytest

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.rigs.intrinsics import read_intrinsics

MATRIX = np.array([[900.0, 0.0, 640.0], [0.0, 910.0, 360.0], [0.0, 0.0, 1.0]])
TERMS = np.array([-0.1, 0.02, 0.001, -0.002, 0.0])


def rig(*places):
    lens = Intrinsics(MATRIX, TERMS)
    return Rig(
        tuple(
            Camera(f"cam{k}", (1280, 720), lens, Rigid(np.eye(3), np.array([place, 0.0, 0.0])))
            for k, place in enumerate(places)
        )
    )


def check_bare(found):
    assert found.names == ("cam0", "cam1") and found.up is None
    for camera in found.cameras:
        np.testing.assert_array_equal(camera.intrinsics.matrix, MATRIX)
        np.testing.assert_array_equal(camera.intrinsics.distortion, TERMS)
        assert camera.image_size == (1280, 720)


def test_camera_info_files_need_no_poses(tmp_path):
    write_rig(tmp_path / "info", rig(0.0, 1.0), "camera_info")
    (tmp_path / "info" / "poses.yaml").unlink()
    check_bare(read_intrinsics(tmp_path / "info"))
    assert read_intrinsics(tmp_path / "info" / "cam1.yaml").names == ("cam1",)


@pytest.mark.parametrize("head", [{}, {"format": "panoptic-rig-1", "units": "m"}])
def test_json_cameras_need_no_poses(tmp_path, head):
    rows = [
        {"name": f"cam{k}", "image_size": [1280, 720], "K": MATRIX.tolist(), "distortion": TERMS.tolist()}
        for k in range(2)
    ]
    (tmp_path / "lenses.json").write_text(json.dumps({**head, "cameras": rows}))
    check_bare(read_intrinsics(tmp_path / "lenses.json"))
    del rows[1]["K"]
    (tmp_path / "lenses.json").write_text(json.dumps({**head, "cameras": rows}))
    with pytest.raises(CalibrationError, match="lenses.json: camera cam1 has no 'K'"):
        read_intrinsics(tmp_path / "lenses.json")


def test_poses_at_one_place_rotate_no_images_and_real_ones_are_kept(tmp_path):
    write_rig(tmp_path / "bare.json", rig(0.0, 0.0))
    check_bare(read_intrinsics(tmp_path / "bare.json"))
    write_rig(tmp_path / "rig.json", rig(0.0, 2.0))
    found = read_intrinsics(tmp_path)
    assert found.up is not None and found.cameras[1].cam_from_world.translation[0] == 2.0
