"""Families of message classes: rclpy's, and those that rosbags generates from the same .msg files."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from panoptic_ros.errors import DataError, EnvironmentProblem, one_line
from panoptic_ros.io.resources import share_folder

if TYPE_CHECKING:  # most nodes do not need rosbags
    from rosbags.typesys.store import Typestore

Array = np.ndarray
PACKAGE = "panoptic_msgs"
SECOND = 1_000_000_000


@dataclass(frozen=True)
class MessageFamily:
    """One family of message classes.

    Args:
        type_of: "package/msg/Name" -> class, whose constructor takes the fields by keyword.
        sequence: Converts a flat array to the value of a field of unbounded length.
        origin: Returns the original message of a received record, or None. It is reused if the record is
            nested in another message.
    """

    type_of: Callable[[str], Any]
    sequence: Callable[[Array], Any]
    origin: Callable[[Any], Any | None] = lambda record: None

    def make(self, name: str, /, **fields: Any) -> Any:
        """Build a message; a name without a package belongs to this project's package."""
        return self.type_of(name if "/" in name else f"{PACKAGE}/msg/{name}")(**fields)

    def time(self, stamp_ns: int) -> Any:
        """Build a builtin_interfaces/Time."""
        seconds, nanoseconds = divmod(int(stamp_ns), SECOND)
        return self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Build a std_msgs/Header."""
        return self.make("std_msgs/msg/Header", stamp=self.time(stamp_ns), frame_id=frame_id)


def stamp_of(header: Any) -> int:
    """Return the timestamp of a header, ns.

    Raises:
        DataError: as `time_ns`.
    """
    return time_ns(header.stamp)


def time_ns(stamp: Any) -> int:
    """Return a builtin_interfaces/Time in ns.

    Raises:
        DataError: if nanosec is negative or at least a second, i.e. the publisher is faulty.
    """
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if not 0 <= nanoseconds < SECOND:
        raise DataError(f"a stamp has nanosec = {nanoseconds}, which is a second and more")
    return seconds * SECOND + nanoseconds


@lru_cache(maxsize=1)
def bag_typestore() -> Typestore:
    """Return rosbags' type store of ROS 2 Jazzy with the messages of this project."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted(_message_folder().glob("*.msg")):
        types.update(get_types_from_msg(path.read_text(), f"{PACKAGE}/msg/{path.stem}"))
    store.register(types)
    return store


def decode_cdr(data: bytes, kind: str, types: Typestore | None = None) -> Any:
    """Decode CDR bytes to a message of `bag_messages()`.

    Extra bytes after the message are ignored. Fast DDS leaves some after empty sequences of doubles, and
    `ros2 bag record` stores them unchanged. rosbags' own function refuses them.

    Args:
        types: type store to use instead of the current one.

    Raises:
        DataError: if the type is unknown, or the bytes are not a message of it.
    """
    store = types or bag_typestore()
    if kind not in store.types:
        raise DataError(f"messages of type {kind} are unknown here")
    definition = store.get_msgdef(kind)
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise DataError(f"no CDR message of type {kind}")
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    try:
        return read(memoryview(data)[4:], 0, definition.cls, store)[0]
    except Exception as error:  # rosbags trusts the lengths in a message, so damage can raise any exception
        raise DataError(f"a message of type {kind} cannot be decoded: {one_line(error)}") from None


@lru_cache(maxsize=1)
def bag_messages() -> MessageFamily:
    """Return the message family that `rosbags` reads and writes; it needs no ROS."""
    types = bag_typestore().types
    return MessageFamily(lambda name: types[name], lambda array: array)


def _message_folder() -> Path:
    """Return the folder of the .msg files: of the installed package, else of the checkout.

    Raises:
        EnvironmentProblem: if neither exists.
    """
    places = [share_folder() / "msg_defs" / "msg"]
    spec = importlib.util.find_spec(PACKAGE)
    if spec is not None and spec.origin is not None:
        installed = Path(spec.origin).parent
        share = next(
            (p / "share" / PACKAGE / "msg" for p in installed.parents if (p / "share" / PACKAGE).is_dir()),
            installed / "msg",
        )
        places = [installed / "msg", share, *places]
    for place in places:
        if any(place.glob("*.msg")):
            return place
    raise EnvironmentProblem(f"the message definitions are missing: install {PACKAGE} (msg_defs/)")
