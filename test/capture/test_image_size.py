"""What the calibration of a camera becomes for images of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.capture.image_size import fit_camera, size_change
from panoptic_ros.domain import Camera
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid


def fisheye() -> Camera:
    lens = Intrinsics([[400.0, 0, 320], [0, 410.0, 240], [0, 0, 1]], [0.01, -0.02, 0, 0], "fisheye")
    covariance = np.diag(np.arange(1.0, 15.0)) + 0.1
    return Camera(
        "a", (640, 480), lens, Rigid.identity(), "hd", "3", "ltc", line_delay_us=20.0, covariance=covariance
    )


def test_smaller_images_of_a_fisheye_show_the_same_at_half_the_place() -> None:
    camera = fisheye()
    small = fit_camera(camera, (320, 240), "scale")
    points = np.array([[0.3, -0.2, 1.0], [-2.0, 1.0, 0.8]])
    at, seen = camera.project(points)
    assert seen.all() and np.allclose(small.project(points)[0], 0.5 * (at + 0.5) - 0.5, atol=1e-9)
    assert (small.type, small.panel, small.clock) == ("hd", "3", "ltc")


def test_smaller_images_have_slower_rows_and_smaller_errors_in_pixels() -> None:
    camera, factor = fisheye(), np.where((np.arange(14) >= 6) & (np.arange(14) < 10), 0.5, 1.0)
    small = fit_camera(camera, (320, 240), "scale")
    assert small.line_delay_us == 40.0  # half as many rows in the same time
    assert np.allclose(small.covariance, factor[:, None] * camera.covariance * factor)


def test_cut_images_keep_rows_and_errors() -> None:
    cut = fit_camera(fisheye(), (640, 470), "crop")
    assert cut.line_delay_us == 20.0 and np.array_equal(cut.covariance, fisheye().covariance)


def test_a_rig_whose_width_and_height_are_exchanged_is_taken_as_its_principal_point_says() -> None:
    lens = Intrinsics([[430.0, 0, 239.4], [0, 431.0, 309.8], [0, 0, 1]], np.zeros(5))
    camera = Camera("a", (640, 480), lens, Rigid.identity())
    taken = fit_camera(camera, (480, 640))
    assert taken.image_size == (480, 640) and taken.intrinsics is lens
    assert "the rig states 640x480, but its principal point is in the middle of 480x640" in size_change(
        camera, (480, 640), "strict"
    )
    landscape = replace(camera, intrinsics=Intrinsics([[430.0, 0, 322], [0, 431, 236], [0, 0, 1]], []))
    with pytest.raises(CalibrationError, match="width and height are exchanged: turn the video"):
        fit_camera(landscape, (480, 640))
