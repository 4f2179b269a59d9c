"""Previews are small, true to their images, and ten a second."""

import cv2
import numpy as np
import pytest

from panoptic_ros.domain import Preview, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.previews import Previews, make_preview


def decoded(preview):
    return cv2.imdecode(np.frombuffer(preview.jpeg, np.uint8), cv2.IMREAD_COLOR)


@pytest.mark.parametrize(
    ("size", "small"),
    [
        ((1920, 1080), (320, 180)),
        ((1080, 1920), (180, 320)),
        ((640, 480), (320, 240)),
        ((200, 100), (200, 100)),
        ((4096, 3000), (320, 234)),
        ((3, 1), (3, 1)),
    ],
)
def test_sizes(size, small):
    image = np.zeros((size[1], size[0], 3), np.uint8)
    assert decoded(make_preview(ViewFrame("a", 1, 0, image))).shape[1::-1] == small


def test_what_is_in_the_image_stays_at_its_place():
    image = np.zeros((1080, 1920, 3), np.uint8)
    cv2.circle(image, (1200, 444), 40, (255, 255, 255), -1)
    small = decoded(make_preview(ViewFrame("a", 1, 0, image)))[..., 0].astype(float)
    v, u = np.indices(small.shape)
    centre = np.array([(u * small).sum(), (v * small).sum()]) / small.sum()
    assert np.allclose(centre, (np.array([1200, 444]) + 0.5) / 6 - 0.5, atol=0.25)


def test_ten_a_second_of_every_camera_at_the_same_instants():
    previews, shown = Previews(), {"a": [], "b": []}
    image = np.zeros((4, 4, 3), np.uint8)
    for index in range(120):
        for camera in shown:
            frame = ViewFrame(camera, 10**18 + round(index * 1e9 / 60), index, image)
            if previews.take(frame) is not None:
                shown[camera].append(index)
    assert shown["a"] == shown["b"] == list(range(0, 120, 6))


def test_slow_cameras_show_every_image():
    previews = Previews()
    assert all(previews.is_due("a", index * 10**9 // 7) for index in range(50))


def test_a_message_holds_camera_stamp_and_picture():
    preview = make_preview(ViewFrame("left cam", 123_456_789_012, 3, np.full((9, 9, 3), 7, np.uint8)))
    again = from_message(to_message(preview, bag_messages()), "Preview")
    assert (again.camera, again.stamp_ns, again.jpeg) == ("left cam", 123_456_789_012, preview.jpeg)


def test_what_is_no_picture_is_refused():
    with pytest.raises(DataError, match="not a JPEG"):
        Preview("a", 1, b"\x89PNG")
