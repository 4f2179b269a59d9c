"""Damaged images and depth maps: refused in one line, or taken as frames that fit the rig; never a crash."""

import copy

import captures
import numpy as np
import pytest
from damage import COUNTS, damage

from panoptic_ros.domain import DepthFrame, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.entrance import check_record
from panoptic_ros.io.messages import (
    bag_messages,
    compressed_image_message,
    depth_frame_from_message,
    depth_message,
    frame_from_message,
    image_message,
)
from panoptic_ros.io.messages.encodings import ENCODINGS

EACH = 400  # messages
CAMERA = captures.RIG.cameras[0]
WIDTH, HEIGHT = CAMERA.image_size


def picture():
    image = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    return ViewFrame(CAMERA.name, 5_000_000_000, 0, image)


def depth():
    return DepthFrame(CAMERA.name, 5_000_000_000, 0, np.full((HEIGHT, WIDTH), 2.0, np.float32))


KINDS = {
    "raw": (lambda: image_message(picture(), bag_messages()), frame_from_message),
    "jpeg": (lambda: compressed_image_message(picture(), bag_messages(), 80), frame_from_message),
    "depth": (lambda: depth_message(depth(), bag_messages()), depth_frame_from_message),
}


def damaged_more(message, rng):
    """Also what a driver could say wrongly: another encoding, cut data, bytes of a picture."""
    damage(message, rng)
    if hasattr(message, "encoding") and rng.random() < 0.3:
        object.__setattr__(message, "encoding", str(rng.choice([*ENCODINGS, "16UC1", "32FC1", "", "rgb9"])))
    if hasattr(message, "step") and rng.random() < 0.2:
        object.__setattr__(message, "step", int(rng.choice(COUNTS)))
    if rng.random() < 0.3:
        data = np.array(message.data, np.uint8)
        data[rng.integers(data.size, size=20)] = rng.integers(0, 255, 20)
        object.__setattr__(message, "data", data[: rng.integers(data.size)] if rng.random() < 0.5 else data)


@pytest.mark.parametrize("kind", KINDS)
def test_no_image_breaks_what_takes_it(kind):
    make, decode = KINDS[kind]
    rng, whole, refused = np.random.default_rng(3), make(), 0
    for number in range(EACH):
        message = copy.deepcopy(whole)
        for _ in range(rng.integers(1, 3)):
            damaged_more(message, rng)
        try:
            frame = decode(message, CAMERA.name, number)
            check_record(frame, CAMERA.name, captures.RIG, captures.SKELETON)
        except DataError as error:
            assert "\n" not in str(error)
            refused += 1
            continue
        assert frame.camera == CAMERA.name and frame.frame_number == number
        if isinstance(frame, ViewFrame):
            assert frame.image.shape == (HEIGHT, WIDTH, 3) and frame.image.dtype == np.uint8
        else:
            assert frame.depth.ndim == 2
    assert 0 < refused
