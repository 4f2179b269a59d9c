"""Read and write Qualisys Track Manager (QTM) calibrations, .qca.txt (XML).

Lengths are in millimetres, z is up. The rotation maps the world to camera axes x right, y up, z backward; x,
y, z is the camera's position. Focal lengths and principal point are in 1/64 px. The principal point refers to
the whole sensor; `fov_video` is the filmed part of it. The distortion coefficients are those of the
normalised image, as in OpenCV. QTM shows images rotated clockwise by `viewrotation` degrees. Its videos and
calibrations are without this rotation.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree  # only parses files that the user names
from functools import partial
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.io.rigs.fields import UncalibratedCamera, camera, name_of, whole_number
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions

SUBPIXELS = 64.0
MILLIMETRES = 1000.0
FLIP = np.diag([1.0, -1.0, -1.0])  # from x right, y up, z backward to x right, y down, z forward
ROTATION = [f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
LENS = [
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",
    "tangentalDistortion2",
    "radialDistortion3",
]
USUAL_LINES = 1080  # default lines of a whole sensor: Miqus Video and Oqus 2c
FORMATS = (480, 540, 720, 1080, 1440, 2160)  # lines of video formats; a sensor has up to 15 rows more
BLOCK = 16  # rows: sensors of 1080 lines have 1088 rows
MARKER_MODELS = r"miqus m\d|arqus"  # marker cameras, which record no video
OTHER_MODELS = r"oqus"  # cameras without video if their video_resolution is empty
SENSOR = ("fov_marker_max", "fov_video_max")  # windows of the size of the sensor


def recognises(root: Any) -> bool:
    """Return whether an XML root element is a QTM calibration."""
    return root.tag == "calibration" and root.find("cameras/camera/transform") is not None


def parse(root: Any, options: ReadOptions) -> Rig:
    """Read a rig from the XML root, without cameras that are inactive, uncalibrated or without video.

    Raises:
        CalibrationError: naming the camera and the attribute.
    """
    taken = ReadCameras(options)
    for k, item in enumerate(root.findall("cameras/camera")):
        name = name_of(item.attrib, "serial", f"camera number {k}")
        taken.take(name, partial(_camera, name, item, taken))
    return taken.rig()


def _camera(name: str, item: Any, taken: ReadCameras) -> Camera:
    where = f"camera {name}"
    if item.get("active", "1").strip().lower() in ("0", "false"):
        raise UncalibratedCamera("not active")
    if item.get("calibrated", "true").strip().lower() in ("0", "false"):
        raise UncalibratedCamera("not calibrated")
    lines = _video_lines(item, where)
    left, top, right, bottom = _filmed(item, where)
    pose = np.array(_values(item, "transform", [*ROTATION, "x", "y", "z"], where))
    fu, fv, cu, cv = _values(
        item, "intrinsic", ["focalLengthU", "focalLengthV", "centerPointU", "centerPointV"], where
    )
    (skew,) = _values(item, "intrinsic", ["skew"], where)
    lens = _values(item, "intrinsic", LENS, where)
    scale = lines / _sensor_lines(item, lines, where) if lines else 1.0
    matrix = np.array(
        [
            [fu / SUBPIXELS, skew / SUBPIXELS, cu / SUBPIXELS - left],
            [0.0, fv / SUBPIXELS, cv / SUBPIXELS - top],
            [0.0, 0.0, 1.0],
        ]
    )
    matrix[:2] *= scale
    rotation = FLIP @ pose[:9].reshape(3, 3)
    size = (
        whole_number(round((right - left + 1) * scale, 6), f"{where}: width of fov_video"),
        whole_number(round((bottom - top + 1) * scale, 6), f"{where}: height of fov_video"),
    )
    return camera(
        name, size, matrix, np.array(lens), rotation, -rotation @ (pose[9:] / MILLIMETRES), tell=taken.tell
    )


def _filmed(item: Any, where: str) -> list[float]:
    """Return the filmed range of the sensor as first and last column and row: left, top, right, bottom."""
    if item.find("fov_video") is not None:
        return _values(item, "fov_video", ["left", "top", "right", "bottom"], where)
    columns, rows = _values(item, "intrinsic", ["sensorMaxU", "sensorMaxV"], where)
    return [0.0, 0.0, columns // SUBPIXELS, rows // SUBPIXELS]


def _video_lines(item: Any, where: str) -> int:
    """Return the lines of the video format, from e.g. video_resolution="720p"; 0 = not stated.

    Raises:
        UncalibratedCamera: for a marker camera, which has no video.
        CalibrationError: if it is something else.
    """
    text, model = item.get("video_resolution"), item.get("model", "").strip()
    marker = MARKER_MODELS if text is None else f"{MARKER_MODELS}|{OTHER_MODELS}"
    text = (text or "").strip()
    if text.lower() in ("n/a", "na", "none"):
        raise UncalibratedCamera(f"marker camera (video_resolution is {shown(text)})")
    if not text and re.match(marker, model, re.IGNORECASE):
        raise UncalibratedCamera(f"marker camera ({shown(model)} without video)")
    if not text:
        return 0
    if not re.fullmatch("[1-9][0-9]{0,4}[pP]?", text):
        raise CalibrationError(f"{where}: video_resolution is {shown(text)}, expected one like '720p'")
    return int(text.rstrip("pP"))


def _sensor_lines(item: Any, lines: int, where: str) -> int:
    """Return the lines of a video of the whole sensor, which is wider than high.

    The default is `USUAL_LINES`, if the file has neither the sensor's size nor a window as high as the video.

    Args:
        lines: lines of the video.
    """
    windows = [tag for tag in SENSOR if item.find(tag) is not None]
    shorter = [min(_values(item, tag, ["right", "bottom"], where)) + 1.0 for tag in windows]
    if item.find("intrinsic").get("sensorMaxV") is not None:
        ends = _values(item, "intrinsic", ["sensorMaxU", "sensorMaxV"], where)
        shorter.append((min(ends) + 1.0) / SUBPIXELS)
    whole = _format_of(round(max(shorter, default=0.0)))
    if whole >= lines:
        return whole
    filmed = _format_of(round(_filmed(item, where)[3] + 1.0))
    return filmed if filmed == lines else max(filmed, lines, USUAL_LINES)


def _format_of(rows: int) -> int:
    """Return the lines of the video format for a number of sensor rows."""
    return next((lines for lines in FORMATS if lines <= rows < lines + BLOCK), rows)


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
    """Return the XML as text."""
    root = ElementTree.Element("calibration", {"type": "regular", "source": "panoptic_ros"})
    cameras = ElementTree.SubElement(root, "cameras")
    for item in rig.cameras:
        matrix = item.intrinsics.matrix * SUBPIXELS
        pose, (width, height) = item.cam_from_world, item.image_size
        # Solved instead of transposed, so that a rotation rounded to six digits reproduces t.
        centre = np.linalg.solve(pose.rotation, -pose.translation) * MILLIMETRES
        turned = (FLIP @ pose.rotation).reshape(-1)
        k1, k2, p1, p2, k3 = item.intrinsics.distortion
        stated = {"active": "1", "model": "none", "serial": item.name, "viewrotation": "0"}
        node = ElementTree.SubElement(cameras, "camera", stated)
        fov = {"left": "0", "top": "0", "right": str(width - 1), "bottom": str(height - 1)}
        for tag in ("fov_marker", "fov_video"):
            ElementTree.SubElement(node, tag, fov)
        ElementTree.SubElement(
            node, "transform", _texts(dict(zip([*ROTATION, "x", "y", "z"], [*turned, *centre])))
        )
        intrinsic = {
            "focalLengthU": matrix[0, 0],
            "focalLengthV": matrix[1, 1],
            "skew": matrix[0, 1],
            "centerPointU": matrix[0, 2],
            "centerPointV": matrix[1, 2],
            **dict(zip(LENS, [k1, k2, p1, p2, k3])),
        }
        ElementTree.SubElement(node, "intrinsic", _texts(intrinsic))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _texts(values: dict[str, Any]) -> dict[str, str]:
    return {key: repr(float(value)) for key, value in values.items()}
