"""Units, axes and pixels of the foreign formats, on files written out by hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.io.rigs import read_rig

# One camera 2 m above the floor, 3 m in front of the origin (at y = -3), level, looking along +y.
# Its axes in a z-up world: right = +x, down = -z, forward = +y.
LEVEL = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
K = [[800, 0, 320], [0, 810, 240], [0, 0, 1]]


def check_level_camera(rig: Rig, name: str) -> None:
    (camera,) = rig.cameras
    assert camera.name == name and camera.image_size == (640, 480)
    np.testing.assert_allclose(camera.centre, [0.0, -3.0, 2.0], atol=1e-12)
    pixel, seen = camera.project(np.array([0.3, 0.0, 1.5]))  # 0.3 m right, 0.5 m below the axis
    assert seen
    np.testing.assert_allclose(pixel, [320 + 800 * 0.1, 240 + 810 * 0.5 / 3], atol=1e-9)


def save(path: Path, document: object) -> Path:
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def test_cmu_panoptic_is_centimetres_and_y_down(tmp_path: Path) -> None:
    # In its world the camera is 200 cm above the floor y = 0: y = -200; our y is its z.
    camera = {
        "name": "00_00",
        "type": "hd",
        "panel": 0,
        "node": 0,
        "resolution": [640, 480],
        "K": K,
        "distCoef": [0, 0, 0, 0, 0],
        "R": np.eye(3).tolist(),
        "t": [[0], [200], [300]],
    }
    check_level_camera(read_rig(save(tmp_path / "c.json", {"cameras": [camera]})), "00_00")


def test_cmu_panoptic_selection(tmp_path: Path) -> None:
    rows = [("00_00", "hd", 0), ("01_01", "vga", 1), ("02_01", "vga", 2)]
    cameras = [
        {
            "name": name,
            "type": kind,
            "panel": panel,
            "resolution": [640, 480],
            "K": K,
            "distCoef": [0, 0, 0, 0, 0],
            "R": np.eye(3).tolist(),
            "t": [[0], [0], [0]],
        }
        for name, kind, panel in rows
    ]
    path = save(tmp_path / "c.json", {"cameras": cameras})
    assert read_rig(path).names == ("00_00", "01_01", "02_01")
    assert read_rig(path, types=["vga"]).names == ("01_01", "02_01")
    assert read_rig(path, types=["vga"], panels=[2]).names == ("02_01",)
    with pytest.raises(UsageError, match="there are \\['hd', 'vga'\\]"):
        read_rig(path, types=["kinect"])


@pytest.mark.parametrize("unit,factor", [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_pack_with_stated_unit(tmp_path: Path, unit: str, factor: float) -> None:
    t = [0.0, 2.0 * factor, 3.0 * factor]
    camera = {"id": 7, "width": 640, "height": 480, "K": K, "R": LEVEL, "t": t}
    check_level_camera(read_rig(save(tmp_path / "c.json", {"unit": unit, "cameras": [camera]})), "7")
    column = {"name": "a", "resolution": [640, 480], "K": K, "R": LEVEL, "t": [[v] for v in t]}
    check_level_camera(read_rig(save(tmp_path / "d.json", {"units": unit, "cameras": [column]})), "a")


def test_pack_with_y_down(tmp_path: Path) -> None:
    camera = {"name": "a", "width": 640, "height": 480, "K": K, "R": np.eye(3).tolist(), "t": [0, 2, 3]}
    document = {"unit": "m", "to_z_up": "...", "cameras": [camera]}
    check_level_camera(read_rig(save(tmp_path / "c.json", document)), "a")


QCA = """<?xml version='1.0' encoding='ASCII'?>
<calibration><cameras>
 <camera active="0" serial="off" model="none"/>
 <camera active="1" serial="cam01" model="none" viewrotation="0">
  <fov_video left="10" top="20" right="649" bottom="499"/>
  <transform r11="1" r12="0" r13="0" r21="0" r22="0" r23="1" r31="0" r32="-1" r33="0"
   x="0" y="-3000" z="2000"/>
  <intrinsic focalLengthU="51200" focalLengthV="51840" centerPointU="21120" centerPointV="16640" skew="0"
   radialDistortion1="{k1}" radialDistortion2="0" radialDistortion3="0"
   tangentalDistortion1="0" tangentalDistortion2="0" sensorMaxU="40960" sensorMaxV="30719"/>
 </camera></cameras></calibration>"""


def test_qualisys(tmp_path: Path) -> None:
    # x right, y up, z backward: backward is -y of the world, so the third row is (0, -1, 0).
    check_level_camera(read_rig(save(tmp_path / "a.qca.txt", QCA.format(k1=0))), "cam01")


def test_qualisys_distortion_is_not_in_subpixels(tmp_path: Path) -> None:
    rig = read_rig(save(tmp_path / "a.qca.txt", QCA.format(k1=-0.046)))
    assert rig.cameras[0].intrinsics.distortion[0] == -0.046


def test_qualisys_video_smaller_than_the_sensor(tmp_path: Path) -> None:
    text = QCA.format(k1=0).replace('serial="cam01"', 'serial="cam01" video_resolution="540p"')
    camera = read_rig(save(tmp_path / "a.qca.txt", text)).cameras[0]
    assert camera.image_size == (320, 240) and camera.intrinsics.matrix[0, 0] == 400.0


def test_qualisys_without_video_window_takes_the_sensor(tmp_path: Path) -> None:
    text = "\n".join(line for line in QCA.format(k1=0).splitlines() if "fov_video" not in line)
    camera = read_rig(save(tmp_path / "a.qca.txt", text)).cameras[0]
    assert camera.image_size == (641, 480) and camera.intrinsics.matrix[0, 2] == 330.0


ROTATION = "rotation = [1.5707963267948966, 0.0, 0.0]"  # about x by +90 degrees: LEVEL
TABLE = """
size = [640, 480]
matrix = [[800.0, 0.0, 320.0], [0.0, 810.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
"""


def test_aniposelib_in_metres_and_millimetres(tmp_path: Path) -> None:
    head = f'[cam_0]\nname = "A"{TABLE}{ROTATION}\n'
    tail = "[metadata]\nadjusted = false\nerror = 0.1\n"
    metres = save(tmp_path / "a.toml", f"{head}translation = [0.0, 2.0, 3.0]\n{tail}")
    check_level_camera(read_rig(metres), "A")
    millimetres = save(tmp_path / "b.toml", f"{head}translation = [0.0, 2000.0, 3000.0]\n{tail}")
    check_level_camera(read_rig(millimetres, unit="mm"), "A")
    stated = save(tmp_path / "c.toml", f'{head}translation = [0.0, 200.0, 300.0]\n{tail}unit = "cm"\n')
    check_level_camera(read_rig(stated), "A")


def test_toml_in_millimetres_is_not_taken_for_metres(tmp_path: Path) -> None:
    far = "".join(
        f'[cam_{i}]\nname = "{i}"{TABLE}{ROTATION}\ntranslation = [{900.0 * i}, 2000.0, 3000.0]\n'
        for i in (0, 1)
    )
    with pytest.raises(CalibrationError, match=r"900 m apart.*--unit mm"):
        read_rig(save(tmp_path / "a.toml", far))
    assert read_rig(tmp_path / "a.toml", unit="mm").cameras[1].centre[0] == pytest.approx(-0.9)


def test_caliscope(tmp_path: Path) -> None:
    pose = f"{TABLE}{ROTATION}\ntranslation = [0.0, 2.0, 3.0]\n"
    ignored = "[cameras.4]\nignore = true\nsize = [640, 480]\n"
    new = save(tmp_path / "a.toml", f"[cameras.3]\ncam_id = 3\nfisheye = false{pose}{ignored}")
    check_level_camera(read_rig(new), "cam_3")
    old = save(tmp_path / "b.toml", f"[cameras.3]\nport = 3\nrotation_count = 0{pose}")
    check_level_camera(read_rig(old), "port_3")
    legacy = pose.replace(ROTATION, "rotation = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]")
    check_level_camera(read_rig(save(tmp_path / "c.toml", f"[cameras.3]\ncam_id = 3{legacy}")), "cam_3")


def test_ros_folder(tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(
        "image_width: 640\nimage_height: 480\ncamera_name: left\n"
        "camera_matrix: {rows: 3, cols: 3, data: [800., 0., 320., 0., 810., 240., 0., 0., 1.]}\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0., 0., 0., 0., 0.]}\n"
    )
    # world_from_cam: about x by -90 degrees
    (tmp_path / "poses.yaml").write_text(
        "frame_id: world\nposes:\n"
        "  left: {translation: [0., -3., 2.], rotation: [-0.7071067811865476, 0., 0., 0.7071067811865476]}\n"
    )
    check_level_camera(read_rig(tmp_path), "left")
