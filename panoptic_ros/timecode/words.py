"""What the 80 bits of a timecode word mean (SMPTE ST 12-1)."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
WORD_CELLS = 80
SYNC = np.array([0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1], np.int8)  # bits 64 to 79
DIGITS = (  # tens and units: first bit and number of bits of each, largest value of the field
    ("frames", (8, 2), (0, 4), 29),
    ("seconds", (24, 3), (16, 4), 59),
    ("minutes", (40, 3), (32, 4), 59),
    ("hours", (56, 2), (48, 4), 23),
)
DROP_FRAME_BIT = 10


@dataclass(frozen=True, slots=True)
class Label:
    """The fields of a word; whether they make a timecode depends on the rate."""

    hours: int
    minutes: int
    seconds: int
    frames: int
    drop_frame: bool
    user_bits: int


def sync_matches(bits: Array, reverse: bool) -> Array:
    """Number of bits (N - 15,) that agree with the sync word from each place on."""
    pattern = SYNC[::-1] if reverse else SYNC
    windows = np.lib.stride_tricks.sliding_window_view(bits, len(pattern))
    return (windows == pattern).sum(axis=1)


def parse_word(bits: Array) -> Label | None:
    """The label of 80 bits in the order of sending; None if the sync word or a digit is wrong.

    The sync word must be complete but for one bit, all digits must be decimal and in range.
    """
    if int((bits[64:] == SYNC).sum()) < len(SYNC) - 1:
        return None
    fields = {}
    for name, tens, units, largest in DIGITS:
        high, low = _number(bits, *tens), _number(bits, *units)
        if low > 9 or 10 * high + low > largest:
            return None
        fields[name] = 10 * high + low
    drop = bool(bits[DROP_FRAME_BIT])
    if drop and fields["seconds"] == 0 and fields["frames"] < 2 and fields["minutes"] % 10:
        return None  # dropped labels are never sent
    user = sum(_number(bits, 8 * group + 4, 4) << (4 * group) for group in range(8))
    return Label(drop_frame=drop, user_bits=user, **fields)


def _number(bits: Array, first: int, count: int) -> int:
    """Least significant bit first."""
    return sum(int(bits[first + i]) << i for i in range(count))
