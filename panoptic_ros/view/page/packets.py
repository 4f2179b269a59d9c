"""Messages on their way to a page: many in one binary packet.

A packet is 16 bytes, uint32 little endian: `MAGIC`, kind, number, count of messages; then for each message
uint32 topic (its place in the list that the page was told), uint32 length, uint32 0, its CDR bytes, and
zeros up to a multiple of 8. So what CDR aligns to 8 is aligned in the packet, too.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

MAGIC = 0x314E4150  # "PAN1"
HEAD = struct.Struct("<4I")
MESSAGE = struct.Struct("<3I")


class Kind(IntEnum):
    """What a packet is: the newest of a live graph, or a second of a recording."""

    LIVE = 0
    BLOCK = 1


class Message(NamedTuple):
    """CDR bytes of a topic, by its place in the list of topics."""

    topic: int
    data: bytes


def pack(kind: Kind, number: int, messages: Iterable[Message]) -> bytes:
    """One packet.

    Args:
        number: of the block, or the running number of a live packet.
    """
    parts, count = [b""], 0
    for topic, data in messages:
        parts += MESSAGE.pack(topic, len(data), 0), data, bytes(-(MESSAGE.size + len(data)) % 8)
        count += 1
    parts[0] = HEAD.pack(MAGIC, kind, number, count)
    return b"".join(parts)
