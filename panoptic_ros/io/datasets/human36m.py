"""Read cameras and true joints of Human3.6M (Ionescu et al. 2014).

`metadata.xml` has 300 numbers in `w0`. First come, for each of four cameras and eleven subjects, three angles
and the camera position in millimetres. Then come, for each camera, two focal lengths, the principal point,
three radial and two tangential terms, which are read as OpenCV's. The rotation from the world to a camera is
Rx(a) Ry(b) Rz(c); z of the world is up. `D3_Positions/<action>.cdf` has in `Pose` 32 joints in the world
frame, in millimetres, at 50 Hz.
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, DataError, EnvironmentProblem, one_line
from panoptic_ros.io.documents import parse_xml, read_text
from panoptic_ros.io.loading import largest_document, read_bytes
from panoptic_ros.io.rigs.fields import camera

Array = np.ndarray
RATE, MM, JOINTS, SUBJECTS = 50.0, 1e-3, 32, 11
SIZES = {  # image size (width, height) px by camera serial number
    "54138969": (1000, 1002),
    "55011271": (1000, 1000),
    "58860488": (1000, 1000),
    "60457274": (1000, 1002),
}
POSES, LENS = 6, 9  # numbers for each camera and subject; numbers for each camera
# Index of the joints whose names detectors share, of 32. The others repeat these or lie between them.
NAMED = {
    "BodyCenter": 0,
    "rHip": 1,
    "rKnee": 2,
    "rAnkle": 3,
    "lHip": 6,
    "lKnee": 7,
    "lAnkle": 8,
    "Neck": 13,
    "lShoulder": 17,
    "lElbow": 18,
    "lWrist": 19,
    "rShoulder": 25,
    "rElbow": 26,
    "rWrist": 27,
}
MAGIC = (b"\xcd\xf3", b"\xcd\xf2", b"\x00\x00")  # first bytes of CDF 3, CDF 2.6 and older files


def read_cameras(metadata: Path, subject: int) -> Rig:
    """Read the four cameras with their poses for a subject (1 to 11).

    Raises:
        CalibrationError, DataError: naming the file and the fault.
    """
    root = parse_xml(read_text(metadata), metadata, CalibrationError)
    found = next(iter(root.iter("w0")), None)
    if found is None or not found.text:
        raise CalibrationError(f"{metadata} has no <w0>, the numbers of the cameras")
    try:
        numbers = np.array([float(word) for word in found.text.strip(" \n\r\t[]").replace(",", " ").split()])
    except ValueError as error:
        raise CalibrationError(f"{metadata}: <w0>: {one_line(error)}") from None
    count = len(SIZES) * (POSES * SUBJECTS + LENS)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise CalibrationError(f"{metadata}: <w0> has {len(numbers)} numbers, expected {count}")
    if not 1 <= subject <= SUBJECTS:
        raise DataError(f"there is no subject {subject} of Human3.6M; they are 1 to {SUBJECTS}")
    poses = numbers[: len(SIZES) * POSES * SUBJECTS].reshape(len(SIZES), SUBJECTS, POSES)
    lenses = numbers[poses.size :].reshape(len(SIZES), LENS)
    pairs = zip(SIZES, poses[:, subject - 1], lenses)
    return Rig(tuple(_camera(name, pose, lens) for name, pose, lens in pairs))


def _camera(name: str, pose: Array, lens: Array) -> Camera:
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = lens
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    turn = _about(0, pose[0]) @ _about(1, pose[1]) @ _about(2, pose[2])
    return camera(name, SIZES[name], matrix, np.array([k1, k2, p1, p2, k3]), turn, -turn @ (MM * pose[3:]))


def _about(axis: int, angle: float) -> Array:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = np.eye(3)
    found[i, i] = found[j, j] = math.cos(angle)
    found[j, i], found[i, j] = math.sin(angle), -math.sin(angle)
    return found


def read_joints(path: Path) -> Array:
    """Read the named joints (T, 14, 3) m of a take at 50 Hz, in the order of `NAMED`.

    Raises:
        EnvironmentProblem: if the package cdflib is not installed.
        DataError: naming the file and the fault.
    """
    if read_bytes(path, largest_document())[:2] not in MAGIC:
        raise DataError(f"{path} is not a CDF file")
    try:
        package: Any = importlib.import_module("cdflib")
    except ImportError:
        raise EnvironmentProblem("files of Human3.6M need the package cdflib: pip install cdflib") from None
    try:
        values = np.asarray(package.CDF(str(path)).varget("Pose"), float)
    # cdflib trusts a file's lengths and offsets, so damage can raise any exception
    except Exception as error:
        raise DataError(f"{path} is not a CDF file with `Pose`: {one_line(error)}") from None
    if values.ndim == 3 and len(values) == 1:
        values = values[0]
    if values.ndim != 2 or values.shape[1] != 3 * JOINTS or not len(values):
        shape = " x ".join(map(str, values.shape))
        raise DataError(f"{path}: `Pose` is {shape}, expected frames x {3 * JOINTS}, {JOINTS} joints")
    found: Array = MM * values.reshape(-1, JOINTS, 3)[:, list(NAMED.values())]
    return found
