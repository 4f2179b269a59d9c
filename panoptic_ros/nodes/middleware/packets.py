"""Messages as the middleware hands them over: bytes, of which the header is read at once, the rest later.

So what is dropped before anybody takes it costs nothing but its copy, and bytes that are no message end
no node.
"""

from __future__ import annotations

import struct
from typing import Any

from rclpy.serialization import deserialize_message

from panoptic_ros.errors import DataError

SECOND = 1_000_000_000
LITTLE_ENDIAN = b"\x00\x01"  # plain CDR; the first bytes of every message on the machines that ROS supports
HEADER = struct.Struct("<iII")  # sec, nanosec, and the length of frame_id with its final zero
BEGIN = 4  # of the content
ALIGNED = 8  # numbers of 8 bytes begin at multiples of it, from there on


def header_of(data: bytes) -> tuple[int, str]:
    """Stamp (ns) and frame_id of a message that begins with a std_msgs/Header.

    Raises:
        DataError: if it is too short, or its stamp is none.
    """
    end = BEGIN + HEADER.size
    if len(data) < end or data[:2] != LITTLE_ENDIAN:
        raise DataError(f"{len(data)} bytes are no message with a header")
    seconds, nanoseconds, length = HEADER.unpack_from(data, BEGIN)
    if nanoseconds >= SECOND:
        raise DataError(f"a stamp has nanosec = {nanoseconds}, which is a second and more")
    if end + length > len(data):
        raise DataError(f"a frame_id of {length} characters in a message of {len(data)} bytes")
    name = data[end : end + max(0, length - 1)].decode(errors="replace")
    return seconds * SECOND + nanoseconds, name


def stamp_in(data: bytes) -> int:
    """The stamp (ns) of a message that begins with a std_msgs/Header, if it is one: anything for others."""
    if len(data) < BEGIN + HEADER.size:
        return 0
    seconds, nanoseconds, _ = HEADER.unpack_from(data, BEGIN)
    return int(seconds * SECOND + nanoseconds)


def numbers_of(data: bytes, count: int) -> tuple[float, ...] | None:
    """All that follows the header of a message that holds nothing but so many float64; None: it is none.

    A fraction of what the generic way takes, which makes an object for each of its parts.
    """
    end = BEGIN + HEADER.size
    if len(data) < end or data[:2] != LITTLE_ENDIAN:
        return None
    *_, length = HEADER.unpack_from(data, BEGIN)
    begin = BEGIN + -(-(HEADER.size + length) // ALIGNED) * ALIGNED
    if len(data) != begin + 8 * count:
        return None
    return struct.unpack_from(f"<{count}d", data, begin)


def unpacked(data: bytes, kind: Any) -> Any:
    """The message.

    Raises:
        DataError: if the bytes are none of this kind.
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, ValueError, OverflowError, MemoryError, SystemError) as error:
        reason = str(error).split(", at ")[0].splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{len(data)} bytes are no {kind.__name__}: {reason}") from None
