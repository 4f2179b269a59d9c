"""Images and CameraInfo as sensor_msgs, and back."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DepthFrame, Preview, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.distortion_models import DISTORTION_MODELS
from panoptic_ros.io.messages.arrays import byte_array, pixel_rows
from panoptic_ros.io.messages.depths import depth_from_message
from panoptic_ros.io.messages.family import Messages, stamp_of
from panoptic_ros.io.pictures import decode_picture

Array = np.ndarray
_CHANNELS = {"bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4, "mono8": 1, "8UC1": 1,
             "bayer_rggb8": 1, "bayer_bggr8": 1, "bayer_gbrg8": 1, "bayer_grbg8": 1,
             "yuv422_yuy2": 2, "yuv422": 2}  # fmt: skip
_TO_BGR = {"rgb8": "COLOR_RGB2BGR", "bgra8": "COLOR_BGRA2BGR", "rgba8": "COLOR_RGBA2BGR",
           "mono8": "COLOR_GRAY2BGR", "8UC1": "COLOR_GRAY2BGR",
           "bayer_rggb8": "COLOR_BayerRGGB2BGR", "bayer_bggr8": "COLOR_BayerBGGR2BGR",
           "bayer_gbrg8": "COLOR_BayerGBRG2BGR", "bayer_grbg8": "COLOR_BayerGRBG2BGR",
           "yuv422_yuy2": "COLOR_YUV2BGR_YUY2", "yuv422": "COLOR_YUV2BGR_UYVY"}  # fmt: skip
OPTICAL = "_optical_frame"
ENCODINGS = tuple(_CHANNELS)  # of raw images


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


def camera_from_info(message: Any, name: str, cam_from_world: Rigid) -> Camera:
    """The camera of raw images that a sensor_msgs/CameraInfo describes.

    Raises:
        DataError: if it is not calibrated, or has a lens model that is not supported.
    """
    model = str(message.distortion_model)
    lens = next((lens for lens, known in DISTORTION_MODELS.items() if known == model), None)
    coefficients = np.array(message.d, float)
    if lens is None and coefficients.any():
        known = " and ".join(DISTORTION_MODELS.values())
        raise DataError(f"camera_info of {name} has distortion model {model!r}; supported: {known}")
    matrix = np.array(message.k, float).reshape(3, 3)
    if not matrix.any():
        raise DataError(f"camera_info of {name} is all 0: its driver is not calibrated")
    given = np.zeros(0) if lens is None else coefficients
    size = int(message.width), int(message.height)
    return Camera(name, size, Intrinsics(matrix, given, lens or "brown"), cam_from_world)


def rectified(camera: Camera, message: Any) -> Camera:
    """The camera of the rectified images of the same lens: no distortion, K and axes by CameraInfo.

    Raises:
        DataError: if the message has no projection matrix.
    """
    matrix = np.array(message.p, float).reshape(3, 4)[:, :3]
    if not matrix.any():
        raise DataError(f"camera_info of {camera.name} has no projection: its images cannot be rectified")
    rotation = np.array(message.r, float).reshape(3, 3)
    turned = Rigid(rotation if rotation.any() else np.eye(3), np.zeros(3))
    pose = turned.compose(camera.cam_from_world)
    return replace(
        camera, intrinsics=Intrinsics(matrix, np.zeros(0)), cam_from_world=pose, covariance=None
    )


def frame_from_message(message: Any, camera: str, frame_number: int, encoding: str = "") -> ViewFrame:
    """A frame from Image or CompressedImage; the message has no number, so the caller counts.

    Args:
        encoding: of raw images, in place of what the message says.

    Raises:
        DataError: on encodings that are not supported, wrong lengths or broken JPEG.
    """
    image = _decode(message, camera) if hasattr(message, "format") else _unpack(message, camera, encoding)
    return ViewFrame(camera, stamp_of(message.header), frame_number, image)


def depth_frame_from_message(message: Any, camera: str, frame_number: int) -> DepthFrame:
    """A depth map from Image or CompressedImage, as `depth_from_message`; the caller counts.

    Raises:
        DataError: as `depth_from_message`.
    """
    return DepthFrame(camera, stamp_of(message.header), frame_number, depth_from_message(message, camera))


def _decode(message: Any, camera: str) -> Array:
    import cv2  # see above

    image = decode_picture(byte_array(message), cv2.IMREAD_COLOR, f"compressed image of camera {camera}")
    if image is None:
        raise DataError(f"compressed image of camera {camera} ({message.format!r}) cannot be decoded")
    return image


def _unpack(message: Any, camera: str, encoding: str) -> Array:
    width, height = int(message.width), int(message.height)
    encoding = encoding or str(message.encoding)
    if encoding not in _CHANNELS:
        raise DataError(
            f"image of camera {camera} has encoding {encoding!r}; supported: {', '.join(_CHANNELS)}"
        )
    rows = pixel_rows(message, _CHANNELS[encoding], f"image of camera {camera}")
    pixels = rows.reshape(height, width, -1)
    if encoding in _TO_BGR:
        import cv2  # see above

        return cv2.cvtColor(np.ascontiguousarray(pixels), getattr(cv2, _TO_BGR[encoding]))
    return pixels


def camera_info_message(camera: Camera, stamp_ns: int, family: Messages) -> Any:
    """sensor_msgs/CameraInfo of one image; the model is plumb_bob, of a fisheye equidistant."""
    k = np.array(camera.intrinsics.matrix)
    roi = family.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return family.make(
        "sensor_msgs/msg/CameraInfo",
        header=family.header(stamp_ns, optical_frame(camera.name)),
        height=camera.image_size[1],
        width=camera.image_size[0],
        distortion_model=DISTORTION_MODELS[camera.intrinsics.lens],
        d=family.sequence(np.array(camera.intrinsics.distortion)),
        k=k.reshape(9),
        r=np.eye(3).reshape(9),
        p=np.hstack([k, np.zeros((3, 1))]).reshape(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
