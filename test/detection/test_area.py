"""Means over areas: OpenCV's, to the byte."""

import cv2
import numpy as np
import pytest

from panoptic_ros.detection.area import shares, shrunk


@pytest.mark.parametrize(
    ("size", "smaller"),
    [
        ((480, 640), (336, 448)),
        ((97, 133), (50, 70)),
        ((97, 133), (96, 17)),
        ((60, 90), (1, 1)),
        ((60, 90), (30, 45)),
        ((60, 90), (30, 44)),
        ((60, 90), (60, 77)),
        ((7, 11), (7, 11)),
    ],
)
def test_the_bytes_are_those_of_opencv(size, smaller):
    image = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    expected = cv2.resize(image, smaller[::-1], interpolation=cv2.INTER_AREA)
    assert np.array_equal(shrunk(image, smaller), expected)


def test_a_part_of_an_image():
    image = np.random.default_rng(2).integers(0, 256, (50, 80, 3), np.uint8)[3:40, 5:70]
    expected = cv2.resize(image, (31, 20), interpolation=cv2.INTER_AREA)
    assert np.array_equal(shrunk(image, (20, 31)), expected)


@pytest.mark.parametrize(("count", "fewer"), [(640, 448), (1920, 672), (31, 30), (100, 7), (5, 5)])
def test_shares_cover_every_pixel_once(count, fewer):
    first, table = shares(count, fewer)
    assert table.sum(axis=0) == pytest.approx(np.ones(fewer), abs=1e-5)
    covered = np.zeros(count + len(table))
    for k, row in enumerate(table):
        np.add.at(covered, first + k, row)
    assert covered[:count] == pytest.approx(np.full(count, fewer / count), abs=1e-3)
