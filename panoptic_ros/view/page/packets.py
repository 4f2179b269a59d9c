"""Binary packets that carry many messages to a page.

A packet begins with 16 bytes, uint32 little endian: `MAGIC`, kind, number, count of messages. Each message
follows as uint32 topic (its index in the page's topic list), uint32 length, uint32 0, CDR bytes, and zero
padding to a multiple of 8. With the 4-byte CDR header, the 12 bytes before it make 16. Values that CDR aligns
to 8 bytes are therefore aligned in the packet, too.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

MAGIC = 0x314E4150  # bytes "PAN1"
HEAD = struct.Struct("<4I")
MESSAGE = struct.Struct("<3I")


class PacketKind(IntEnum):
    """Kind of a packet: newest messages of a live graph, or one second of a recording."""

    LIVE = 0
    BLOCK = 1


class PageMessage(NamedTuple):
    """CDR bytes of one message, with the index of its topic in the topic list."""

    topic: int
    data: bytes


def pack(kind: PacketKind, number: int, messages: Iterable[PageMessage]) -> bytes:
    """Return one packet.

    Args:
        kind: Kind of the packet.
        number: Number of the block, or the running number of a live packet.
        messages: Messages in order.
    """
    parts, count = [b""], 0
    for topic, data in messages:
        parts += MESSAGE.pack(topic, len(data), 0), data, bytes(-(MESSAGE.size + len(data)) % 8)
        count += 1
    parts[0] = HEAD.pack(MAGIC, kind, number, count)
    return b"".join(parts)
