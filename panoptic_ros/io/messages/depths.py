"""Read depth maps from sensor_msgs: raw images (REP 118) and those of compressed_depth_image_transport."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.encodings import byte_array, pixel_rows
from panoptic_ros.io.pictures import decode_picture

Array = np.ndarray
_KINDS = {"16UC1": np.uint16, "32FC1": np.float32}
_NAMES = {"16UC1": "16UC1", "MONO16": "16UC1", "32FC1": "32FC1"}  # encoding names of drivers
_KNOWN = "16UC1 (mm), 32FC1 (m)"
_SIZE = struct.Struct("<II")  # columns and rows of RVL
MOST_PIXELS = 2**26
_MOST_NIBBLES = 10  # nibbles of a 32-bit number in RVL, three bits each
_HEADER = struct.Struct("<iff")  # compression format, and the parameters a, b of the inverse depth


def depth_from_message(message: Any, camera: str) -> Array:
    """Return a depth map (h, w) float32 m; 0 or not finite = unknown.

    Args:
        message: Image with encoding 16UC1 (mm) or 32FC1 (m), or CompressedImage of one of them with format
            "ENCODING; compressedDepth png" or "ENCODING; compressedDepth rvl".

    Raises:
        DataError: on another encoding, a wrong length, or corrupt data.
    """
    what = f"depth map of camera {camera}"
    unpack = _decompressed if hasattr(message, "format") else _unpacked
    return unpack(message, what)


def _unpacked(message: Any, what: str) -> Array:
    stated = str(message.encoding)
    encoding = _NAMES.get("".join(stated.split()).upper(), "")
    if not encoding:
        raise DataError(f"{what} has encoding {stated[:40]!r}; supported: {_KNOWN}")
    kind = np.dtype(_KINDS[encoding]).newbyteorder(">" if message.is_bigendian else "<")
    rows = pixel_rows(message, kind.itemsize, what)
    return _metres(np.ascontiguousarray(rows).view(kind), encoding)


def _decompressed(message: Any, what: str) -> Array:
    """Return the depth map (h, w) m of a CompressedImage.

    The data are a header and 16-bit values v as PNG or RVL. v is the depth in mm, or v = a / metres + b; 0 =
    unknown.

    Raises:
        DataError: as `depth_from_message`.
    """
    encoding, _, how = (part.strip() for part in str(message.format).partition(";"))
    if encoding not in _KINDS or how not in ("compressedDepth", "compressedDepth png", "compressedDepth rvl"):
        raise DataError(
            f"{what} has format {str(message.format)!r}; supported: compressedDepth png and rvl of {_KNOWN}"
        )
    data = byte_array(message)
    packed = data[_HEADER.size :]
    levels = _levels_of_rvl(packed, what) if how.endswith("rvl") else _levels_of_png(packed, what)
    if encoding == "16UC1":
        return _metres(levels, encoding)
    _, scale, shift = _HEADER.unpack_from(data.tobytes()[: _HEADER.size])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        metres = np.float32(scale) / (levels.astype(np.float32) - np.float32(shift))
    return np.where(levels > 0, metres, np.float32(np.nan))


def _levels_of_png(data: Array, what: str) -> Array:
    import cv2  # 17 MB, which processes without images need not load

    levels = decode_picture(data, cv2.IMREAD_UNCHANGED, what, most=MOST_PIXELS)
    if levels is None or levels.dtype != np.uint16 or levels.ndim != 2:
        raise DataError(f"{what}: no PNG of 16 bits in its {data.size} bytes")
    return levels


def _levels_of_rvl(data: Array, what: str) -> Array:
    """Return the 16-bit values (rows, columns) of RVL data: columns and rows as uint32, then the stream.

    Raises:
        DataError: if the size is invalid, or as `decode_rvl`.
    """
    if data.size < _SIZE.size:
        raise DataError(f"{what}: no RVL in its {data.size} bytes")
    columns, rows = _SIZE.unpack_from(data.tobytes()[: _SIZE.size])
    if not 0 < columns * rows <= MOST_PIXELS:
        raise DataError(f"{what}: its RVL header states {columns} x {rows} pixels")
    stream = data[_SIZE.size :].tobytes()
    return decode_rvl(stream, columns * rows, what).reshape(rows, columns)


def _metres(depth: Array, encoding: str) -> Array:
    return depth.astype(np.float32) * np.float32(1e-3 if encoding == "16UC1" else 1.0)


def decode_rvl(data: bytes, count: int, what: str) -> Array:
    """Decode the pixels (count,) uint16 of an RVL stream, the run-length code of depth maps (Wilson 2017).

    The stream is a sequence of numbers with 3 bits per nibble. It alternates between the count of zero
    pixels, the count of non-zero pixels, and the differences between successive non-zero pixels (zigzag).

    Args:
        what: subject of error messages.

    Raises:
        DataError: if the stream ends early, or holds more than `count` pixels.
    """
    numbers = _numbers(data)
    places, deltas = [], []  # of each run of non-zero pixels: their indices and zigzag differences
    pixel = at = 0
    while pixel < count:
        if at + 1 >= len(numbers):
            raise DataError(f"{what}: its RVL data end at pixel {pixel} of {count}")
        pixel, run = pixel + int(numbers[at]), int(numbers[at + 1])
        places.append(np.arange(pixel, min(pixel + run, count)))
        deltas.append(numbers[at + 2 : at + 2 + run])
        pixel, at = pixel + run, at + 2 + run
    if pixel > count or at > len(numbers):
        raise DataError(f"{what}: its RVL data are damaged: they describe {pixel} pixels, it has {count}")
    pixels = np.zeros(count, np.int64)
    zigzag = np.concatenate([np.zeros(0, np.int64), *deltas])
    pixels[np.concatenate([np.zeros(0, np.int64), *places])] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1))
    return pixels.astype(np.uint16)


def _numbers(data: bytes) -> Array:
    """Return the numbers of a stream.

    A number is a sequence of nibbles with three value bits and a continuation bit each. Words are read from
    their highest nibble.
    """
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
