"""Qualisys Track Manager calibration, .qca.txt (XML).

Lengths are millimetres, z up. The rotation maps the world to camera axes x right, y up, z backward;
x, y, z is the camera's position. Focal lengths and principal point are in 1/64 px, the latter on
the whole sensor, of which `fov_video` is the part that was filmed. The distortion coefficients
are those of the normalised image, as in OpenCV.
"""
from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree  # only parses files that the user names
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.io.rigs.fields import camera, name_of, whole_number

SUBPIXELS = 64.0
MILLIMETRES = 1000.0
FLIP = np.diag([1.0, -1.0, -1.0])  # from x right, y up, z backward to x right, y down, z forward
ROTATION = [f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
LENS = ["radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2",
        "radialDistortion3"]  # fmt: skip


def recognises(root: Any) -> bool:
    """Whether an XML root element is such a calibration."""
    return root.tag == "calibration" and root.find("cameras/camera/transform") is not None


def parse(root: Any) -> Rig:
    """A rig from the XML root; cameras that are not active or not calibrated are left out.

    Raises:
        CalibrationError: naming the camera and the attribute.
    """
    cameras = [_camera(i, item) for i, item in enumerate(root.findall("cameras/camera"))
               if item.get("active", "1") != "0" and item.get("calibrated", "true") != "false"]  # fmt: skip
    if not cameras:
        raise CalibrationError("no camera of the file is active and calibrated")
    return Rig(tuple(cameras))


def _camera(index: int, item: Any) -> Camera:
    name = name_of(item.attrib, "serial", f"camera number {index}")
    where = f"camera {name}"
    left, top, right, bottom = _filmed(item, where)
    pose = np.array(_values(item, "transform", [*ROTATION, "x", "y", "z"], where))
    fu, fv, cu, cv = _values(
        item, "intrinsic", ["focalLengthU", "focalLengthV", "centerPointU", "centerPointV"], where
    )
    (skew,) = _values(item, "intrinsic", ["skew"], where)
    lens = _values(item, "intrinsic", LENS, where)
    scale = _video_scale(item, where)
    matrix = np.array([
        [fu / SUBPIXELS, skew / SUBPIXELS, cu / SUBPIXELS - left],
        [0.0, fv / SUBPIXELS, cv / SUBPIXELS - top],
        [0.0, 0.0, 1.0],
    ])  # fmt: skip
    matrix[:2] *= scale
    rotation = FLIP @ pose[:9].reshape(3, 3)
    size = (
        whole_number((right - left + 1) * scale, f"{where}: width of fov_video"),
        whole_number((bottom - top + 1) * scale, f"{where}: height of fov_video"),
    )
    return camera(name, size, matrix, np.array(lens), rotation, -rotation @ (pose[9:] / MILLIMETRES))


def _filmed(item: Any, where: str) -> list[float]:
    """First and last column and row of the sensor that were filmed: left, top, right, bottom."""
    if item.find("fov_video") is not None:
        return _values(item, "fov_video", ["left", "top", "right", "bottom"], where)
    columns, rows = _values(item, "intrinsic", ["sensorMaxU", "sensorMaxV"], where)
    return [0.0, 0.0, columns // SUBPIXELS, rows // SUBPIXELS]


def _video_scale(item: Any, where: str) -> float:
    """How much smaller the video is than the sensor, from e.g. video_resolution="720p"."""
    text = item.get("video_resolution", "")
    if not text:
        return 1.0
    if not re.fullmatch("[0-9]{1,5}p?", text):
        raise CalibrationError(f"{where}: video_resolution is {shown(text)}, expected one like '720p'")
    return int(text.rstrip("p")) / 1080.0


def _values(item: Any, tag: str, keys: list[str], where: str) -> list[float]:
    child = item.find(tag)
    if child is None:
        raise CalibrationError(f"{where} has no <{tag}>")
    values = []
    for key in keys:
        text = child.get(key)
        try:
            values.append(float(text))
        except (TypeError, ValueError):
            found = f"{key!r} of <{tag}> is {shown(text)}"
            raise CalibrationError(f"{where}: {found}, expected a number") from None
    if not np.isfinite(values).all():
        raise CalibrationError(f"{where}: <{tag}> has numbers that are not finite")
    return values


def dump(rig: Rig) -> str:
    """The XML as text."""
    root = ElementTree.Element("calibration", {"type": "regular", "source": "panoptic_ros"})
    cameras = ElementTree.SubElement(root, "cameras")
    for item in rig.cameras:
        matrix = item.intrinsics.matrix * SUBPIXELS
        pose, (width, height) = item.cam_from_world, item.image_size
        # Solved rather than transposed: a rotation rounded to six digits still gives t back.
        centre = np.linalg.solve(pose.rotation, -pose.translation) * MILLIMETRES
        turned = (FLIP @ pose.rotation).reshape(-1)
        k1, k2, p1, p2, k3 = item.intrinsics.distortion
        node = ElementTree.SubElement(
            cameras, "camera", {"active": "1", "model": "none", "serial": item.name, "viewrotation": "0"}
        )
        fov = {"left": "0", "top": "0", "right": str(width - 1), "bottom": str(height - 1)}
        for tag in ("fov_marker", "fov_video"):
            ElementTree.SubElement(node, tag, fov)
        ElementTree.SubElement(
            node, "transform", _texts(dict(zip([*ROTATION, "x", "y", "z"], [*turned, *centre])))
        )
        intrinsic = {
            "focalLengthU": matrix[0, 0], "focalLengthV": matrix[1, 1], "skew": matrix[0, 1],
            "centerPointU": matrix[0, 2], "centerPointV": matrix[1, 2],
            **dict(zip(LENS, [k1, k2, p1, p2, k3])),
        }  # fmt: skip
        ElementTree.SubElement(node, "intrinsic", _texts(intrinsic))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _texts(values: dict[str, Any]) -> dict[str, str]:
    return {key: repr(float(value)) for key, value in values.items()}
