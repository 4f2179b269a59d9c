"""Fast reading of the fields that pair messages, from the first CDR bytes of a message only."""

from __future__ import annotations

import struct
from typing import NamedTuple

from panoptic_ros.errors import DataError

SECOND = 1_000_000_000
ENCAPSULATION = 4  # bytes of the CDR encapsulation header; alignment counts from its end


class SkeletonsHead(NamedTuple):
    """Leading fields of a panoptic_msgs/Skeletons.

    Args:
        stamp_ns: Timestamp of the message.
        newest_ns: Timestamp of its newest view.
        frames: Frame number of every view used, by camera.
    """

    stamp_ns: int
    newest_ns: int
    frames: dict[str, int]


def stamp_of_bytes(data: bytes) -> int:
    """Return the timestamp (ns) of a message that begins with a header.

    Raises:
        DataError: If the bytes are too few.
    """
    try:
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] else ">iI", data, ENCAPSULATION)
    except (struct.error, IndexError):
        raise DataError(f"a message of {len(data)} bytes has no header") from None
    return int(seconds) * SECOND + int(nanoseconds)


def detections_head(data: bytes) -> tuple[int, int]:
    """Return the timestamp (ns) and frame number of a panoptic_msgs/ViewDetections.

    Raises:
        DataError: If the bytes are not such a message.
    """
    try:
        cursor = _Cursor(data)
        stamp = cursor.time()
        cursor.text()
        return stamp, cursor.number("Q", 8)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise DataError(f"no detections: {error}") from None


def skeletons_head(data: bytes) -> SkeletonsHead:
    """Return the timestamps and views of a panoptic_msgs/Skeletons.

    Raises:
        DataError: If the bytes are not such a message.
    """
    try:
        cursor = _Cursor(data)
        stamp = cursor.time()
        cursor.text()  # frame id
        newest = cursor.time()
        cursor.number("Q", 8)  # index
        cursor.text()  # hash of the skeleton
        cursor.number("I", 4)  # number of joints
        cameras = [cursor.text() for _ in range(cursor.number("I", 4))]
        frames = [cursor.number("Q", 8) for _ in range(cursor.number("I", 4))]
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise DataError(f"no skeletons: {error}") from None
    return SkeletonsHead(stamp, newest, dict(zip(cameras, frames)))


class _Cursor:
    """Sequential reader of CDR fields."""

    def __init__(self, data: bytes):
        self._data = data
        self._order = "<" if data[1] else ">"
        self._at = ENCAPSULATION

    def number(self, code: str, size: int) -> int:
        """Read an integer with the `struct` code `code` and `size` bytes, aligned to its size."""
        self._at += (ENCAPSULATION - self._at) % size
        (value,) = struct.unpack_from(self._order + code, self._data, self._at)
        self._at += size
        return int(value)

    def time(self) -> int:
        """Read a builtin_interfaces/Time in ns."""
        return self.number("i", 4) * SECOND + self.number("I", 4)

    def text(self) -> str:
        """Read a string."""
        length = self.number("I", 4)
        if self._at + length > len(self._data):
            raise IndexError(f"a text of {length} bytes")
        text = bytes(self._data[self._at : self._at + max(0, length - 1)]).decode()
        self._at += length
        return text
