"""Flat arrays of messages and shaped arrays of records."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from panoptic_ros.domain.checks import check_magnitude
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.family import Messages

Array = np.ndarray
LONGEST = 2**24  # of one dimension, also where another one is 0
MOST_JOINTS = 4096
LARGEST = 1e12  # m, px, s: nobody means more, and squares of much more spoil what they are added to


def flat(family: Messages, array: Array, dtype: Any) -> Any:
    return family.sequence(np.ascontiguousarray(array, dtype).reshape(-1))


def shaped(values: Any, what: str, *shape: int) -> Array:
    """A message's flat array in its shape.

    Raises:
        DataError: if it has another length, or holds finite numbers that are beyond all measure.
    """
    array = np.asarray(values)
    if not 0 <= min(shape) <= max(shape) <= LONGEST or array.size != math.prod(shape):
        raise DataError(f"{what} has {array.size} values, expected {' x '.join(map(str, shape))}")
    if array.dtype.kind == "f":
        check_magnitude(what, array, LARGEST)
    return array.reshape(shape)


def joint_count(message: Any) -> int:
    """How many joints a message says that people have.

    Raises:
        DataError: if that is no body.
    """
    count = int(message.joint_count)
    if not 0 <= count <= MOST_JOINTS:
        raise DataError(f"{type(message).__name__.rsplit('__')[-1]}.joint_count is {count}")
    return count


def byte_array(message: Any) -> Array:
    """The data of a message, uint8, without a copy where possible."""
    if isinstance(message.data, bytes):
        return np.frombuffer(message.data, np.uint8)
    return np.asarray(message.data, np.uint8)


def pixel_rows(message: Any, pixel_bytes: int, what: str) -> Array:
    """The bytes (height, width * pixel_bytes) of an Image without the padding at the ends of its rows.

    Padding may be missing behind the last row, and `step` may be 0 where there is none.

    Raises:
        DataError: if its data have another length.
    """
    data = byte_array(message)
    width, height = int(message.width), int(message.height)
    step = int(message.step) or width * pixel_bytes
    padding = step - width * pixel_bytes
    if padding and data.size == step * height - padding:
        data = np.pad(data, (0, padding))
    if not width or not height or padding < 0 or data.size != step * height:
        raise DataError(
            f"{what}: {width} x {height} {message.encoding} with step {step} cannot have {data.size} bytes"
        )
    return data.reshape(height, step)[:, : width * pixel_bytes]
