"""Families of message classes: rclpy's, and those that rosbags makes from the same .msg files."""

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

if TYPE_CHECKING:  # most nodes have no need of rosbags
    from rosbags.typesys.store import Typestore

Array = np.ndarray
PACKAGE = "panoptic_msgs"
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Messages:
    """One family of message classes.

    Args:
        type_of: "package/msg/Name" -> class, whose constructor takes the fields by keyword.
        sequence: makes what a field of unbounded length takes from a flat array.
        origin: the message of this family that a record came as, which is not written anew inside of another
            one; None: it came as none.
    """

    type_of: Callable[[str], Any]
    sequence: Callable[[Array], Any]
    origin: Callable[[Any], Any | None] = lambda record: None

    def make(self, name: str, /, **fields: Any) -> Any:
        """A message; short names are those of this project's package."""
        return self.type_of(name if "/" in name else f"{PACKAGE}/msg/{name}")(**fields)

    def time(self, stamp_ns: int) -> Any:
        """builtin_interfaces/Time."""
        seconds, nanoseconds = divmod(int(stamp_ns), SECOND)
        return self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """std_msgs/Header."""
        return self.make("std_msgs/msg/Header", stamp=self.time(stamp_ns), frame_id=frame_id)


def stamp_of(header: Any) -> int:
    """Nanoseconds of a header's stamp.

    Raises:
        DataError: as `time_ns`.
    """
    return time_ns(header.stamp)


def time_ns(stamp: Any) -> int:
    """Nanoseconds of a builtin_interfaces/Time.

    Raises:
        DataError: if there is a second and more in its nanoseconds, which shows that its writer errs.
    """
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if not 0 <= nanoseconds < SECOND:
        raise DataError(f"a stamp has nanosec = {nanoseconds}, which is a second and more")
    return seconds * SECOND + nanoseconds


@lru_cache(maxsize=1)
def bag_typestore() -> Typestore:
    """rosbags' types of ROS 2 Jazzy with those of this project."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted(_message_folder().glob("*.msg")):
        types.update(get_types_from_msg(path.read_text(), f"{PACKAGE}/msg/{path.stem}"))
    store.register(types)
    return store


def decode_cdr(data: bytes, kind: str, types: Typestore | None = None) -> Any:
    """A message of `bag_messages()` from CDR bytes.

    Bytes beyond the message are ignored: Fast DDS, which `ros2 bag record` stores as it is, leaves some
    after empty sequences of doubles, and rosbags' own function refuses them.

    Args:
        types: in place of those of now.

    Raises:
        DataError: if the type is not known or the bytes are no message of it.
    """
    store = types or bag_typestore()
    if kind not in store.types:
        raise DataError(f"messages of type {kind} are not known here")
    definition = store.get_msgdef(kind)
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise DataError(f"no CDR message of type {kind}")
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    try:
        return read(memoryview(data)[4:], 0, definition.cls, store)[0]
    except Exception as error:  # rosbags trusts the lengths in a message: damage shows as anything
        raise DataError(f"a message of type {kind} cannot be decoded: {one_line(error)}") from None


@lru_cache(maxsize=1)
def bag_messages() -> Messages:
    """The family that `rosbags` reads and writes; needs no ROS."""
    types = bag_typestore().types
    return Messages(lambda name: types[name], lambda array: array)


def _message_folder() -> Path:
    """The .msg files: of the installed package, else of the checkout.

    Raises:
        EnvironmentProblem: if they are nowhere.
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
    raise EnvironmentProblem(f"the message definitions are not there: install {PACKAGE} (msg_defs/)")
