"""Read and replace the first fields of CDR bytes without decoding the message."""

from __future__ import annotations

import struct

SECOND = 1_000_000_000


def stamp_in(data: bytes) -> int | None:
    """Return the header timestamp (ns) of a message; None if the bytes hold no valid one."""
    if len(data) < 12:
        return None
    order = ">" if data[1:2] == b"\0" else "<"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return seconds * SECOND + nanoseconds if seconds >= 0 and nanoseconds < SECOND else None


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """Return the CDR bytes of a message with its header timestamp replaced."""
    order = ">" if data[1:2] == b"\0" else "<"
    return bytes(data[:4]) + struct.pack(f"{order}iI", *divmod(stamp_ns, SECOND)) + bytes(data[12:])


def number_in(data: bytes) -> int | None:
    """Return the 64-bit number after the header, as in ViewDetections: the camera's frame number.

    None if the message is too short.
    """
    if len(data) < 16:
        return None
    order = ">" if data[1:2] == b"\0" else "<"
    (length,) = struct.unpack_from(f"{order}I", data, 12)
    at = 4 + -(-(12 + length) // 8) * 8  # CDR alignment counts from behind the 4-byte encapsulation header
    return int(struct.unpack_from(f"{order}Q", data, at)[0]) if at + 8 <= len(data) else None
