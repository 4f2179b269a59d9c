"""What stands at the front of CDR bytes, read without making messages of them."""

from __future__ import annotations

import struct

SECOND = 1_000_000_000


def stamp_in(data: bytes) -> int | None:
    """The stamp of a message that begins with a header, ns; None if there is none that could be."""
    if len(data) < 12:
        return None
    order = ">" if data[1:2] == b"\0" else "<"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return seconds * SECOND + nanoseconds if seconds >= 0 and nanoseconds < SECOND else None


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """CDR bytes of a message that begins with a header, with another stamp."""
    order = ">" if data[1:2] == b"\0" else "<"
    return bytes(data[:4]) + struct.pack(f"{order}iI", *divmod(stamp_ns, SECOND)) + bytes(data[12:])


def number_in(data: bytes) -> int | None:
    """The 64-bit number that follows a header, as in ViewDetections: frames that a camera gave."""
    if len(data) < 16:
        return None
    order = ">" if data[1:2] == b"\0" else "<"
    (length,) = struct.unpack_from(f"{order}I", data, 12)
    at = 4 + -(-(12 + length) // 8) * 8  # CDR aligns from behind its own four bytes
    return int(struct.unpack_from(f"{order}Q", data, at)[0]) if at + 8 <= len(data) else None
