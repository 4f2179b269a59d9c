"""Read and write rig.json, "panoptic-rig-1": our own plain format, exact to the bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.domain.upright import Z_UP
from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.io.rigs.fields import (
    camera,
    entry,
    image_size,
    listing,
    name_of,
    number_of,
    numbers,
    parameters,
    pose_numbers,
    text_of,
    up_of,
)
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions, chosen_cameras

FORMAT = "panoptic-rig-1"
UNIT_M = 0.001  # m per depth unit, for depth sensors that do not state theirs


def parse(document: Any, options: ReadOptions) -> Rig:
    """Build a rig from the JSON document.

    Raises:
        CalibrationError: naming the camera and the key.
        UsageError: if the selection leaves no camera.
    """
    units = entry(document, "units", "the file")
    if units != "m":
        raise CalibrationError(f"units are {shown(units)}; a {FORMAT} file is in metres, 'm'")
    items = listing(document, "cameras", "the file")
    taken = ReadCameras(options)
    for k, item in chosen_cameras(document, options):
        name = name_of(item, "name", f"camera number {k}")
        taken.take(name, partial(_camera, name, item, "camera", taken))
    sensors = _depth_sensors(document, taken)
    names = [item.get("name") for item in items if isinstance(item, Mapping)]
    rig = taken.rig(name_of(document, "frame_id", "the file") if "frame_id" in document else "world")
    beside = tuple(_beside(sensor, rig, names) for sensor in sensors)
    return replace(rig, depth_sensors=beside, up=up_of(document, "the file", Z_UP))


def _beside(sensor: DepthSensor, rig: Rig, names: list[Any]) -> DepthSensor:
    """Return the sensor without its colour camera, if that is in the file but not in the rig."""
    gone = sensor.colour_camera in names and sensor.colour_camera not in rig.names
    return replace(sensor, colour_camera="") if gone else sensor


def _camera(name: str, item: Any, kind: str, taken: ReadCameras) -> Camera:
    where, is_sensor = f"{kind} {name}", kind == "depth sensor"
    pose = numbers if is_sensor else pose_numbers
    rotation, translation = pose(item, "R", where, (3, 3)), pose(item, "t", where, (3,))
    return camera(
        name,
        image_size(item, "image_size", where),
        numbers(item, "K", where, (3, 3)),
        np.zeros(0) if is_sensor and "distortion" not in item else numbers(item, "distortion", where, (-1,)),
        rotation,
        translation,
        text_of(item, "lens", where) or "brown",
        taken.tell,
        type=text_of(item, "type", where),
        panel=text_of(item, "panel", where),
        clock=text_of(item, "clock", where),
        line_delay_us=number_of(item, "line_delay_us", where, 0.0),
        covariance=_covariance(item, where),
    )


def _covariance(item: Mapping[str, Any], where: str) -> np.ndarray | None:
    return None if item.get("covariance") is None else numbers(item, "covariance", where, (-1, -1))


def _depth_sensors(document: Mapping[str, Any], taken: ReadCameras) -> tuple[DepthSensor, ...]:
    items = document.get("depth_sensors")
    if items is None:
        return ()
    if not isinstance(items, list):
        raise CalibrationError(f"the file: 'depth_sensors' is {shown(items)}, expected a list")
    return tuple(_depth_sensor(i, item, taken) for i, item in enumerate(items))


def _depth_sensor(index: int, item: Any, taken: ReadCameras) -> DepthSensor:
    name = name_of(item, "name", f"depth sensor number {index}")
    own = _camera(name, item, "depth sensor", taken)
    where = f"depth sensor {own.name}"
    unit_m = number_of(item, "unit_m", where, UNIT_M)
    return DepthSensor(own, text_of(item, "colour_camera", where), unit_m)


def dump(rig: Rig) -> str:
    """Return the document as text, one line per camera."""
    frame = "" if rig.frame_id == "world" else f' "frame_id": {json.dumps(rig.frame_id)},'
    up = "" if rig.up == Z_UP else f' "up": {json.dumps(rig.up)},'
    head = f'{{"format": "{FORMAT}", "units": "m",{frame}{up} "cameras": [\n'
    text = head + _lines(_row(item) for item in rig.cameras) + "\n]"
    if rig.depth_sensors:
        text += ', "depth_sensors": [\n' + _lines(_sensor_row(item) for item in rig.depth_sensors) + "\n]"
    return text + "}\n"


def _lines(rows: Any) -> str:
    return ",\n".join("  " + json.dumps(row) for row in rows)


def _row(item: Camera) -> dict[str, Any]:
    """Return a camera's entry; fields with default values are omitted."""
    matrix, distortion, rotation, translation = parameters(item)
    row: dict[str, Any] = {
        "name": item.name,
        "image_size": list(item.image_size),
        "K": matrix,
        "distortion": distortion,
        "R": rotation,
        "t": translation,
    }
    for key in ("type", "panel", "clock", "line_delay_us"):
        if getattr(item, key):
            row[key] = getattr(item, key)
    if item.intrinsics.lens != "brown":
        row["lens"] = item.intrinsics.lens
    if item.covariance is not None:
        row["covariance"] = item.covariance.tolist()
    return row


def _sensor_row(item: DepthSensor) -> dict[str, Any]:
    row = _row(item.camera)
    if item.colour_camera:
        row["colour_camera"] = item.colour_camera
    return row | {"unit_m": item.unit_m}
