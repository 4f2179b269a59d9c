"""Read JSON lists of cameras of other programs, and write the format of CMU Panoptic Studio.

CMU Panoptic Studio calibration_<sequence>.json: centimetres, y down, floor at y = 0. One list holds 480 VGA,
31 HD and 10 Kinect cameras. The options `types` ("vga", "hd", "kinect-color") and `panels` select among them.
This module converts to metres and z up.

calibration.json of data packs: a list of cameras and a stated unit of length; only read. Shelf, Campus and
others are distributed in it. It holds `unit` or `units` (m, cm, mm), then per camera K, R, t and optionally
distortion. Image sizes are width and height, resolution or image_size. A document with `to_z_up` has the
world frame of CMU Panoptic, y down.
"""

from __future__ import annotations

import json
import re
from functools import partial
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.io.distortion_models import OPENCV
from panoptic_ros.io.rigs.fields import (
    METRES,
    Z_UP_TO_Y_DOWN,
    camera,
    entry,
    image_size,
    name_of,
    numbers,
    parameters,
    per_metre,
    pose_numbers,
    text_of,
    whole_number,
)
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions, chosen_cameras

Array = np.ndarray
CENTIMETRES = METRES["cm"]


def is_panoptic(document: Any) -> bool:
    """Return whether a JSON document is of CMU Panoptic Studio: cameras with distCoef, and no stated unit."""
    cameras = document.get("cameras")
    stated = {"format", "unit", "units"} & set(document)
    return (
        isinstance(cameras, list)
        and not stated
        and any(isinstance(item, dict) and "distCoef" in item for item in cameras)
    )


def parse_panoptic(document: Any, options: ReadOptions) -> Rig:
    """Build a rig from the JSON document.

    Raises:
        CalibrationError: naming the camera and the key.
        UsageError: if the selection leaves no camera.
    """
    taken = ReadCameras(options)
    for k, item in chosen_cameras(document, options):
        name = name_of(item, "name", f"camera number {k}")
        taken.take(name, partial(_panoptic_camera, name, item, taken))
    return taken.rig()


def _panoptic_camera(name: str, item: Any, taken: ReadCameras) -> Camera:
    where = f"camera {name}"
    rotation = pose_numbers(item, "R", where, (3, 3)) @ Z_UP_TO_Y_DOWN
    translation = pose_numbers(item, "t", where, (3, 1))[:, 0] / CENTIMETRES
    return camera(
        name,
        image_size(item, "resolution", where),
        numbers(item, "K", where, (3, 3)),
        numbers(item, "distCoef", where, (-1,)),
        rotation,
        translation,
        tell=taken.tell,
        type=text_of(item, "type", where),
        panel=text_of(item, "panel", where),
    )


def dump(rig: Rig) -> str:
    """Return the document as text; numeric panel names are written as numbers."""
    items = []
    for item in rig.cameras:
        matrix, distortion, _, _ = parameters(item)
        pose = item.cam_from_world
        panel = int(item.panel) if re.fullmatch("0|[1-9][0-9]*", item.panel) else item.panel
        stated = {key: value for key, value in (("type", item.type), ("panel", panel)) if value != ""}
        items.append(
            {
                "name": item.name,
                **stated,
                "resolution": list(item.image_size),
                "K": matrix,
                "distCoef": distortion,
                "R": (pose.rotation @ Z_UP_TO_Y_DOWN.T).tolist(),
                "t": (pose.translation[:, None] * CENTIMETRES).tolist(),
            }
        )
    return json.dumps({"calibDataSource": "panoptic_ros", "cameras": items}, indent=1) + "\n"


def is_pack(document: Any) -> bool:
    """Return whether a JSON document is of a data pack: a unit and a list of cameras with K, R and t."""
    cameras = document.get("cameras")
    stated = "unit" in document or "units" in document
    return (
        "format" not in document
        and stated
        and isinstance(cameras, list)
        and any(isinstance(item, dict) and {"K", "R", "t"} <= set(item) for item in cameras)
    )


def parse_pack(document: Any, options: ReadOptions) -> Rig:
    """Build a rig from the JSON document.

    Raises:
        CalibrationError: naming the camera and the key.
        UsageError: if the selection leaves no camera.
    """
    scale = per_metre(document.get("unit", document.get("units")), "the file")
    ours = Z_UP_TO_Y_DOWN if "to_z_up" in document else np.eye(3)
    taken = ReadCameras(options)
    for k, item in chosen_cameras(document, options):
        named = isinstance(item, dict) and "name" in item
        name = name_of(item, "name" if named else "id", f"camera number {k}")
        taken.take(name, partial(_pack_camera, name, item, scale, ours, taken))
    return taken.rig()


def _pack_camera(name: str, item: Any, scale: float, theirs_from_ours: Array, taken: ReadCameras) -> Camera:
    where = f"camera {name}"
    rotation = pose_numbers(item, "R", where, (3, 3)) @ theirs_from_ours
    translation = pose_numbers(item, "t", where, (3,), (3, 1)).reshape(3) / scale
    lens = next((key for key in ("distortion", "distCoef") if key in item), None)
    return camera(
        name,
        _size(item, where),
        numbers(item, "K", where, (3, 3)),
        numbers(item, lens, where, (-1,)) if lens else np.zeros(5),
        rotation,
        translation,
        text_of(item, "distortion_model", where) or OPENCV,
        taken.tell,
        type=text_of(item, "type", where),
        panel=text_of(item, "panel", where),
    )


def _size(item: Any, where: str) -> tuple[int, int]:
    for key in ("resolution", "image_size"):
        if key in item:
            return image_size(item, key, where)
    width, height = entry(item, "width", where), entry(item, "height", where)
    return whole_number(width, f"{where}: 'width'"), whole_number(height, f"{where}: 'height'")
