"""Read cameras with intrinsics alone: files whose poses are missing, as a calibration computes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.known_keys import tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.rigs import camera_info
from panoptic_ros.io.rigs.document import load_document
from panoptic_ros.io.rigs.fields import camera, image_size, listing, name_of, numbers, text_of
from panoptic_ros.io.rigs.registry import RIG_JSON, find_rig, read_rig

YAML = (".yaml", ".yml")  # suffixes of ROS camera_info files
ONE_PLACE_M = 1e-3  # m, span of cameras whose poses mean nothing


def read_intrinsics(path: Path) -> Rig:
    """Return the cameras of a rig in any format, or of a file or folder without poses.

    Without poses: ROS camera_info, one <camera>.yaml or a folder of them, and JSON with a list `cameras` of
    name, image_size, K, distortion and lens. Their poses are 0 and the up direction is unknown.

    Raises:
        UserError: naming the file, the camera and the fault.
    """
    folder = path if path.is_dir() else path.parent
    files = sorted(file for file in folder.iterdir() if file.suffix in YAML) if path.is_dir() else [path]
    files = [file for file in files if file.suffix in YAML and camera_info.is_camera(file)]
    if files and not (path.is_dir() and (path / camera_info.POSES).is_file()):
        return _unposed([_of_camera_info(file) for file in files])
    path = find_rig(path) if path.is_dir() and not (path / camera_info.POSES).is_file() else path
    if path.is_file():
        with parsing(path, CalibrationError):
            document = load_document(path)
        if document is not None and document.syntax == "json" and _lacks_poses(document.content):
            tell_unknown(document.content, RIG_JSON, path)
            try:
                return _unposed([_of_json(item, k) for k, item in _items(document.content)])
            except CalibrationError as error:
                raise CalibrationError(f"{path}: {error}") from None
    rig = read_rig(path)
    centres = np.stack([item.centre for item in rig.cameras])
    return _unposed(rig.cameras) if np.ptp(centres, axis=0).max() < ONE_PLACE_M else rig


def _lacks_poses(document: Mapping[str, Any]) -> bool:
    cameras = document.get("cameras")
    if not isinstance(cameras, list) or not all(isinstance(item, Mapping) for item in cameras):
        return False
    return bool(cameras) and not any("R" in item or "t" in item for item in cameras)


def _items(document: Mapping[str, Any]) -> list[tuple[int, Any]]:
    return list(enumerate(listing(document, "cameras", "the file")))


def _of_json(item: Any, number: int) -> Camera:
    name = name_of(item, "name", f"camera number {number}")
    where = f"camera {name}"
    return camera(
        name,
        image_size(item, "image_size", where),
        numbers(item, "K", where, (3, 3)),
        numbers(item, "distortion", where, (-1,)) if "distortion" in item else np.zeros(0),
        np.eye(3),
        np.zeros(3),
        text_of(item, "lens", where) or "brown",
    )


def _of_camera_info(file: Path) -> Camera:
    document = read_yaml(file)
    name = text_of(document, "camera_name", file.name) or file.stem
    return camera_info.camera_of(name, file, Rigid.identity())


def _unposed(cameras: Sequence[Camera]) -> Rig:
    """Return a rig whose poses are 0; the up direction is unknown, so that no image is rotated."""
    return Rig(tuple(replace(item, cam_from_world=Rigid.identity()) for item in cameras), up=None)
