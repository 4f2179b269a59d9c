"""Bad rigs: one clear line that names the file, the camera and the key."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError, UserError
from panoptic_ros.io.rigs import WRITABLE, read_rig, write_rig
from panoptic_ros.io.rigs.rig_json import dump

Change = Callable[[dict[str, Any]], Any]


def put(key: str, value: Any) -> Change:
    return lambda document: document["cameras"][1].__setitem__(key, value)


def drop(key: str) -> Change:
    return lambda document: document["cameras"][1].pop(key)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (drop("K"), "camera cam01 has no 'K'"),
        (drop("name"), "camera number 1 has no 'name'"),
        (drop("distortion"), "camera cam01 has no 'distortion'"),
        (put("name", "cam00"), "2 cameras of the rig are called 'cam00'"),
        (put("name", ""), "expected a name"),
        (put("K", [[1, 2], [3, 4]]), "'K' is 2 x 2, expected 3 x 3"),
        (put("K", [[1, 2], [3]]), "'K' is not an array of numbers"),
        (put("K", [[9, 0, 0], [0, 9, 0], [3, 2, 1]]), "is it transposed"),
        (put("K", [[-9, 0, 0], [0, 9, 0], [0, 0, 1]]), "focal lengths must be positive"),
        (put("R", np.eye(4).tolist()), "'R' is 4 x 4, expected 3 x 3"),
        (put("R", (2 * np.eye(3)).tolist()), "camera cam01: a rotation matrix is off by 3"),
        (put("R", np.diag([1, 1, -1]).tolist()), "camera cam01: a rotation matrix mirrors"),
        (put("R", [[float("nan"), 0, 0]] * 3), "'R' has numbers that are not finite"),
        (put("t", [1, 2]), "'t' is 2, expected 3"),
        (put("t", 5), "'t' is a single number"),
        (put("t", ["a", "b", "c"]), "'t' is not an array of numbers"),
        (put("distortion", [1] * 7), "7 distortion coefficients; a brown lens has 4, 5, 8, 12, 14 of them"),
        (put("distortion", [1] * 15), "15 distortion coefficients; a brown lens has only k1 k2 p1 p2 k3 k4"),
        (put("image_size", [0, 480]), "expected a whole number of pixels above 0"),
        (put("image_size", [640.5, 480]), "expected a whole number of pixels above 0"),
        (put("image_size", "640x480"), "'image_size' is not an array of numbers"),
        (lambda d: d.update(units="mm"), "units are 'mm'"),
        (lambda d: d.update(cameras=[]), "'cameras' is not a list of cameras, or an empty one"),
        (lambda d: d.update(cameras={"a": 1}), "'cameras' is not a list of cameras"),
        (lambda d: d.update(cameras=[3]), "camera number 0 is a int"),
    ],
)
def test_rig_json(tmp_path: Path, rig: Rig, change: Change, says: str) -> None:
    document = json.loads(dump(rig))
    change(document)
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(document))
    with pytest.raises(CalibrationError, match=says) as caught:
        read_rig(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"   \n",
        b"hello",
        b"{}",
        b"[1, 2]",
        b'{"cameras": []}',
        b"\x00\xff\xfe",
        b"<html></html>",
        b"a = 1",
        gzip.compress(b"{}", mtime=0),
        b'{"cameras": [{"name": "a"}]}',
    ],
)
def test_what_is_no_rig_lists_what_is_read(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(CalibrationError, match=r"these are read: rig.json"):
        read_rig(tmp_path / "x")
    with pytest.raises(CalibrationError, match=r"these are read: rig.json"):
        read_rig(tmp_path)


@pytest.mark.parametrize(
    "content", [b'{"format": ', b"<calibration><cameras>", b"<!DOCTYPE a [<!ENTITY b 'c'>]><a/>"]
)
def test_broken_files(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(CalibrationError, match=r"broken|entities"):
        read_rig(tmp_path / "x")


def edit(rig: Rig, path: Path, name: str, old: str, new: str) -> None:
    write_rig(path, rig, name)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("qca", "<transform", "<transfer", "camera cam00 has no <transform>"),
        ("qca", 'serial="cam00"', "", "camera number 0 has no 'serial'"),
        ("qca", "focalLengthU", "focal", "'focalLengthU' of <intrinsic> is None"),
        ("qca", 'skew="0.0"', 'skew="nan"', "not finite"),
        ("qca", '<fov_video left="0"', '<fov_video left="0.5"', "width of fov_video"),
        ("qca", 'viewrotation="0"', 'video_resolution="full"', "video_resolution is 'full'"),
        ("panoptic", '"resolution"', '"size"', "camera cam00 has no 'resolution'"),
        ("panoptic", '"t": [', '"t": [[1], ', "'t' is 4 x 1"),
        ("aniposelib", "rotation = [", "rotation = [1.0, ", "'rotation' is 4, expected 3"),
        ("aniposelib", "size", "sizes", "camera cam00 has no 'size'"),
        ("aniposelib", 'name = "cam00"', 'name = "cam01"', "2 cameras of the rig are called 'cam01'"),
        ("aniposelib", 'unit = "m"', 'unit = "inch"', "'inch', expected one of m, cm, mm"),
        ("caliscope", "fisheye = false", "fisheye = true", "5 distortion .* a fisheye lens has only"),
        ("caliscope", "fisheye = false", "fisheye = 1", "'fisheye' is 1, expected true or false"),
        ("panoptic", '"resolution"', '"type": ["hd"], "resolution"', "'type' is ..hd.., expected text"),
        ("caliscope", "rotation = ", "rotation = 3 # ", "'rotation' is a single number"),
        ("qca", 'viewrotation="0"', 'video_resolution="0p"', "video_resolution is '0p'"),
    ],
)
def test_other_files(tmp_path: Path, rig: Rig, name: str, old: str, new: str, says: str) -> None:
    edit(rig, tmp_path / "x", name, old, new)
    with pytest.raises(CalibrationError, match=says):
        read_rig(tmp_path / "x")


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("cam00.yaml", "plumb_bob", "omni", "camera cam00: the distortion model is 'omni'"),
        ("cam00.yaml", "plumb_bob", "equidistant", "camera cam00: 5 distortion coefficients; a fisheye"),
        ("cam00.yaml", "image_width", "width", "cam00.yaml has no 'image_width'"),
        ("cam00.yaml", "camera_matrix:", "matrix:", "cam00.yaml has no 'camera_matrix'"),
        ("poses.yaml", "cam02:", "cam07:", "camera cam07 has no cam07.yaml, although poses.yaml"),
        ("poses.yaml", "frame_id: world", "frame_id: []", "poses.yaml: 'frame_id' is"),
        ("poses.yaml", "rotation:\n    - ", "rotation:\n    - 1", "no unit quaternion"),
        ("poses.yaml", "poses:", "others:", "poses.yaml has no 'poses'"),
    ],
)
def test_ros_folder(tmp_path: Path, rig: Rig, file: str, old: str, new: str, says: str) -> None:
    write_rig(tmp_path / "rig", rig, "camera_info")
    path = tmp_path / "rig" / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(CalibrationError, match=says):
        read_rig(tmp_path / "rig")


def test_options_that_mean_nothing(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.json", rig)
    with pytest.raises(UsageError, match=r"has no use for unit"):
        read_rig(tmp_path / "rig.json", unit="mm")
    with pytest.raises(UsageError, match=r"unknown unit of length 'ft'"):
        read_rig(tmp_path / "rig.json", unit="ft")


@pytest.mark.parametrize("name", [n for n in WRITABLE if n != "camera_info"])
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damage_anywhere_gives_a_rig_or_an_error_of_the_user(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("damage") / "rig"
    path.write_bytes(GOOD[name])
    at = data.draw(st.integers(0, len(GOOD[name]) - 1))
    length = data.draw(st.integers(0, 12))
    new = data.draw(st.sampled_from([b"", b"null", b"NaN", b"-", b"[]", b'"', b"1e999", b"}", b"\n"]))
    path.write_bytes(GOOD[name][:at] + new + GOOD[name][at + length :])
    try:
        read_rig(path)
    except UserError as error:
        assert "\n" not in str(error)


def _good(name: str, tmp: Path) -> bytes:
    from panoptic_ros.domain import Camera
    from panoptic_ros.geometry import Intrinsics, Rigid

    lens = Intrinsics(np.array([[800.0, 0, 320], [0, 810.0, 240], [0, 0, 1]]), np.array([0.1, 0.2]))
    poses = [Rigid(np.eye(3), np.array([i, 2.0, 3.0])) for i in (0, 1)]
    cameras = tuple(Camera(f"c{i}", (640, 480), lens, pose) for i, pose in enumerate(poses))
    write_rig(tmp / name, Rig(cameras), name)
    return (tmp / name).read_bytes()


@pytest.fixture(scope="module", autouse=True)
def good_files(tmp_path_factory: pytest.TempPathFactory) -> None:
    for name in WRITABLE:
        if name != "camera_info":
            GOOD[name] = _good(name, tmp_path_factory.mktemp("good"))


GOOD: dict[str, bytes] = {}
