"""Depth maps as ROS cameras send them: images, and compressedDepth."""

import struct
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from panoptic_ros.domain import DepthFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import bag_messages, depth_frame_from_message, depth_from_message, depth_message


def compressed(levels, how, scale=0.0, shift=0.0):
    """As compressed_depth_image_transport packs it: how, the numbers of inverse depths, a PNG."""
    _, data = cv2.imencode(".png", levels)
    header = np.frombuffer(struct.pack("<iff", 0, scale, shift), np.uint8)
    return SimpleNamespace(format=how, data=np.concatenate([header, data.reshape(-1)]))


def test_depth_maps_of_both_encodings_of_rep_118():
    metres = np.array([[1.5, 0.0, np.nan], [2.25, np.inf, 0.001]], np.float32)
    message = depth_message(DepthFrame("cam0", 5, 0, metres), bag_messages())
    assert message.encoding == "32FC1"
    assert np.array_equal(depth_from_message(message, "cam0"), metres, equal_nan=True)
    back = depth_frame_from_message(message, "cam0", 7)
    assert np.array_equal(back.depth, metres, equal_nan=True)
    assert (back.camera, back.stamp_ns, back.frame_number) == ("cam0", 5, 7)
    for order, bigendian in (("<", 0), (">", 1)):
        padded = np.full((2, 5), 7777, f"{order}u2")
        padded[:, :3] = [[1500, 0, 65535], [2250, 1, 2]]
        message.encoding, message.step, message.is_bigendian = "16UC1", 10, bigendian
        message.data = padded.view(np.uint8).reshape(-1)
        expected = [[1.5, 0.0, 65.535], [2.25, 0.001, 0.002]]
        assert depth_from_message(message, "cam0") == pytest.approx(np.array(expected))
    message.encoding = "mono8"
    with pytest.raises(DataError, match=r"encoding 'mono8'; supported: 16UC1 \(mm\), 32FC1 \(m\)"):
        depth_from_message(message, "cam0")
    message.encoding, message.step = "32FC1", 10
    with pytest.raises(DataError, match="depth map of camera cam0: 3 x 2 32FC1 with step 10"):
        depth_from_message(message, "cam0")


@pytest.mark.parametrize("how", ["16UC1; compressedDepth", "16UC1; compressedDepth png"])
def test_compressed_millimetres(how):
    levels = np.array([[1500, 0, 65535], [2250, 1, 2]], np.uint16)
    expected = [[1.5, 0.0, 65.535], [2.25, 0.001, 0.002]]
    assert depth_from_message(compressed(levels, how), "cam0") == pytest.approx(np.array(expected))


def test_compressed_metres_are_right_within_the_steps_of_inverse_depth():
    metres = np.linspace(0.3, 10.0, 4000, dtype=np.float32).reshape(40, 100)
    precision, farthest = 100.0, 10.0  # the transport's defaults
    scale = precision * (precision + 1.0)
    shift = 1.0 - scale / farthest
    levels = (scale / metres + shift).astype(np.uint16)
    levels[3, 5] = 0
    message = compressed(levels, "32FC1; compressedDepth png", scale, shift)
    read = depth_from_message(message, "cam0")
    known = levels > 0
    assert np.isnan(read[3, 5]) and np.isfinite(read[known]).all()
    step = metres**2 / scale
    assert (abs(read - metres)[known] <= 1.01 * step[known] + 1e-5).all()


@pytest.mark.parametrize(
    ("message", "told"),
    [
        (compressed(np.zeros((2, 3), np.uint16), "16UC1; compressedDepth rvl"), "its RVL header states"),
        (compressed(np.zeros((2, 3), np.uint16), "8UC1; compressedDepth png"), "8UC1"),
        (compressed(np.zeros((2, 3), np.uint16), "rgb8; jpeg compressed bgr8"), "jpeg"),
        (compressed(np.zeros((2, 3), np.uint8), "16UC1; compressedDepth png"), "no PNG of 16 bits"),
        (compressed(np.zeros((2, 3, 3), np.uint16), "16UC1; compressedDepth png"), "no PNG of 16 bits"),
        (SimpleNamespace(format="16UC1; compressedDepth png", data=b""), "in its 0 bytes"),
        (SimpleNamespace(format="32FC1; compressedDepth png", data=bytes(range(40))), "in its 28 bytes"),
    ],
)
def test_compressed_depth_that_cannot_be_read(message, told):
    with pytest.raises(DataError, match=f"depth map of camera cam0.*{told}"):
        depth_from_message(message, "cam0")
