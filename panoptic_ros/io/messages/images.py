"""Images as sensor_msgs, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import DepthFrame, Preview, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.arrays import byte_array
from panoptic_ros.io.messages.depths import depth_from_message
from panoptic_ros.io.messages.encodings import bgr_of, encoding_of, is_mosaic, picture_of, stretched
from panoptic_ros.io.messages.family import Messages, stamp_of
from panoptic_ros.io.messages.videos import REMEDY
from panoptic_ros.io.pictures import decode_picture

Array = np.ndarray
OPTICAL = "_optical_frame"
VIDEO_FORMATS = ("h264", "h265", "hevc", "av1", "vp8", "vp9", "mpeg4")  # packets of videos in CompressedImage


def optical_frame(camera: str) -> str:
    """The frame id of a camera's images (REP-103: z forward, x right, y down)."""
    return f"{camera}{OPTICAL}"


def image_message(frame: ViewFrame, family: Messages) -> Any:
    """sensor_msgs/Image, bgr8."""
    height, width = frame.image.shape[:2]
    return family.make(
        "sensor_msgs/msg/Image",
        header=family.header(frame.stamp_ns, optical_frame(frame.camera)),
        height=height,
        width=width,
        encoding="bgr8",
        is_bigendian=0,
        step=3 * width,
        data=family.sequence(np.ascontiguousarray(frame.image).reshape(-1)),
    )


def compressed_image_message(frame: ViewFrame, family: Messages, quality: int) -> Any:
    """sensor_msgs/CompressedImage, JPEG of that quality (1 to 100)."""
    import cv2  # 17 MB, which processes without images do without

    _, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return family.make(
        "sensor_msgs/msg/CompressedImage",
        header=family.header(frame.stamp_ns, optical_frame(frame.camera)),
        format="bgr8; jpeg compressed bgr8",
        data=family.sequence(data.reshape(-1)),
    )


def write_preview(preview: Preview, family: Messages, frame_id: str) -> Any:
    """sensor_msgs/CompressedImage."""
    return family.make(
        "sensor_msgs/msg/CompressedImage",
        header=family.header(preview.stamp_ns, optical_frame(preview.camera)),
        format="jpeg",
        data=family.sequence(np.frombuffer(preview.jpeg, np.uint8)),
    )


def read_preview(message: Any) -> Preview:
    """The camera is that of the message's frame."""
    camera = str(message.header.frame_id).removesuffix(OPTICAL)
    return Preview(camera, stamp_of(message.header), byte_array(message).tobytes())


def depth_message(frame: DepthFrame, family: Messages) -> Any:
    """sensor_msgs/Image of a depth map, 32FC1 in metres (REP 118)."""
    depth = np.ascontiguousarray(frame.depth, "<f4")
    return family.make(
        "sensor_msgs/msg/Image",
        header=family.header(frame.stamp_ns, optical_frame(frame.camera)),
        height=depth.shape[0],
        width=depth.shape[1],
        encoding="32FC1",
        is_bigendian=0,
        step=4 * depth.shape[1],
        data=family.sequence(depth.view(np.uint8).reshape(-1)),
    )


def frame_from_message(message: Any, camera: str, frame_number: int, encoding: str = "") -> ViewFrame:
    """A frame from Image or CompressedImage; the message has no number, so the caller counts.

    Args:
        encoding: overrides what the message states; of compressed images only that of a mosaic counts.

    Raises:
        DataError: on encodings that are not supported, wrong lengths or broken JPEG.
    """
    what = f"image of camera {camera}"
    if hasattr(message, "format"):
        image = _decode(message, camera, encoding)
    else:
        image = picture_of(message, what, encoding)
    return ViewFrame(camera, stamp_of(message.header), frame_number, image)


def depth_frame_from_message(message: Any, camera: str, frame_number: int) -> DepthFrame:
    """A depth map from Image or CompressedImage, as `depth_from_message`; the caller counts.

    Raises:
        DataError: as `depth_from_message`.
    """
    return DepthFrame(camera, stamp_of(message.header), frame_number, depth_from_message(message, camera))


def _decode(message: Any, camera: str, encoding: str) -> Array:
    import cv2  # see above

    what, stated = f"compressed image of camera {camera}", str(message.format)
    raw, _, packed = stated.lower().partition(";")
    # image_transport leaves mosaics as they are in a picture of one channel, where it names no other one
    mosaic = encoding or (raw if packed.strip().endswith(("compressed", raw.strip())) else "")
    flags = (cv2.IMREAD_GRAYSCALE if is_mosaic(mosaic) else cv2.IMREAD_COLOR) | cv2.IMREAD_ANYDEPTH
    image = decode_picture(byte_array(message), flags, what)
    if image is None:
        hint = f", as it is video; {REMEDY}" if raw.strip() in VIDEO_FORMATS else ""
        raise DataError(f"{what} ({stated!r}) cannot be decoded{hint}")
    if image.dtype != np.uint8 and image.dtype != np.uint16:
        raise DataError(f"{what} ({stated!r}) has {image.dtype} values, expected 8 or 16 bits")
    if is_mosaic(mosaic):
        form = encoding_of(mosaic, what)
        return bgr_of(image[..., None], form._replace(size=image.dtype.itemsize, bits=0), what)
    return image if image.dtype == np.uint8 else stretched(image)
