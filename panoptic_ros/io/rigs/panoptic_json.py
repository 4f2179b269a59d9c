"""CMU Panoptic Studio calibration_<sequence>.json: centimetres, y down, floor at y = 0.

480 VGA, 31 HD and 10 Kinect cameras in one list; `types` ("vga", "hd", "kinect-color") and `panels`
choose among them. Converted to metres and z up, once, here.
"""

from __future__ import annotations

import json
import re
from functools import partial
from typing import Any

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.io.rigs.fields import (
    METRES,
    Z_UP_TO_Y_DOWN,
    camera,
    image_size,
    listing,
    name_of,
    numbers,
    parameters,
    pose_numbers,
    text_of,
)
from panoptic_ros.io.rigs.options import ReadOptions, Taken, check_selection

CENTIMETRES = METRES["cm"]


def recognises(document: Any) -> bool:
    """Whether a JSON document is one: cameras with distCoef, and no unit stated."""
    cameras = document.get("cameras")
    stated = {"format", "unit", "units"} & set(document)
    return (
        isinstance(cameras, list)
        and not stated
        and any(isinstance(item, dict) and "distCoef" in item for item in cameras)
    )


def parse(document: Any, options: ReadOptions) -> Rig:
    """A rig from the JSON document.

    Raises:
        CalibrationError: naming the camera and the key.
        UsageError: if the selection leaves no camera.
    """
    items = listing(document, "cameras", "the file")
    chosen = [item for item in items if options.wants(item)]
    check_selection(items, chosen, options)
    taken = Taken(options)
    for k, item in enumerate(chosen):
        name = name_of(item, "name", f"camera number {k}")
        taken.take(name, partial(_camera, name, item, taken))
    return taken.rig()


def _camera(name: str, item: Any, taken: Taken) -> Camera:
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
    """The document as text; panels that are numbers are written as numbers."""
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
