"""Flat arrays of messages and shaped arrays of records."""
from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.family import Messages

Array = np.ndarray


def flat(family: Messages, array: Array, dtype: Any) -> Any:
    return family.sequence(np.ascontiguousarray(array, dtype).reshape(-1))


def shaped(values: Any, what: str, *shape: int) -> Array:
    """A message's flat array in its shape.

    Raises:
        DataError: if it has another length.
    """
    array = np.asarray(values)
    if array.size != int(np.prod(shape)):
        raise DataError(f"{what} has {array.size} values, expected {' x '.join(map(str, shape))}")
    return array.reshape(shape)


def byte_array(message: Any) -> Array:
    """The data of a message, uint8, without a copy where possible."""
    if isinstance(message.data, bytes):
        return np.frombuffer(message.data, np.uint8)
    return np.asarray(message.data, np.uint8)


def pixel_rows(message: Any, pixel_bytes: int, what: str) -> Array:
    """The bytes (height, width * pixel_bytes) of an Image without the padding at the ends of its rows.

    Raises:
        DataError: if its data have another length.
    """
    data = byte_array(message)
    width, height, step = int(message.width), int(message.height), int(message.step)
    if not width or not height or step < width * pixel_bytes or data.size != step * height:
        raise DataError(
            f"{what}: {width} x {height} {message.encoding} with step {step} cannot have {data.size} bytes"
        )
    return data.reshape(height, step)[:, : width * pixel_bytes]
