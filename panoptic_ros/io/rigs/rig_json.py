"""rig.json, "panoptic-rig-1": our own plain format, exact to the bit."""
from __future__ import annotations

import json
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.rigs.fields import camera, entry, image_size, listing, name_of, numbers, parameters

FORMAT = "panoptic-rig-1"


def parse(document: Any) -> Rig:
    """A rig from the JSON document.

    Raises:
        CalibrationError: naming the camera and the key.
    """
    units = entry(document, "units", "the file")
    if units != "m":
        raise CalibrationError(f"units are {units!r}; a {FORMAT} file is in metres, 'm'")
    cameras = []
    for i, item in enumerate(listing(document, "cameras", "the file")):
        name = name_of(item, "name", f"camera number {i}")
        where = f"camera {name}"
        cameras.append(
            camera(
                name,
                image_size(item, "image_size", where),
                numbers(item, "K", where, (3, 3)),
                numbers(item, "distortion", where, (-1,)),
                numbers(item, "R", where, (3, 3)),
                numbers(item, "t", where, (3,)),
            )
        )
    frame_id = name_of(document, "frame_id", "the file") if "frame_id" in document else "world"
    return Rig(tuple(cameras), frame_id)


def dump(rig: Rig) -> str:
    """The document as text, one line per camera."""
    lines = []
    for item in rig.cameras:
        matrix, distortion, rotation, translation = parameters(item)
        row = {
            "name": item.name, "image_size": list(item.image_size), "K": matrix,
            "distortion": distortion, "R": rotation, "t": translation,
        }  # fmt: skip
        lines.append("  " + json.dumps(row))
    frame = "" if rig.frame_id == "world" else f' "frame_id": {json.dumps(rig.frame_id)},'
    head = f'{{"format": "{FORMAT}", "units": "m",{frame} "cameras": [\n'
    return head + ",\n".join(lines) + "\n]}\n"
