"""A bag again and again, one time after the other: a long recording out of a short one.

    python test/support/repeated_bag.py BAG LONG_BAG --minutes 60 [--without-maps]

Stamps and the numbers of frames and instants go on. What is said once for all (`/rig`, `/skeleton_model`) is
written once.
"""

import argparse
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr

HEADER = "std_msgs/msg/Header"
SECOND = 1_000_000_000
FRAMES = 100_000  # on from one time to the next: more than a bag has
STAMP_AT = 4  # of a message that begins with a header: int32 s, uint32 ns, behind four bytes of CDR
MARK = 0x7A11_B0B5_0000_0000  # stands for a number of which the place is looked for
NUMBERS = {
    "panoptic_msgs/msg/ViewDetections": ("frame_number",),
    "panoptic_msgs/msg/Skeletons": ("view_frames", "index"),
}


class Template(NamedTuple):
    """A message of the short bag, and what changes in it."""

    name: str
    kind: str
    stamp_ns: int  # of recording
    data: bytearray
    numbers: dict[int, int]  # uint64 by their places
    is_stamped: bool


def main() -> int:
    """Write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--without-maps", action="store_true", help="2D people without their score maps")
    args = parser.parse_args()
    repeat(args.bag, args.out, 60.0 * args.minutes, args.without_maps)
    return 0


def repeat(short: Path, long: Path, seconds: float, without_maps: bool = False) -> Path:
    """Write a bag as often as it takes to last so long; the long one."""
    latched = {topic.name for topic in TOPICS.values() if topic.latched}
    with BagReader(short) as bag, BagWriter(long) as out:
        rows = [_template(*row, without_maps) for row in bag.raw()]
        length = bag.end_ns - bag.begin_ns + SECOND // 25
        for turn in range(int(-(-seconds * SECOND // length))):
            later = turn * length
            for row in rows:
                if turn == 0 or row.name.strip("/") not in latched:
                    out.write_raw(row.name, row.kind, row.stamp_ns + later, _at(row, turn, later))
    return long


def _template(name: str, stamp_ns: int, data: bytes, kind: str, without_maps: bool) -> Template:
    store, plain = bag_typestore(), bytearray(data)
    if kind == "panoptic_msgs/msg/ViewDetections" and without_maps:
        view = replace(from_message(decode_cdr(data, kind), "ViewDetections"), maps=None)
        plain = bytearray(store.serialize_cdr(to_message(view, bag_messages()), kind))
    numbers = {}
    for field in NUMBERS.get(kind, ()):
        message: Any = decode_cdr(bytes(plain), kind)
        value = getattr(message, field)
        several = [value] if isinstance(value, int) else list(value)
        marks = [MARK + i for i in range(len(several))]
        setattr(message, field, marks[0] if isinstance(value, int) else type(value)(value.shape, value.dtype))
        if not isinstance(value, int):
            getattr(message, field)[:] = marks
        marked = bytes(store.serialize_cdr(message, kind))
        numbers |= {marked.index(struct.pack("<Q", mark)): int(n) for mark, n in zip(marks, several)}
    is_stamped = store.fielddefs[kind][1][0][1][1] == HEADER
    return Template(name, kind, stamp_ns, plain, numbers, is_stamped)


def _at(row: Template, turn: int, by_ns: int) -> bytes:
    """The message so much later."""
    moved = bytearray(row.data)
    if row.is_stamped:
        seconds, rest = struct.unpack_from("<iI", moved, STAMP_AT)
        struct.pack_into("<iI", moved, STAMP_AT, *divmod(seconds * SECOND + rest + by_ns, SECOND))
    for at, number in row.numbers.items():
        struct.pack_into("<Q", moved, at, number + turn * FRAMES)
    return bytes(moved)


if __name__ == "__main__":
    sys.exit(main())
