"""Cameras that cannot be used are left out and named; cameras that are not chosen are not even read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.rigs import read_rig, write_rig

ROTATION = {"rig.json": "R", "panoptic": "R", "caliscope": "rotation", "aniposelib": "rotation"}


def without_pose(path: Path, rig: Rig, name: str, value: Any = None) -> Path:
    """A file whose second camera has no rotation, or another value there."""
    write_rig(path, rig, name)
    key = ROTATION[name]
    if name in ("rig.json", "panoptic"):
        document = json.loads(path.read_text())
        document["cameras"][1].pop(key)
        if value is not None:
            document["cameras"][1][key] = value
        path.write_text(json.dumps(document))
        return path
    head, table = path.read_text().split("cam01", 1)
    lines = table.split("\n")
    at = next(i for i, line in enumerate(lines) if line.startswith(f"{key} ="))
    lines[at] = "" if value is None else f"{key} = {json.dumps(value)}"
    path.write_text(head + "cam01" + "\n".join(lines))
    return path


@pytest.mark.parametrize("value", [None, [], "", "None", "null", "nan"])
@pytest.mark.parametrize("name", ROTATION)
def test_cameras_without_a_pose(tmp_path: Path, rig: Rig, name: str, value: Any) -> None:
    path = without_pose(tmp_path / "rig", rig, name, value)
    found = read_rig(path)
    state = "is missing" if value is None else "is not known"
    assert found.names == ("cam00", "cam02")
    assert found.left_out == {"cam01": f"no pose ('{ROTATION[name]}' {state})"}
    told = [line for line in found.notices if "assumed" not in line]
    assert told == [f"camera cam01: left out: {found.left_out['cam01']}"]
    with pytest.raises(CalibrationError, match="camera cam01 cannot be used: no pose"):
        read_rig(path, cameras=["cam00", "cam01"])
    with pytest.raises(CalibrationError, match="camera cam01 of the rig cannot be used: no pose"):
        found.subset(["cam01"])


def test_what_is_not_chosen_is_not_read_in_xml_and_folders(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "a.qca.txt", rig)
    head, tail = (tmp_path / "a.qca.txt").read_text().split('serial="cam01"')
    (tmp_path / "a.qca.txt").write_text(f'{head}serial="cam01"{tail.replace("focalLengthU", "focal", 1)}')
    write_rig(tmp_path / "rig", rig, "camera_info")
    (tmp_path / "rig" / "cam01.yaml").write_text("camera_matrix: 3\n")
    for path in (tmp_path / "a.qca.txt", tmp_path / "rig"):
        with pytest.raises(CalibrationError, match="cam01"):
            read_rig(path)
        found = read_rig(path, cameras=["cam02", "cam00"])
        assert found.names == ("cam00", "cam02") and found.left_out == {"cam01": ""}
        assert all("assumed" in line for line in found.notices)


@pytest.mark.parametrize("name", ROTATION)
def test_a_camera_with_impossible_numbers_may_be_left_out_by_the_user(
    tmp_path: Path, rig: Rig, name: str
) -> None:
    path = without_pose(tmp_path / "rig", rig, name, [[2, 0, 0], [0, 2, 0], [0, 0, 2]])
    with pytest.raises(CalibrationError, match="camera cam01: a rotation matrix is off"):
        read_rig(path)
    found = read_rig(path, cameras=["cam00", "cam02"])
    assert found.names == ("cam00", "cam02") and found.left_out == {"cam01": ""}
    assert all("assumed" in line for line in found.notices)
    with pytest.raises(CalibrationError, match="the rig has no camera 'cam7'; it has cam00, cam01, cam02"):
        read_rig(path, cameras=["cam00", "cam7"])


def test_no_camera_with_a_pose(tmp_path: Path, rig: Rig) -> None:
    path = without_pose(tmp_path / "rig", Rig(rig.cameras[1:2]), "aniposelib")
    with pytest.raises(CalibrationError, match="no camera can be used; camera cam01: no pose"):
        read_rig(path)


def test_camera_info_without_a_pose(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig", rig, "camera_info")
    (tmp_path / "rig" / "sound.yaml").write_text("mic: cam00\n")  # no camera
    poses = yaml.safe_load((tmp_path / "rig" / "poses.yaml").read_text())
    poses["poses"].pop("cam01")
    poses["poses"]["cam02"] = None
    (tmp_path / "rig" / "poses.yaml").write_text(yaml.safe_dump(poses))
    found = read_rig(tmp_path / "rig")
    assert found.names == ("cam00",) and set(found.left_out) == {"cam01", "cam02"}
    assert "camera cam01: left out: no pose in poses.yaml" in found.notices


def test_the_verbs_say_what_they_leave_out(
    tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    path = without_pose(tmp_path / "rig.toml", rig, "aniposelib")
    assert main(["rig", "convert", str(path), str(tmp_path / "rig.json")]) == 0
    told = capsys.readouterr()
    assert "2 cameras" in told.out and "warning: camera cam01: left out: no pose" in told.err
    assert main(["rig", "convert", str(path), str(tmp_path / "b.json"), "--cameras", "cam00"]) == 0
    assert capsys.readouterr().err == ""


QCA = """<calibration><cameras>{cameras}</cameras></calibration>"""
CAMERA = """<camera serial="{serial}" {more}>
  <fov_video left="0" top="0" right="1919" bottom="{bottom}"/>
  <transform r11="1" r12="0" r13="0" r21="0" r22="0" r23="1" r31="0" r32="-1" r33="0"
   x="0" y="-3000" z="2000"/>
  <intrinsic focalLengthU="64000" focalLengthV="64000" centerPointU="61440" centerPointV="46080" skew="0"
   radialDistortion1="0" radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0"
   tangentalDistortion2="0" {sensor}/>{windows}</camera>"""


def qualisys(path: Path, *cameras: str) -> Rig:
    path.write_text(QCA.format(cameras="".join(cameras)))
    return read_rig(path)


def one(serial: str = "1", more: str = "", bottom: int = 1439, sensor: str = "", windows: str = "") -> str:
    return CAMERA.format(serial=serial, more=more, bottom=bottom, sensor=sensor, windows=windows)


def test_marker_cameras_of_qualisys(tmp_path: Path) -> None:
    found = qualisys(
        tmp_path / "a.qca.txt",
        one("11", 'video_resolution="1440p"'),
        one("21", 'video_resolution="N/A"'),
        one("22", 'video_resolution="n/a"'),
        one("23", 'model="Miqus M3"'),
        one("26", 'model="Oqus 300+" video_resolution=""'),
        one("24", 'active="0"'),
        one("25", 'calibrated="false"'),
    )
    assert found.names == ("11",) and list(found.left_out) == ["21", "22", "23", "26", "24", "25"]
    assert all("marker camera" in found.left_out[name] for name in ("21", "22", "23", "26"))
    assert "camera 24: left out: not active" in found.notices


SENSOR_1440 = 'sensorMaxU="122879.0" sensorMaxV="92159.0"'  # of a Miqus Video Plus
SENSOR_1088 = 'sensorMaxU="122879.0" sensorMaxV="69631.0"'  # of a Miqus Video
WINDOW_1088 = '<fov_marker_max left="0" top="0" right="1919" bottom="1087"/>'


@pytest.mark.parametrize(
    ("lines", "bottom", "sensor", "windows", "scale"),
    [
        ("1440p", 1439, "", "", 1.0),
        ("1440p", 1439, SENSOR_1440, "", 1.0),
        ("720p", 1439, SENSOR_1440, "", 0.5),
        ("1080p", 1439, SENSOR_1440, "", 0.75),
        ("1440p", 719, SENSOR_1440, "", 1.0),  # half of the sensor was filmed
        ("1080p", 1079, SENSOR_1088, "", 1.0),
        ("1080p", 1079, "", WINDOW_1088, 1.0),
        ("720p", 1079, SENSOR_1088, WINDOW_1088, 2.0 / 3.0),
        ("540p", 1079, "", "", 0.5),
        ("1080p", 479, "", "", 1.0),
        ("2160p", 2159, 'sensorMaxU="245759" sensorMaxV="138239"', "", 1.0),
        ("1080p", 2159, 'sensorMaxU="245759" sensorMaxV="138239"', "", 0.5),
        ("720p", 719, "", "", 1.0),
        ("720", 1079, "", "", 2.0 / 3.0),
        ("", 1439, SENSOR_1440, "", 1.0),
    ],
)
def test_videos_of_qualisys_are_as_large_as_their_lines_say(
    tmp_path: Path, lines: str, bottom: int, sensor: str, windows: str, scale: float
) -> None:
    camera = one("1", f'video_resolution="{lines}"', bottom, sensor, windows)
    (found,) = qualisys(tmp_path / "a.qca.txt", camera).cameras
    assert found.image_size == (round(1920 * scale), round((bottom + 1) * scale))
    assert found.intrinsics.matrix[0, 0] == pytest.approx(1000.0 * scale)
    assert found.intrinsics.matrix[:2, 2] == pytest.approx([960.0 * scale, 720.0 * scale])


INTRI = """%YAML:1.0
---
names:
  - "01"
K_01: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [500., 0., 320., 0., 500., 240., 0., 0., 1.]
"""
KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [512.0, 512.0, 320.0, 240.0]
"""
INFO = "image_width: 640\nimage_height: 480\ncamera_matrix:\n  data: [1]\ndistortion_model: plumb_bob\n"
FOREIGN = {
    "intri.yml": (INTRI, "EasyMocap"),
    "cameras.yml": (INTRI.replace("K_01", "M1"), "OpenCV's FileStorage"),
    "camchain.yaml": (KALIBR, "a camera chain of Kalibr"),
    "cam0.yaml": (INFO, "camera_info of one camera"),
    "4d.json": (json.dumps({"0": {"K": [1.0] * 9, "RT": [1.0] * 12}}), "4D Association"),
    "voxel.json": (
        json.dumps({"0": dict.fromkeys(("fx", "fy", "cx", "cy", "k", "p", "R", "T"), 0.0)}),
        "VoxelPose",
    ),
    "aist.json": (json.dumps([{"name": "c01", "matrix": [], "rotation": [], "translation": []}]), "AIST"),
    "studio.xcp": ("<Cameras><Camera><KeyFrames><KeyFrame/></KeyFrames></Camera></Cameras>", "Vicon"),
    "cameras.txt": ("#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE 640 480\n", "COLMAP"),
    "transforms.json": (json.dumps({"frames": [{"transform_matrix": []}]}), "nerfstudio"),
}


@pytest.mark.parametrize("file", FOREIGN)
def test_formats_of_other_programs_are_named(tmp_path: Path, file: str) -> None:
    text, title = FOREIGN[file]
    (tmp_path / file).write_text(text)
    with pytest.raises(CalibrationError, match=f"this is .*{title}.*which is not read; write its cameras as"):
        read_rig(tmp_path / file)


def test_a_broken_table_is_named_by_its_line(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.toml", rig)
    lines = (tmp_path / "rig.toml").read_text().split("\n")
    lines[2] = lines[2][:-4]
    for name in ("rig.toml", "rig"):  # recognised by its tables, whatever its name
        (tmp_path / name).write_text("\n".join(lines))
        with pytest.raises(CalibrationError, match=r"the file is broken: .*TOML: .*line [34]") as caught:
            read_rig(tmp_path / name)
        assert "\n" not in str(caught.value)
