"""Raw messages: the header is parsed on arrival, and the body when the message is used.

A message that is dropped before its use costs only its copy. Bytes that are not a valid message do not end
the node.
"""

from __future__ import annotations

import struct
from typing import Any

from rclpy.serialization import deserialize_message

from panoptic_ros.errors import DataError

SECOND = 1_000_000_000
# encapsulation of plain CDR; the first bytes of every message on all platforms of ROS
LITTLE_ENDIAN = b"\x00\x01"
HEADER = struct.Struct("<iII")  # sec, nanosec, and length of frame_id with its final zero
BEGIN = 4  # offset of the content, bytes
ALIGNED = 8  # 8-byte numbers are aligned to multiples of 8 bytes from BEGIN on


def header_of(data: bytes) -> tuple[int, str]:
    """Return timestamp (ns) and frame_id of a message that begins with a std_msgs/Header.

    Raises:
        DataError: if the message is too short or its timestamp is invalid.
    """
    end = BEGIN + HEADER.size
    if len(data) < end or data[:2] != LITTLE_ENDIAN:
        raise DataError(f"{len(data)} bytes are not a message with a header")
    seconds, nanoseconds, length = HEADER.unpack_from(data, BEGIN)
    if nanoseconds >= SECOND:
        raise DataError(f"a stamp has nanosec = {nanoseconds}, which is a second and more")
    if end + length > len(data):
        raise DataError(f"a frame_id of {length} characters in a message of {len(data)} bytes")
    name = data[end : end + max(0, length - 1)].decode(errors="replace")
    return seconds * SECOND + nanoseconds, name


def stamp_in(data: bytes) -> int:
    """Return the timestamp (ns) of a message that begins with a std_msgs/Header.

    The result is arbitrary for other messages and 0 for those that are too short.
    """
    if len(data) < BEGIN + HEADER.size:
        return 0
    seconds, nanoseconds, _ = HEADER.unpack_from(data, BEGIN)
    return int(seconds * SECOND + nanoseconds)


def numbers_of(data: bytes, count: int) -> tuple[float, ...] | None:
    """Return the numbers behind the header of a message that holds nothing but `count` float64.

    This takes a fraction of the time of rclpy's deserialisation, which makes an object for each field.

    Returns:
        the numbers; None if the message does not have this layout.
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
    """Return the deserialised message.

    Raises:
        DataError: if the bytes are not a message of this type.
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, ValueError, OverflowError, MemoryError, SystemError) as error:
        reason = str(error).split(", at ")[0].splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{len(data)} bytes are not a {kind.__name__}: {reason}") from None
