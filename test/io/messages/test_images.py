"""Images of every encoding that drivers publish, and the cameras that their CameraInfo describes."""
from types import SimpleNamespace

import captures
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import bag_messages, camera_info_message, frame_from_message
from panoptic_ros.io.messages.images import camera_from_info, rectified

CAMERA = captures.RIG.cameras[0]


def smooth_picture():
    """Colours that change slowly, so that mosaics and half the chroma lose little."""
    y, x = np.mgrid[:48, :64] / 64.0
    return np.stack([80 + 90 * x, 60 + 100 * y, 200 - 80 * x * y], axis=-1).astype(np.uint8)


def mosaic(picture, pattern):
    grey = np.zeros(picture.shape[:2], np.uint8)
    for k, colour in enumerate(pattern):
        row, column = divmod(k, 2)
        grey[row::2, column::2] = picture[row::2, column::2, "bgr".index(colour)]
    return grey


def packed_yuv(picture, luma):
    """4:2:2 of BT.601, studio range, with the luma in the first or second byte of each pixel."""
    by_bgr = np.array([[0.098, 0.504, 0.257], [0.439, -0.291, -0.148], [-0.071, -0.368, 0.439]])
    yuv = np.rint(picture @ by_bgr.T + [16, 128, 128]).astype(np.uint8)
    data = np.zeros((*picture.shape[:2], 2), np.uint8)
    data[..., luma] = yuv[..., 0]
    data[:, 0::2, 1 - luma], data[:, 1::2, 1 - luma] = yuv[:, 0::2, 1], yuv[:, 0::2, 2]
    return data


ENCODED = {
    "bgr8": lambda p: p,
    "rgb8": lambda p: p[..., ::-1],
    "bgra8": lambda p: cv2.cvtColor(p, cv2.COLOR_BGR2BGRA),
    "rgba8": lambda p: cv2.cvtColor(p, cv2.COLOR_BGR2RGBA),
    "bayer_rggb8": lambda p: mosaic(p, "rggb"),
    "bayer_bggr8": lambda p: mosaic(p, "bggr"),
    "bayer_gbrg8": lambda p: mosaic(p, "gbrg"),
    "bayer_grbg8": lambda p: mosaic(p, "grbg"),
    "yuv422": lambda p: packed_yuv(p, 1),
    "yuv422_yuy2": lambda p: packed_yuv(p, 0),
}


def image(data, encoding, padding=0):
    rows = np.ascontiguousarray(data).reshape(len(data), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    header = bag_messages().header(5, "left")
    return SimpleNamespace(
        header=header, width=data.shape[1], height=len(data), step=rows.shape[1], encoding=encoding,
        is_bigendian=0, data=rows.tobytes(),
    )  # fmt: skip


@pytest.mark.parametrize("padding", [0, 7])
@pytest.mark.parametrize("encoding", ENCODED)
def test_every_encoding_gives_the_picture(encoding, padding):
    picture = smooth_picture()
    frame = frame_from_message(image(ENCODED[encoding](picture), encoding, padding), "left", 3)
    assert (frame.camera, frame.stamp_ns, frame.frame_number) == ("left", 5, 3)
    off = np.abs(frame.image.astype(int) - picture)[2:-2, 2:-2]
    assert off.max() <= (0 if encoding in ("bgr8", "rgb8", "bgra8", "rgba8") else 6)


def test_an_encoding_that_the_driver_states_wrongly():
    picture = smooth_picture()
    message = image(mosaic(picture, "rggb"), "mono8")
    off = np.abs(frame_from_message(message, "left", 0, "bayer_rggb8").image.astype(int) - picture)
    assert off[2:-2, 2:-2].max() <= 6
    with pytest.raises(DataError, match="encoding 'nv21'; supported: bgr8"):
        frame_from_message(image(picture, "nv21"), "left", 0)


def test_camera_info_and_back():
    info = camera_info_message(CAMERA, 7, bag_messages())
    back = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    assert np.array_equal(back.intrinsics.matrix, CAMERA.intrinsics.matrix)
    assert np.array_equal(back.intrinsics.distortion, CAMERA.intrinsics.distortion)
    info.k = np.zeros(9)
    with pytest.raises(DataError, match="its driver is not calibrated"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    info.distortion_model, info.d = "rational_polynomial", np.ones(8)
    with pytest.raises(DataError, match="'rational_polynomial'; supported: plumb_bob and equidistant"):
        camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)


def test_rectified_images_show_the_world_where_opencv_puts_it():
    info = camera_info_message(CAMERA, 7, bag_messages())
    turn = Rotation.from_rotvec([0.02, -0.05, 0.01]).as_matrix()
    projection = np.array([[900.0, 0, 650, -120], [0, 900, 350, 0], [0, 0, 1, 0]])
    info.d, info.r, info.p = np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]), turn.reshape(9), projection.reshape(12)
    raw = camera_from_info(info, CAMERA.name, CAMERA.cam_from_world)
    before_it = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + [0, 0, 4]
    world = CAMERA.cam_from_world.inverse().apply(before_it)
    pixels, _ = raw.project(world)
    expected = cv2.undistortPoints(
        pixels[:, None], raw.intrinsics.matrix, info.d, R=turn, P=projection[:, :3]
    )[:, 0]
    found, seen = rectified(raw, info).project(world)
    assert seen.all() and np.abs(found - expected).max() < 1e-3


def test_what_cannot_be_rectified():
    info = camera_info_message(CAMERA, 7, bag_messages())
    info.p = np.zeros(12)
    with pytest.raises(DataError, match="cannot be rectified"):
        rectified(CAMERA, info)
