"""Read and write a folder of ROS calibration files, <camera>.yaml, and poses.yaml.

The files <camera>.yaml have the format of camera_calibration and camera_info_manager. Their keys are
image_width, image_height, camera_matrix, distortion_model (see `io.distortion_models`) and
distortion_coefficients. ROS has no file format for the poses, so this package defines poses.yaml:

    frame_id: world
    poses:
      cam01: {translation: [x, y, z], rotation: [x, y, z, w]}

Each entry is the pose of the camera's optical frame (x right, y down, z forward) in `frame_id` (optional), in
metres and as a quaternion. `tf2_echo world cam01_optical_frame` prints the same.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, DataError, UsageError, shown
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.distortion_models import ros_name
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.rigs.fields import (
    UncalibratedCamera,
    camera,
    entry,
    name_of,
    numbers,
    pose_numbers,
    text_of,
    whole_number,
)
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions

POSES_KEYS = keys("frame_id", poses={EACH: keys("translation rotation")})
_MATRIX = keys("rows cols data")
INFO_KEYS = keys(
    "image_width image_height camera_name distortion_model binning_x binning_y roi",
    camera_matrix=_MATRIX,
    distortion_coefficients=_MATRIX,
    rectification_matrix=_MATRIX,
    projection_matrix=_MATRIX,
)

POSES = "poses.yaml"


def recognises(folder: Path) -> bool:
    """Return whether a folder has a poses.yaml."""
    return (folder / POSES).is_file()


def parse(folder: Path, options: ReadOptions) -> Rig:
    """Read a rig from the folder, cameras in the order of poses.yaml; cameras without a pose are left out.

    Raises:
        DataError: if a file cannot be read or is not YAML.
        CalibrationError: naming the file and the key.
    """
    document = read_yaml(folder / POSES)
    tell_unknown(document, POSES_KEYS, folder / POSES)
    poses = entry(document, "poses", POSES)
    frame_id = name_of(document, "frame_id", POSES) if "frame_id" in document else "world"
    if not isinstance(poses, dict) or not poses:
        raise CalibrationError(f"{POSES}: 'poses' is not a table of cameras, or an empty one")
    taken = ReadCameras(options)
    for name, pose in poses.items():
        taken.take(str(name), partial(_camera, folder, str(name), pose, taken))
    for path in sorted(folder.glob("*.yaml")):
        if path.stem not in map(str, poses) and is_camera(path):
            taken.take(path.stem, _unposed)
    return taken.rig(frame_id)


def _unposed() -> Camera:
    raise UncalibratedCamera(f"no pose in {POSES}")


def is_camera(path: Path) -> bool:
    """Return whether a file is a camera calibration; a broken file is none."""
    try:
        document = read_yaml(path)
    except DataError:
        return False
    return isinstance(document, dict) and "camera_matrix" in document


def _camera(folder: Path, name: str, pose: Any, taken: ReadCameras) -> Camera:
    where = f"{name}.yaml"
    if not (folder / where).is_file():
        raise CalibrationError(f"camera {name} has no {where}, although {POSES} has its pose")
    from scipy.spatial.transform import Rotation  # slow to import, and most runs do not need it

    pose_at = f"{POSES}: {name}"
    translation = pose_numbers(pose, "translation", pose_at, (3,))
    quaternion = pose_numbers(pose, "rotation", pose_at, (4,))
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise CalibrationError(f"{POSES}: {name}: 'rotation' has length {length:.4g}, no unit quaternion")
    world_from_cam = Rigid(Rotation.from_quat(quaternion).as_matrix(), translation)
    return camera_of(name, folder / where, world_from_cam.inverse(), taken.tell)


def camera_of(
    name: str, path: Path, cam_from_world: Rigid, tell: Callable[[str, str], None] | None = None
) -> Camera:
    """Return the camera of a <camera>.yaml file, with a pose in m.

    Args:
        tell: Called with the camera's name and a notice about an assumption.

    Raises:
        CalibrationError: naming the file and the key.
    """
    where, document = path.name, read_yaml(path)
    tell_unknown(document, INFO_KEYS, path)
    size = (
        whole_number(entry(document, "image_width", where), f"{where}: image_width"),
        whole_number(entry(document, "image_height", where), f"{where}: image_height"),
    )
    matrix = numbers(entry(document, "camera_matrix", where), "data", f"{where}: camera_matrix", (9,))
    model, distortion = text_of(document, "distortion_model", where), np.zeros(0)
    if model or document.get("distortion_coefficients") is not None:
        coefficients = entry(document, "distortion_coefficients", where)
        distortion = numbers(coefficients, "data", f"{where}: distortion_coefficients", (-1,))
    rotation, translation = cam_from_world.rotation, cam_from_world.translation
    return camera(name, size, matrix.reshape(3, 3), distortion, rotation, translation, model, tell)


def dump(rig: Rig) -> dict[str, str]:
    """Return the files of the folder: texts by file name.

    Raises:
        UsageError: if a camera's name cannot be a file name.
    """
    from scipy.spatial.transform import Rotation  # slow to import, and most runs do not need it

    files, poses = {}, {}
    for item in rig.cameras:
        if "/" in item.name or item.name.startswith(".") or f"{item.name}.yaml" == POSES:
            raise UsageError(f"camera {shown(item.name)} cannot name a file; rename it for this format")
        files[f"{item.name}.yaml"] = yaml.safe_dump(_info(item), sort_keys=False)
        rotation = item.cam_from_world.rotation
        poses[item.name] = {
            "translation": item.centre.tolist(),
            "rotation": Rotation.from_matrix(rotation.T).as_quat().tolist(),
        }
    files[POSES] = yaml.safe_dump({"frame_id": rig.frame_id, "poses": poses}, sort_keys=False)
    return files


def _info(item: Camera) -> dict[str, Any]:
    matrix = item.intrinsics.matrix
    width, height = item.image_size
    projection = np.hstack([matrix, np.zeros((3, 1))])
    return {
        "image_width": width,
        "image_height": height,
        "camera_name": item.name,
        "camera_matrix": _matrix(matrix),
        "distortion_model": ros_name(item.intrinsics),
        "distortion_coefficients": _matrix(item.intrinsics.distortion[None]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(projection),
    }


def _matrix(values: np.ndarray) -> dict[str, Any]:
    rows, columns = values.shape
    return {"rows": rows, "cols": columns, "data": values.reshape(-1).tolist()}
