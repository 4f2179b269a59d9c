"""Convert raw images from the encodings of drivers to 8-bit BGR.

Supported are all of sensor_msgs/image_encodings (ROS 2 Jazzy and later) that hold a colour or grey image.
Signed and floating-point encodings are not. Case and blanks are ignored. YUV is BT.601 with luma from 16 to
235, as in OpenCV.
"""

from __future__ import annotations

import difflib
import re
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.errors import DataError

Array = np.ndarray
_CONVERSIONS = {
    "rgb": "COLOR_RGB2BGR",
    "bgra": "COLOR_BGRA2BGR",
    "rgba": "COLOR_RGBA2BGR",
    "mono": "COLOR_GRAY2BGR",
    "bayer_rggb": "COLOR_BayerRGGB2BGR",
    "bayer_bggr": "COLOR_BayerBGGR2BGR",
    "bayer_gbrg": "COLOR_BayerGBRG2BGR",
    "bayer_grbg": "COLOR_BayerGRBG2BGR",
    "yuyv": "COLOR_YUV2BGR_YUY2",
    "uyvy": "COLOR_YUV2BGR_UYVY",
    "nv12": "COLOR_YUV2BGR_NV12",
    "nv21": "COLOR_YUV2BGR_NV21",
}
# channels of a layout; other layouts have 1
_CHANNELS = {"bgr": 3, "rgb": 3, "bgra": 4, "rgba": 4, "yuyv": 2, "uyvy": 2}
BAYER = "bayer_"  # prefix of the encodings of Bayer mosaics
_MOSAICS = tuple(BAYER + pattern for pattern in ("rggb", "bggr", "gbrg", "grbg"))
_COLOURS = ("mono", "bgr", "rgb", "bgra", "rgba", *_MOSAICS)
_YUV = {
    "yuyv": "yuyv",
    "yuv422_yuy2": "yuyv",
    "yuy2": "yuyv",
    "uyvy": "uyvy",
    "yuv422": "uyvy",
    "nv12": "nv12",
    "nv21": "nv21",
    "nv24": "nv24",
}
_PLANES = {"nv12": 3, "nv21": 3, "nv24": 6}  # half bytes per pixel
_OF_CHANNELS = ("mono", "yuyv", "bgr", "bgra")  # OpenCV's meaning of 8UC1 to 8UC4
_DEPTHS = (8, 10, 12, 14, 16)  # significant bits of 16-bit values
_FROM_YUV = np.array(
    [  # ITU-R BT.601 with offsets, as in OpenCV: rows B, G, R of Y, U, V
        [1.164, 2.018, 0.0, -16 * 1.164 - 128 * 2.018],
        [1.164, -0.391, -0.813, -16 * 1.164 + 128 * (0.391 + 0.813)],
        [1.164, 0.0, 1.596, -16 * 1.164 - 128 * 1.596],
    ]
)
# Thresholds of the test for YUYV or UYVY, on mean steps between bytes (levels of 255). Luma of two neighbours
# differs no more than that of pixels two apart. Chroma bytes alternate between U and V, which differ more, or
# hardly differ.
_LEAST_STEP = 0.5  # below this step, an image has too few details to tell its encoding
# ratio of the step to the neighbour and the step to the next but one
_LIKE_BRIGHTNESS, _LIKE_COLOUR = 1.25, 1.5
_FLAT = 0.25  # fraction of the steps of the other bytes
_ROWS = 64  # image rows that are examined

ENCODINGS = (
    *(f"{name}{bits}" for name in _COLOURS for bits in (8, 16)),
    *(f"{bits}UC{count}" for bits in (8, 16) for count in (1, 2, 3, 4)),
    *_YUV,
)


class Encoding(NamedTuple):
    """Meaning of the bytes of an image.

    Args:
        layout: Order of the channels.
        size: Bytes of a value.
        bits: Significant bits of a value; 0 = estimated from the image.
        is_assumed: The encoding name does not state the colour channels.
    """

    layout: str
    size: int = 1
    bits: int = 8
    is_assumed: bool = False


class EncodingCheck(NamedTuple):
    """Result of examining an image: its encoding ("" = as stated) and a notice for the user ("" = none)."""

    encoding: str
    told: str


class _PixelDifferences(NamedTuple):
    """Mean differences (levels of 255) of a byte to the next pixel's, and to the next but one."""

    near: float
    far: float


def byte_array(message: Any) -> Array:
    """Return the data of a message as uint8, without a copy where possible."""
    if isinstance(message.data, bytes):
        return np.frombuffer(message.data, np.uint8)
    return np.asarray(message.data, np.uint8)


def pixel_rows(message: Any, pixel_bytes: int, what: str) -> Array:
    """Return the bytes (height, width * pixel_bytes) of an Image without row padding.

    Padding may be missing after the last row. `step` may be 0 if there is no padding.

    Raises:
        DataError: if the data have another length.
    """
    data = byte_array(message)
    width, height = int(message.width), int(message.height)
    step = int(message.step) or width * pixel_bytes
    padding = step - width * pixel_bytes
    if padding and data.size == step * height - padding:
        data = np.pad(data, (0, padding))
    if not width or not height or padding < 0 or data.size != step * height:
        raise DataError(
            f"{what}: {width} x {height} {message.encoding} with step {step} cannot have {data.size} bytes"
        )
    return data.reshape(height, step)[:, : width * pixel_bytes]


def encoding_of(name: str, what: str) -> Encoding:
    """Parse the name of an encoding: one of `ENCODINGS`, or a name such as mono12 for 12 bits in 16.

    Args:
        what: subject of error messages.

    Raises:
        DataError: if it is not a supported encoding of colour or grey images.
    """
    plain = "".join(name.split()).lower()
    if plain in _YUV:
        return Encoding(_YUV[plain])
    named = re.fullmatch(rf"({'|'.join(_COLOURS)})({'|'.join(map(str, _DEPTHS))})", plain)
    if named is not None:
        bits = int(named[2])
        return Encoding(named[1], 1 + (bits > 8), 0 if bits == 16 else bits)
    numbers = re.fullmatch(r"(8|16)uc([1-4]?)", plain)
    if numbers is not None:
        count, size = int(numbers[2] or 1), int(numbers[1]) // 8
        return Encoding(_OF_CHANNELS[count - 1], size, 8 * (size == 1), count > 1)
    near = difflib.get_close_matches(plain, [known.lower() for known in ENCODINGS], 1)
    hint = f", perhaps {near[0]}" if near else ""
    raise DataError(f"{what} has encoding {name[:40]!r}{hint}; supported: {', '.join(ENCODINGS)}")


def is_mosaic(name: str) -> bool:
    """Return whether an encoding name is a Bayer mosaic."""
    return "".join(name.split()).lower().startswith(BAYER)


def picture_of(message: Any, what: str, encoding: str = "") -> Array:
    """Convert an Image message to an image (height, width, 3) uint8 BGR.

    Args:
        what: subject of error messages.
        encoding: overrides the encoding in the message.

    Raises:
        DataError: on unsupported encodings and wrong lengths.
    """
    form = encoding_of(encoding or str(message.encoding), what)
    if form.layout in _PLANES:
        return _of_planes(message, form.layout, what)
    return bgr_of(_values(message, form, what), form, what)


def bgr_of(values: Array, form: Encoding, what: str) -> Array:
    """Convert values (h, w, channels) uint8 or uint16 to BGR (h, w, 3) uint8.

    Raises:
        DataError: if an image of this size cannot have the encoding.
    """
    return _converted(values if form.size == 1 else stretched(values[..., :3], form.bits), form.layout, what)


def stretched(values: Array, bits: int = 0) -> Array:
    """Convert uint16 values of cameras with 10, 12 or 14 bits to 8 bits.

    Args:
        bits: significant bits; 0 = the fewest of 8, 10, 12, 14 or 16 that hold the largest value.
    """
    used = bits or _bits_of(values)
    found: Array = np.minimum(values >> (used - 8), 255).astype(np.uint8)
    return found


def shown_by(message: Any, what: str) -> EncodingCheck | None:
    """Estimate an image's encoding from its content; None if the image has too few details.

    Some drivers label YUYV as yuv422, which means UYVY. Luma and chroma are then swapped.

    Raises:
        DataError: as `picture_of`.
    """
    stated = str(message.encoding)
    form = encoding_of(stated, what)
    if form.layout in ("yuyv", "uyvy") and form.size == 1:
        values = _values(message, form, what)
        luma, chroma = (_steps_of(values[..., k]) for k in ((0, 1) if form.layout == "yuyv" else (1, 0)))
        if max(luma.far, chroma.far) < _LEAST_STEP:
            return None
        is_colour = luma.near > _LIKE_COLOUR * luma.far or luma.far < _FLAT * chroma.far
        if is_colour and chroma.near < _LIKE_BRIGHTNESS * chroma.far:
            other = "uyvy" if form.layout == "yuyv" else "yuyv"
            return EncodingCheck(
                other,
                f"{what} has encoding {stated}, but shows brightness instead of its colours: read as {other}",
            )
    if form.is_assumed:
        return EncodingCheck(
            "", f"{what} has encoding {stated}, which names no colours: read as {form.layout}"
        )
    if form.size == 2 and not form.bits:
        used = _bits_of(_values(message, form, what)[..., :3])
        told = f"{what} has {used} bits in 16: scaled to the full range" if used < 16 else ""
        return EncodingCheck("", told)
    return EncodingCheck("", "")


def _values(message: Any, form: Encoding, what: str) -> Array:
    """Return the values (height, width, channels) of an Image without row padding."""
    channels = _CHANNELS.get(form.layout, 1)
    rows = pixel_rows(message, channels * form.size, what)
    if form.size == 2:
        rows = np.ascontiguousarray(rows).view(">u2" if message.is_bigendian else "<u2")
    values: Array = rows.reshape(int(message.height), int(message.width), channels)
    return values


def _converted(values: Array, layout: str, what: str) -> Array:
    """Convert uint8 values in a layout to BGR; the alpha channel may already be removed."""
    if layout in ("bgra", "rgba") and values.shape[2] == 3:
        layout = layout[:3]
    if layout not in _CONVERSIONS:
        return values
    import cv2  # 17 MB, which processes without images need not load

    try:
        return cv2.cvtColor(np.ascontiguousarray(values), getattr(cv2, _CONVERSIONS[layout]))
    except cv2.error:
        height, width = values.shape[:2]
        raise DataError(f"{what}: {width} x {height} pixels cannot be encoded as {layout}") from None


def _of_planes(message: Any, layout: str, what: str) -> Array:
    """Convert an image of a luma plane followed by a plane of chroma pairs to BGR.

    Rows may be padded. `height` is that of the image, or of both planes together.

    Raises:
        DataError: if the data have another length.
    """
    data, halves = byte_array(message), _PLANES[layout]
    width, height, step = int(message.width), int(message.height), int(message.step)
    sizes = [(step, height), (width, height), (step, 2 * height // halves)]
    fit = [(s, h) for s, h in sizes if s >= width > 0 and h > 0 and 2 * data.size == halves * s * h]
    if not fit or (layout != "nv24" and (width % 2 or fit[0][1] % 2)):
        raise DataError(f"{what}: {width} x {height} {layout} with step {step} cannot have {data.size} bytes")
    stride, height = fit[0]
    if layout != "nv24":
        return _converted(data.reshape(3 * height // 2, stride)[:, :width], layout, what)
    import cv2  # 17 MB, as above

    luma = data[: stride * height].reshape(height, stride, 1)[:, :width]
    pairs = data[stride * height :].reshape(height, stride, 2)[:, :width]
    picture: Array = cv2.transform(np.concatenate([luma, pairs], axis=2), _FROM_YUV)
    return picture


def _bits_of(values: Array) -> int:
    used = int(values.max(initial=0)).bit_length()
    return next(bits for bits in _DEPTHS if bits >= used)


def _steps_of(values: Array) -> _PixelDifferences:
    """Return the mean steps in a plane (h, w) of bytes."""
    some = values[:: max(1, len(values) // _ROWS)].astype(np.int16)
    near, far = (np.abs(some[:, k:] - some[:, :-k]) for k in (1, 2))
    return (
        _PixelDifferences(float(near.mean()), float(far.mean())) if far.size else _PixelDifferences(0.0, 0.0)
    )
