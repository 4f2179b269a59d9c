"""Depth maps from sensor_msgs: images (REP 118), and what compressed_depth_image_transport makes of them."""
from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.arrays import byte_array, pixel_rows

Array = np.ndarray
_KINDS = {"16UC1": np.uint16, "32FC1": np.float32}
_KNOWN = "16UC1 (mm), 32FC1 (m)"
_HEADER = struct.Struct("<iff")  # how it was compressed, and the numbers a, b of inverse depths


def depth_from_message(message: Any, camera: str) -> Array:
    """A depth map (h, w) float32 m, 0 or not finite = unknown.

    Args:
        message: Image of encoding 16UC1 (mm) or 32FC1 (m), or CompressedImage of one of them whose format
            is "ENCODING; compressedDepth png".

    Raises:
        DataError: on another encoding, a wrong length, or a broken PNG.
    """
    what = f"depth map of camera {camera}"
    unpack = _decompressed if hasattr(message, "format") else _unpacked
    return unpack(message, what)


def _unpacked(message: Any, what: str) -> Array:
    encoding = str(message.encoding)
    if encoding not in _KINDS:
        raise DataError(f"{what} has encoding {encoding!r}; supported: {_KNOWN}")
    kind = np.dtype(_KINDS[encoding]).newbyteorder(">" if message.is_bigendian else "<")
    rows = pixel_rows(message, kind.itemsize, what)
    return _metres(np.ascontiguousarray(rows).view(kind), encoding)


def _decompressed(message: Any, what: str) -> Array:
    """A header, then a PNG of 16 bits: the millimetres themselves, or v = a / metres + b, 0 = unknown."""
    encoding, _, how = (part.strip() for part in str(message.format).partition(";"))
    if encoding not in _KINDS or how not in ("compressedDepth", "compressedDepth png"):
        raise DataError(
            f"{what} has format {str(message.format)!r}; supported: compressedDepth png of {_KNOWN}"
        )
    data = byte_array(message)
    levels = cv2.imdecode(data[_HEADER.size :], cv2.IMREAD_UNCHANGED) if data.size > _HEADER.size else None
    if levels is None or levels.dtype != np.uint16 or levels.ndim != 2:
        raise DataError(f"{what}: no PNG of 16 bits in its {data.size} bytes ({message.format})")
    if encoding == "16UC1":
        return _metres(levels, encoding)
    _, scale, shift = _HEADER.unpack_from(data.tobytes()[: _HEADER.size])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        metres = np.float32(scale) / (levels.astype(np.float32) - np.float32(shift))
    return np.where(levels > 0, metres, np.float32(np.nan))


def _metres(depth: Array, encoding: str) -> Array:
    return depth.astype(np.float32) * np.float32(1e-3 if encoding == "16UC1" else 1.0)
