"""Define the layout of the 80 bits of a timecode word (SMPTE ST 12-1)."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode

Array = np.ndarray
WORD_CELLS = 80
FREE = -1  # value of a bit that is unknown
SYNC = np.array([0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1], np.int8)  # sync word, bits 64 to 79
SYNC_BACK = np.ascontiguousarray(SYNC[::-1])
FIELDS = (  # (first bit, number of bits) of the units and of the tens, number of values
    ("hours", (48, 4), (56, 2), 24),
    ("minutes", (32, 4), (40, 3), 60),
    ("seconds", (16, 4), (24, 3), 60),
    ("frames", (0, 4), (8, 2), 30),
)
DROP_FRAME_BIT = 10
DROP_RATE = FrameRate(30, Fraction(30000, 1001), True)
# Label sequences. A word does not state whether 30 labels take 1 s or slightly longer.
COUNTINGS = (FrameRate(24, Fraction(24)), FrameRate(25, Fraction(25)), FrameRate(30, Fraction(30)), DROP_RATE)
USER_BITS = np.array([8 * group + 4 + i for group in range(8) for i in range(4)])

USER_WEIGHTS = 1 << np.arange(32, dtype=np.int64)


def _field_table(units: tuple[int, int], tens: tuple[int, int], values: int) -> tuple[Array, Array]:
    """Return the bit positions (B,) of a field, and the bits (values, B) of each of its values."""
    places = [units[0] + i for i in range(units[1])] + [tens[0] + i for i in range(tens[1])]
    rows = [
        [(value % 10 >> i) & 1 for i in range(units[1])] + [(value // 10 >> i) & 1 for i in range(tens[1])]
        for value in range(values)
    ]
    return np.array(places), np.array(rows, np.int8)


TABLES = {name: _field_table(units, tens, values) for name, units, tens, values in FIELDS}
SYNC_ONLY = np.full(WORD_CELLS, FREE, np.int8)
SYNC_ONLY[64:] = SYNC


def known_bits(label: Timecode) -> Array:
    """Return the bits (80,) that a label determines; user bits, flags and parity are `FREE`."""
    bits = SYNC_ONLY.copy()
    for name, (places, rows) in TABLES.items():
        bits[places] = rows[getattr(label, name)]
    bits[DROP_FRAME_BIT] = label.rate.drop_frame
    return bits
