"""Read image sizes from file headers, so that an image of a wrong or excessive size is never decoded.

PNG (W3C), JPEG (ISO/IEC 10918-1), TIFF 6.0 and Exif, BMP, WebP (RFC 9649). A PNG of 1 MB can hold 1 Gpx.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from panoptic_ros.errors import DataError

Array = np.ndarray
MOST_PIXELS = 100_000_000  # px of a decoded image, 300 MB; video cameras have 65 Mpx at most
PNG, JPEG, TIFF = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", (b"II*\0", b"MM\0*")
WIDTH, HEIGHT, ORIENTATION = 256, 257, 274  # tags of TIFF and Exif
TURNED = (5, 6, 7, 8)  # values of ORIENTATION for which the decoder rotates the image by 90 degrees
NO_SIZE = {0xC4, 0xC8, 0xCC}  # JPEG markers in the range of frame markers that hold no size


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height (px) of the decoded image; None if the header cannot be read."""
    try:
        size, turned = _size(data)
    except (struct.error, IndexError, ValueError):
        return None
    if size[0] <= 0 or size[1] <= 0:
        return None
    return (size[1], size[0]) if turned else size


def decode_picture(
    data: Array, flags: int, what: str, expected: tuple[int, int] | None = None, most: int = MOST_PIXELS
) -> Array | None:
    """Decode an image if the size in its header is valid.

    Args:
        data: (N,) uint8, the encoded image.
        flags: flags of `cv2.imdecode`.
        what: subject of error messages.
        expected: width and height, px; None = any.
        most: largest number of pixels.

    Returns:
        None if the data cannot be decoded as an image.

    Raises:
        DataError: if the size in the header is not the expected one, or exceeds `most`.
    """
    import cv2  # 17 MB, which processes without images need not load

    held = data.tobytes()
    size = picture_size(held)
    if size is None or not _is_whole(held):
        return None
    if expected is not None and sorted(size) != sorted(expected):  # the decoder may rotate the image
        raise DataError(f"{what} is {size[0]}x{size[1]}, expected {expected[0]}x{expected[1]}")
    if size[0] * size[1] > most:
        raise DataError(
            f"{what} is {size[0]}x{size[1]}, more than {most // 1_000_000} Mpx; make it smaller or remove it"
        )
    try:
        image: Array | None = cv2.imdecode(data, flags)
    except cv2.error:
        return None
    return image


def _is_whole(data: bytes) -> bool:
    """Check the checksums of a PNG, because its decoder prints to stderr if they are wrong."""
    at = len(PNG)
    while data.startswith(PNG):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + length
        stated = data[end : end + 4]
        if len(stated) < 4 or int.from_bytes(stated, "big") != zlib.crc32(data[at + 4 : end]):
            return False
        if kind == b"IEND":
            break
        at = end + 4
    return True


def _size(data: bytes) -> tuple[tuple[int, int], bool]:
    """Return the stored width and height, and whether the decoder rotates the image by 90 degrees."""
    if data.startswith(PNG) and data[12:16] == b"IHDR":
        begin = data.find(b"eXIf", 33, 4096)
        return struct.unpack(">II", data[16:24]), begin > 0 and _is_turned(data[begin + 4 : begin + 1024])
    if data.startswith(JPEG):
        return _size_of_jpeg(data)
    if data.startswith(TIFF):
        tags = _tags(data)
        return (tags.get(WIDTH, 0), tags.get(HEIGHT, 0)), tags.get(ORIENTATION) in TURNED
    if data.startswith(b"BM"):
        width, height = struct.unpack("<ii", data[18:26])
        return (width, abs(height)), False
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return _size_of_webp(data), False
    raise ValueError("no picture")


def _size_of_jpeg(data: bytes) -> tuple[tuple[int, int], bool]:
    at, turned = 2, False
    while True:
        while data[at + 1] == 0xFF:  # fill bytes
            at += 1
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2 : at + 4])[0]
        if data[at] != 0xFF or length < 2:
            raise ValueError("no marker")
        if 0xC0 <= marker <= 0xCF and marker not in NO_SIZE:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return (width, height), turned
        if marker == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            turned = turned or _is_turned(data[at + 10 : at + 2 + length])
        at += 2 + length


def _size_of_webp(data: bytes) -> tuple[int, int]:
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        bits = struct.unpack("<I", data[21:25])[0]
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = struct.unpack("<HH", data[26:30])
    return width & 0x3FFF, height & 0x3FFF


def _is_turned(exif: bytes) -> bool:
    try:
        return _tags(exif).get(ORIENTATION) in TURNED
    except (struct.error, ValueError):
        return False


def _tags(data: bytes) -> dict[int, int]:
    """Return the 16-bit and 32-bit integer tags of the first TIFF directory."""
    if not data.startswith(TIFF):
        raise ValueError("no TIFF")
    order = "<" if data[:2] == b"II" else ">"
    begin = struct.unpack(order + "I", data[4:8])[0]
    count = struct.unpack(order + "H", data[begin : begin + 2])[0]
    found = {}
    for k in range(count):
        at = begin + 2 + 12 * k
        tag, kind, number = struct.unpack(order + "HHI", data[at : at + 8])
        if number == 1 and kind in (3, 4):
            found[tag] = struct.unpack(order + "HI"[kind - 3], data[at + 8 : at + 8 + 2 * (kind - 2)])[0]
    return found
