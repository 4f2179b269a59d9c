"""Sizes of pictures from their headers are those that they are decoded to."""

import cv2
import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.pictures import decode_picture, picture_size

IMAGE = np.arange(30 * 44 * 3, dtype=np.uint32).reshape(30, 44, 3).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".webp"])
def test_headers_tell_the_size(suffix):
    data = cv2.imencode(suffix, IMAGE)[1]
    assert picture_size(data.tobytes()) == (44, 30)
    assert decode_picture(data, cv2.IMREAD_COLOR, "a").shape == (30, 44, 3)
    for end in range(0, len(data), 7):
        decode_picture(data[:end], cv2.IMREAD_COLOR, "a")  # refused, or as far as it goes


@pytest.mark.parametrize("turn", [1, 3, 6, 8])
def test_a_turn_of_exif_counts(turn):
    data = cv2.imencode(".jpg", IMAGE)[1].tobytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0" + bytes([turn, 0, 0, 0]) + bytes(4)
    turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
    image = decode_picture(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR, "a")
    assert picture_size(turned) == image.shape[1::-1]


def test_another_size_and_too_many_pixels_are_refused():
    data = cv2.imencode(".png", IMAGE)[1]
    assert decode_picture(data, cv2.IMREAD_COLOR, "a", (30, 44)) is not None  # the decoder may turn it
    with pytest.raises(DataError, match="image a is 44x30, expected 40x30"):
        decode_picture(data, cv2.IMREAD_COLOR, "image a", (40, 30))
    with pytest.raises(DataError, match="more than 0 Mpx"):
        decode_picture(data, cv2.IMREAD_COLOR, "image a", most=1000)
    damaged = data.copy()
    damaged[-20] ^= 1
    assert decode_picture(damaged, cv2.IMREAD_COLOR, "image a") is None
    assert decode_picture(np.zeros(0, np.uint8), cv2.IMREAD_COLOR, "image a") is None
