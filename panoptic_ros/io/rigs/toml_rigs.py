"""Read and write TOML rigs of aniposelib (also written by Pose2Sim) and caliscope.

Both hold per camera the size, matrix, distortions, and cam_from_world as a Rodrigues vector and a
translation. Neither states its unit of length. `rotation_count` of caliscope states the quarter turns that
make images upright; the up direction follows from them. aniposelib does not state it; `up` in its metadata is
our extension. Lenses are OpenCV's; `fisheye = true` selects the fisheye. A file of aniposelib has one table
per camera. A file of caliscope has a table `cameras` of numbered tables, whose videos are called
cam_<number>.mp4 (port_<number>.mp4 in older versions).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.upright import roll_of, up_of_images
from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.io.distortion_models import OPENCV
from panoptic_ros.io.rigs.fields import (
    UncalibratedCamera,
    camera,
    image_size,
    name_of,
    numbers,
    per_metre,
    pose_numbers,
    text_of,
    up_of,
)
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions, check_unit

KEYS = {"size", "matrix", "distortions", "rotation", "translation"}
ENOUGH = 3  # a table with this number of KEYS is a camera


def is_aniposelib(document: Mapping[str, Any]) -> bool:
    """Return whether a top-level table looks like a camera."""
    return any(isinstance(item, dict) and len(KEYS & set(item)) >= ENOUGH for item in document.values())


def is_caliscope(document: Mapping[str, Any]) -> bool:
    """Return whether there is a table `cameras` with a table that looks like a camera."""
    cameras = document.get("cameras")
    return isinstance(cameras, dict) and is_aniposelib(cameras)


def parse_aniposelib(document: Mapping[str, Any], options: ReadOptions) -> Rig:
    """Build a rig from the tables other than `metadata`.

    Raises:
        CalibrationError: naming the camera and the key, or if the unit cannot be metres.
    """
    metadata = document.get("metadata", {})
    metadata = metadata if isinstance(metadata, dict) else {}
    stated = metadata.get("unit", "m")
    scale = per_metre(options.unit or stated, "[metadata]")
    taken = ReadCameras(options)
    for table, item in document.items():
        if table != "metadata":
            name = name_of(item, "name", f"table [{table}]")
            taken.take(name, partial(_camera, name, item, scale, taken))
    rig = replace(taken.rig(), up=up_of(metadata, "[metadata]", None))
    return check_unit(_in_metres(rig, "unit" in metadata, options), options)


def parse_caliscope(document: Mapping[str, Any], options: ReadOptions) -> Rig:
    """Build a rig from the cameras that are not marked `ignore`.

    Raises:
        CalibrationError: naming the camera and the key, or if the unit cannot be metres.
    """
    scale = per_metre(options.unit or "m", "the file")
    taken, turns = ReadCameras(options), {}
    for number, item in document["cameras"].items():
        if not isinstance(item, dict):
            raise CalibrationError(f"[cameras.{number}] is not a table")
        usual = f"port_{number}" if "port" in item else f"cam_{number}"
        name = str(item.get("name", usual))
        turns[name] = _clockwise(item, f"[cameras.{number}]")
        taken.take(name, partial(_camera, name, item, scale, taken))
    rig = taken.rig()
    known = [count for name in rig.names if (count := turns[name]) is not None]
    up = up_of_images(rig.cameras, known) if len(known) == len(rig) > 0 else None
    return check_unit(_in_metres(replace(rig, up=up), False, options), options)


def _in_metres(rig: Rig, stated: bool, options: ReadOptions) -> Rig:
    """Return the rig with a notice about the assumed unit, if neither the file nor the options state it."""
    if stated or options.unit is not None:
        return rig
    line = (
        "lengths are assumed to be metres, as the file does not state its unit; "
        "`panoptic rig check RIG --detections FILE` finds it from people"
    )
    return replace(rig, notices=(*rig.notices, line))


def _clockwise(item: Mapping[str, Any], where: str) -> int | None:
    """Return the clockwise quarter turns that make a camera's images upright; None if not stated."""
    count = item.get("rotation_count")
    if count is None:
        return None
    if isinstance(count, bool) or not isinstance(count, int):
        raise CalibrationError(
            f"{where}: 'rotation_count' is {shown(count)}, expected a whole number of quarter turns"
        )
    return count % 4


def _camera(name: str, item: Mapping[str, Any], scale: float, taken: ReadCameras) -> Camera:
    where = f"camera {name}"
    if item.get("ignore", False):
        raise UncalibratedCamera("marked 'ignore'")
    rotation = pose_numbers(item, "rotation", where, (3,), (3, 3))
    translation = pose_numbers(item, "translation", where, (3,)) / scale
    fisheye = item.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise CalibrationError(f"{where}: 'fisheye' is {shown(fisheye)}, expected true or false")
    if rotation.ndim == 1:
        from scipy.spatial.transform import Rotation  # slow to import, and most runs do not need it

        rotation = Rotation.from_rotvec(rotation).as_matrix()
    return camera(
        name,
        image_size(item, "size", where),
        numbers(item, "matrix", where, (3, 3)),
        numbers(item, "distortions", where, (-1,), (1, -1), (-1, 1)).reshape(-1),
        rotation,
        translation,
        "fisheye" if fisheye else text_of(item, "distortion_model", where) or OPENCV,
        taken.tell,
    )


def dump_aniposelib(rig: Rig) -> str:
    """Return the tables as text, in metres."""
    tables = []
    for i, item in enumerate(rig.cameras):
        kind = [("fisheye", "true")] if item.intrinsics.lens == "fisheye" else []
        tables.append(_table(f"cam_{i}", [("name", _text(item.name)), *kind, *_rows(item)]))
    up = [] if rig.up is None else [("up", _numbers(rig.up))]
    metadata = _table("metadata", [("adjusted", "false"), ("error", "0.0"), ("unit", _text("m")), *up])
    return "\n".join([*tables, metadata])


def dump_caliscope(rig: Rig) -> str:
    """Return the tables as text; cameras not called cam_<number> are numbered and get a key `name`."""
    matches = [re.fullmatch(r"cam_(0|[1-9][0-9]*)", item.name) for item in rig.cameras]
    tables = []
    for i, (item, match) in enumerate(zip(rig.cameras, matches)):
        number = match.group(1) if match and all(matches) else str(i)
        turns = 0 if rig.up is None else round(-roll_of(item, rig.up) / 90.0) % 4
        extra = [("rotation_count", str(turns)), ("fisheye", str(item.intrinsics.lens == "fisheye").lower())]
        if not all(matches):
            extra.append(("name", _text(item.name)))
        tables.append(_table(f"cameras.{number}", [("cam_id", number), *extra, *_rows(item)]))
    return "\n".join(tables)


def _rows(item: Camera) -> list[tuple[str, str]]:
    from scipy.spatial.transform import Rotation  # slow to import, and most runs do not need it

    pose, lens = item.cam_from_world, item.intrinsics
    return [
        ("size", f"[{item.image_size[0]}, {item.image_size[1]}]"),
        ("matrix", "[" + ", ".join(_numbers(row) for row in lens.matrix) + "]"),
        ("distortions", _numbers(lens.distortion)),
        ("rotation", _numbers(Rotation.from_matrix(pose.rotation).as_rotvec())),
        ("translation", _numbers(pose.translation)),
    ]


def _table(name: str, rows: Iterable[tuple[str, str]]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in rows)


def _numbers(values: Iterable[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
