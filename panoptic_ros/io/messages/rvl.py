"""RVL, the run-length code of depth maps in compressed_depth_image_transport (Wilson 2017)."""

from __future__ import annotations

import numpy as np

from panoptic_ros.errors import DataError

Array = np.ndarray
_MOST_NIBBLES = 10  # of a number of 32 bits, three bits each


def decode_rvl(data: bytes, count: int, what: str) -> Array:
    """The pixels (count,) uint16 of an RVL stream.

    It is a row of numbers of 3 bits a nibble, by turns: how many pixels are 0, how many follow that are not,
    and of each of these the difference to the one before it (zigzag).

    Args:
        what: the image, for the message.

    Raises:
        DataError: if the stream ends early, or holds more than the pixels.
    """
    numbers = _numbers(data)
    places, deltas = [], []  # of runs that are not 0
    pixel = at = 0
    while pixel < count:
        if at + 1 >= len(numbers):
            raise DataError(f"{what}: its RVL data end at pixel {pixel} of {count}")
        pixel, run = pixel + int(numbers[at]), int(numbers[at + 1])
        places.append(np.arange(pixel, min(pixel + run, count)))
        deltas.append(numbers[at + 2 : at + 2 + run])
        pixel, at = pixel + run, at + 2 + run
    if pixel > count or at > len(numbers):
        raise DataError(f"{what}: its RVL data are damaged: they tell of {pixel} pixels, it has {count}")
    pixels = np.zeros(count, np.int64)
    zigzag = np.concatenate([np.zeros(0, np.int64), *deltas])
    pixels[np.concatenate([np.zeros(0, np.int64), *places])] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1))
    return pixels.astype(np.uint16)


def _numbers(data: bytes) -> Array:
    """The numbers of a stream: words from their highest nibble on, of three bits and a mark for more."""
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4")
    nibbles = ((words[:, None] >> np.arange(28, -1, -4, dtype=np.uint32)) & 15).reshape(-1).astype(np.int64)
    ends = np.flatnonzero(nibbles < 8)
    if not len(ends):
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    used = nibbles[: ends[-1] + 1]
    place = np.arange(len(used)) - np.repeat(starts, ends - starts + 1)
    values = (used & 7) << (3 * np.minimum(place, _MOST_NIBBLES))
    numbers: Array = np.add.reduceat(values, starts) & 0xFFFFFFFF
    return numbers
