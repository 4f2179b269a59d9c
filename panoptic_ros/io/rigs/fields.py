"""Read cameras from the fields of a document with checks of every number, and get a camera's fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.domain.upright import Direction, direction
from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.distortion_models import OPENCV, read_lens

Array = np.ndarray
METRES = {"m": 1.0, "cm": 100.0, "mm": 1000.0}  # units per metre

LONGEST_SIDE = 100_000  # px of an image; the sensors of line cameras have 16 000
NOTHING = ("", "nan", "none", "null")  # values that some programs write for an unknown pose

# World frame of CMU Panoptic: y down, floor at y = 0. Our world frame: z up. x_theirs = Z_UP_TO_Y_DOWN @
# x_ours.
Z_UP_TO_Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class UncalibratedCamera(CalibrationError):
    """The file does not calibrate a camera; the reader leaves it out and names it."""


def entry(mapping: Any, key: str, where: str) -> Any:
    """Return the value of a required key.

    Raises:
        CalibrationError: if the key is missing, or `mapping` is not a mapping.
    """
    if not isinstance(mapping, Mapping):
        raise CalibrationError(f"{where} is a {type(mapping).__name__}, expected a table with {shown(key)}")
    if key not in mapping:
        raise CalibrationError(f"{where} has no {shown(key)}")
    return mapping[key]


def numbers(mapping: Any, key: str, where: str, *shapes: tuple[int, ...]) -> Array:
    """Return an array of finite numbers with one of the shapes; -1 = any size.

    Raises:
        CalibrationError: naming the place, the key and the fault.
    """
    value = entry(mapping, key, where)
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise CalibrationError(f"{where}: {shown(key)} is not an array of numbers") from None
    if not any(_fits(array, shape) for shape in shapes):
        wanted = " x ".join("n" if size < 0 else str(size) for size in shapes[0])
        found = " x ".join(str(size) for size in array.shape) or "a single number"
        raise CalibrationError(f"{where}: {shown(key)} is {found}, expected {wanted} numbers")
    if not np.isfinite(array).all():
        raise CalibrationError(f"{where}: {shown(key)} has numbers that are not finite")
    return array


def pose_numbers(mapping: Any, key: str, where: str, *shapes: tuple[int, ...]) -> Array:
    """Read an array of a camera pose, as `numbers` does.

    Raises:
        UncalibratedCamera: if it is missing, or written as unknown.
        CalibrationError: as `numbers`.
    """
    value = mapping.get(key) if isinstance(mapping, Mapping) else mapping
    if all(item is None or str(item).strip().lower() in NOTHING for item in _flat(value)):
        state = "is not known" if mapping and key in mapping else "is missing"
        raise UncalibratedCamera(f"no pose ({key!r} {state})")
    return numbers(mapping, key, where, *shapes)


def _flat(value: Any) -> list[Any]:
    """Return the values of nested lists of any depth."""
    return [item for part in value for item in _flat(part)] if isinstance(value, list) else [value]


def per_metre(unit: Any, where: str) -> float:
    """Return how many of a stated unit of length are one metre.

    Raises:
        CalibrationError: if the unit is unknown.
    """
    if not isinstance(unit, str) or unit not in METRES:
        known = ", ".join(METRES)
        raise CalibrationError(f"{where}: the unit of length is {shown(unit)}, expected one of {known}")
    return METRES[unit]


def _fits(array: Array, shape: tuple[int, ...]) -> bool:
    return array.ndim == len(shape) and all(w in (-1, n) for n, w in zip(array.shape, shape))


def up_of(mapping: Mapping[str, Any], where: str, default: Direction | None) -> Direction | None:
    """Return the direction of the optional key "up"; null = unknown.

    Raises:
        CalibrationError: if it is not a direction.
    """
    if "up" not in mapping:
        return default
    return None if mapping["up"] is None else direction(numbers(mapping, "up", where, (3,)).tolist())


def whole_number(value: Any, what: str) -> int:
    """Check a positive integer number of pixels; 1088.0 is accepted, too.

    Raises:
        CalibrationError: otherwise.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise CalibrationError(f"{what} is {shown(value)}, expected a whole number of pixels")
    if value != int(value) or not 0 < value <= LONGEST_SIDE:
        raise CalibrationError(
            f"{what} is {shown(value)}, expected a whole number of pixels above 0, at most {LONGEST_SIDE}"
        )
    return int(value)


def image_size(mapping: Any, key: str, where: str) -> tuple[int, int]:
    """Read an image size [width, height] in whole pixels."""
    width, height = numbers(mapping, key, where, (2,))
    return (
        whole_number(float(width), f"{where}: width in {shown(key)}"),
        whole_number(float(height), f"{where}: height in {shown(key)}"),
    )


def name_of(mapping: Any, key: str, where: str) -> str:
    """Read a name: non-empty text, or an integer.

    Raises:
        CalibrationError: otherwise.
    """
    value = entry(mapping, key, where)
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    if not isinstance(value, str) or not value.strip():
        raise CalibrationError(f"{where}: {shown(key)} is {shown(value)}, expected a name")
    return value


def text_of(mapping: Mapping[str, Any], key: str, where: str) -> str:
    """Read text or an integer from an optional key; "" if it is missing.

    Raises:
        CalibrationError: if it is something else.
    """
    value = mapping.get(key)
    if value is None:
        return ""
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if not isinstance(value, str):
        raise CalibrationError(f"{where}: {shown(key)} is {shown(value)}, expected text")
    return value


def number_of(mapping: Mapping[str, Any], key: str, where: str, default: float) -> float:
    """Read a number from an optional key.

    Raises:
        CalibrationError: if it is something else.
    """
    value = mapping.get(key)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise CalibrationError(f"{where}: {shown(key)} is {shown(value)}, expected a number")
    return float(value)


def listing(mapping: Any, key: str, where: str) -> list[Any]:
    """Read a non-empty list.

    Raises:
        CalibrationError: otherwise.
    """
    value = entry(mapping, key, where)
    if not isinstance(value, list) or not value:
        raise CalibrationError(f"{where}: {shown(key)} is not a list of cameras, or an empty one")
    return value


def camera(
    name: str,
    size: tuple[int, int],
    matrix: Array,
    distortion: Array,
    rotation: Array,
    translation: Array,
    model: object = OPENCV,
    tell: Callable[[str, str], None] | None = None,
    **stated: Any,
) -> Camera:
    """Build a camera from K (3, 3) px and cam_from_world in m.

    Args:
        model: name of the distortion model, see `read_lens`.
        tell: called with the camera's name and a notice about an assumption.
        stated: further fields of `Camera`.

    Raises:
        CalibrationError: naming the camera.
    """
    try:
        if abs(matrix[1, 0]) > 0.0 or matrix[2].tolist() != [0.0, 0.0, 1.0]:
            raise CalibrationError("K is no [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]; is it transposed?")
        lens, terms, assumed = read_lens(model, distortion)
        made = Camera(name, size, Intrinsics(matrix, terms, lens), Rigid(rotation, translation), **stated)
    except CalibrationError as error:
        told = str(error).removeprefix(f"camera {name}: ")
        raise CalibrationError(f"camera {name}: {told}") from None
    if assumed and tell is not None:
        tell(name, assumed)
    return made


def parameters(camera: Camera) -> tuple[list[list[float]], list[float], list[list[float]], list[float]]:
    """Return K, distortion, R and t of a camera as lists."""
    pose, lens = camera.cam_from_world, camera.intrinsics
    return lens.matrix.tolist(), lens.distortion.tolist(), pose.rotation.tolist(), pose.translation.tolist()
