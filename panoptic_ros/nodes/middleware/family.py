"""Message classes of rclpy for the converters in `io.messages`."""

from __future__ import annotations

import array
import importlib
from functools import lru_cache
from typing import Any

import numpy as np

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.messages import MessageFamily

Array = np.ndarray


def message_class(name: str) -> Any:
    """Return the class of "package/msg/Name".

    Raises:
        EnvironmentProblem: if its package is not installed.
    """
    return _interface(name)


def service_class(name: str) -> Any:
    """Return the class of "package/srv/Name".

    Raises:
        EnvironmentProblem: if its package is not installed.
    """
    return _interface(name)


def _interface(name: str) -> Any:
    package, folder, kind = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), kind)
    except ImportError as error:
        raise EnvironmentProblem(
            f"the ROS package {package} is not installed here ({error}); see `panoptic doctor`"
        ) from None


def _sequence(values: Array) -> array.array[Any]:
    """Return values as array.array, the only type that rclpy's setters accept without a Python loop."""
    result = array.array(_CODES[values.dtype.str[1:]])
    result.frombytes(values.tobytes())
    return result


_CODES = {"f8": "d", "f4": "f", "i4": "i", "u1": "B", "u2": "H", "u4": "I", "i8": "q", "u8": "Q"}


@lru_cache(maxsize=1)
def ros_messages() -> MessageFamily:
    """Return the message family of rclpy: its message classes and sequence type."""
    return MessageFamily(lru_cache(maxsize=64)(message_class), _sequence)
