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
