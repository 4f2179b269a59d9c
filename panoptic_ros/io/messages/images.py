"""Convert images to sensor_msgs and back, render score maps as images, and detect video packets."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import DepthFrame, Preview, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.depths import depth_from_message
from panoptic_ros.io.messages.encodings import (
    bgr_of,
    byte_array,
    encoding_of,
    is_mosaic,
    picture_of,
    stretched,
)
from panoptic_ros.io.messages.family import MessageFamily, stamp_of
from panoptic_ros.io.pictures import decode_picture

Array = np.ndarray
OPTICAL = "_optical_frame"
VIDEO_FORMATS = ("h264", "h265", "hevc", "av1", "vp8", "vp9", "mpeg4")  # video packets in CompressedImage
WIDEST = 640  # px, width limit of an image of score maps
# image_transport plugin by message type
PLUGINS = {
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "ffmpeg",
    "foxglove_msgs/msg/CompressedVideo": "foxglove",
    "theora_image_transport/msg/Packet": "theora",
}
_WHEN = "of a bag while `ros2 bag play` plays it, and record these"
REMEDY = f"make images of it with `ros2 run image_transport republish`, {_WHEN}"


def optical_frame(camera: str) -> str:
    """Return the frame id of a camera's images (REP-103: z forward, x right, y down)."""
    return f"{camera}{OPTICAL}"


def _raw(picture: Array, encoding: str, camera: str, stamp_ns: int, family: MessageFamily) -> Any:
    """Build a sensor_msgs/Image of values (height, width, ...) without row padding."""
    height, width = picture.shape[:2]
    data = np.ascontiguousarray(picture).view(np.uint8).reshape(-1)
    return family.make(
        "sensor_msgs/msg/Image",
        header=family.header(stamp_ns, optical_frame(camera)),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=len(data) // height,
        data=family.sequence(data),
    )


def _compressed(data: Array, form: str, camera: str, stamp_ns: int, family: MessageFamily) -> Any:
    """Build a sensor_msgs/CompressedImage."""
    return family.make(
        "sensor_msgs/msg/CompressedImage",
        header=family.header(stamp_ns, optical_frame(camera)),
        format=form,
        data=family.sequence(data),
    )


def image_message(frame: ViewFrame, family: MessageFamily) -> Any:
    """Build a sensor_msgs/Image with encoding bgr8."""
    return _raw(frame.image, "bgr8", frame.camera, frame.stamp_ns, family)


def compressed_image_message(frame: ViewFrame, family: MessageFamily, quality: int) -> Any:
    """Build a sensor_msgs/CompressedImage, JPEG of the given quality (1 to 100)."""
    import cv2  # 17 MB, which processes without images need not load

    _, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    form = "bgr8; jpeg compressed bgr8"
    return _compressed(data.reshape(-1), form, frame.camera, frame.stamp_ns, family)


def write_preview(preview: Preview, family: MessageFamily, frame_id: str) -> Any:
    """Build a sensor_msgs/CompressedImage of a preview."""
    data = np.frombuffer(preview.jpeg, np.uint8)
    return _compressed(data, "jpeg", preview.camera, preview.stamp_ns, family)


def read_preview(message: Any) -> Preview:
    """Read a preview; the frame id of the message names the camera."""
    camera = str(message.header.frame_id).removesuffix(OPTICAL)
    return Preview(camera, stamp_of(message.header), byte_array(message).tobytes())


def depth_message(frame: DepthFrame, family: MessageFamily) -> Any:
    """Build a sensor_msgs/Image of a depth map, 32FC1 in metres (REP 118)."""
    depth = np.ascontiguousarray(frame.depth, "<f4")
    return _raw(depth, "32FC1", frame.camera, frame.stamp_ns, family)


def frame_from_message(message: Any, camera: str, frame_number: int, encoding: str = "") -> ViewFrame:
    """Convert an Image or CompressedImage to a frame.

    Args:
        frame_number: counted by the caller, because the message has no number.
        encoding: overrides the encoding in the message; for compressed images only a Bayer encoding has an
            effect.

    Raises:
        DataError: on unsupported encodings, wrong lengths or corrupt JPEG.
    """
    what = f"image of camera {camera}"
    if hasattr(message, "format"):
        image = _decode(message, camera, encoding)
    else:
        image = picture_of(message, what, encoding)
    return ViewFrame(camera, stamp_of(message.header), frame_number, image)


def depth_frame_from_message(message: Any, camera: str, frame_number: int) -> DepthFrame:
    """Convert an Image or CompressedImage to a depth map, as `depth_from_message`.

    Args:
        frame_number: counted by the caller, because the message has no number.

    Raises:
        DataError: as `depth_from_message`.
    """
    return DepthFrame(camera, stamp_of(message.header), frame_number, depth_from_message(message, camera))


def _decode(message: Any, camera: str, encoding: str) -> Array:
    import cv2  # 17 MB, as above

    what, stated = f"compressed image of camera {camera}", str(message.format)
    raw, _, packed = stated.lower().partition(";")
    # image_transport compresses a mosaic as a one-channel image, unless the format names another encoding.
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


def heat_map(view: ViewDetections, joint: int = -1) -> Array:
    """Render the largest score of all joints, or the score of one joint, as (h, w) uint8, 255 = 1.

    The result has the aspect ratio of the view's image and is at most `WIDEST` wide. It is 0 if the view has
    no maps.

    Args:
        joint: index; -1 = all joints.
    """
    import cv2  # 17 MB, which processes without images need not load

    width, height = view.image_size
    columns = min(width, WIDEST)
    rows = max(1, round(height * columns / width))
    if view.maps is None:
        return np.zeros((rows, columns), np.uint8)
    grid = np.zeros(view.maps.grid_size[::-1], np.uint8)
    begin = 0
    for owner, (left, top), (wide, high) in zip(view.maps.joints, view.maps.corners, view.maps.sizes):
        patch = view.maps.data[begin : begin + wide * high].reshape(high, wide)
        begin += wide * high
        if joint in (-1, owner):
            place = grid[top : top + high, left : left + wide]
            np.maximum(place, patch, out=place)
    step = width / columns  # image pixels per result pixel; pixel centre (0, 0) is the first pixel of both
    image_from_picture = np.array([[step, 0, (step - 1) / 2], [0, step, (step - 1) / 2], [0, 0, 1]])
    grid_from_picture = view.maps.grid_from_image @ image_from_picture
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(grid, grid_from_picture, (columns, rows), flags=how))


def heat_map_message(view: ViewDetections, family: MessageFamily, joint: int = -1) -> Any:
    """Build a sensor_msgs/Image, mono8, of `heat_map`."""
    return _raw(heat_map(view, joint), "mono8", view.camera, view.stamp_ns, family)


def is_video(kind: str) -> bool:
    """Return whether a message type holds video packets."""
    return kind in PLUGINS


def video_told(topic: str, kind: str) -> str:
    """Return the notice about a video topic, with the command to convert it."""
    plugin, base = PLUGINS[kind], topic.rsplit("/", 1)[0]
    words = (
        f"-p in_transport:={plugin} -p out_transport:=compressed -r in/{plugin}:={topic} "
        f"-r out/compressed:={base}/compressed"
    )
    return (
        f"{topic} is compressed video ({kind.split('/')[-1]}), which is not read; make images of it with "
        f"`ros2 run image_transport republish --ros-args {words}`, {_WHEN}"
    )
