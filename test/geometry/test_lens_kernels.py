"""Undistortion of many points equals that of the camera model."""

import numpy as np
import pytest
from derivatives import derivative

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.rig_arrays import camera_records
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.lens_kernels import bent_by_many, undistort_points


def test_undistortion_equals_the_camera_model():
    matrix = [[1000.0, 0.0, 639.5], [0, 1000.0, 479.5], [0, 0, 1]]
    lens = Intrinsics(matrix, (-0.25, 0.08, 0.001, -0.002, 0.01))
    rig = Rig(tuple(Camera(name, (1280, 960), lens, Rigid.identity()) for name in "abc"))
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [1280, 960], (3, 50, 2))
    usable = np.ones((3, 50), bool)
    plane, magnification, good = undistort_points(pixels, usable, np.arange(3), camera_records(rig.cameras))
    expected = np.stack([c.intrinsics.undistort(p) for c, p in zip(rig.cameras, pixels)])
    assert (good == np.isfinite(expected[..., 0])).all()
    assert np.abs(plane - expected)[good].max() < 1e-9
    assert (magnification == 1.0).all()


def test_undistortion_of_a_fisheye_equals_the_camera_model():
    lens = Intrinsics([[300.0, 0.5, 639.5], [0, 310.0, 479.5], [0, 0, 1]], [0.03, -0.02, 0.005, 0], "fisheye")
    rig = Rig((Camera("a", (1280, 960), lens, Rigid.identity()),))
    pixels = np.random.default_rng(0).uniform([0, 0], [1280, 960], (1, 400, 2))
    plane, magnification, good = undistort_points(
        pixels, np.ones((1, 400), bool), np.zeros(1, int), camera_records(rig.cameras)
    )
    expected = lens.undistort(pixels)
    assert (good == np.isfinite(expected[..., 0])).all()
    assert 100 < good.sum() < 400  # some are beyond 90 degrees
    assert (np.abs(plane - expected) / np.hypot(*plane.T).T[..., None].clip(1.0))[good].max() < 1e-9
    growth = np.sqrt(np.linalg.det(derivative(lens, plane[good])))
    assert np.allclose(magnification[good], growth, rtol=1e-6)


LENSES = [
    (0.66, -2.7, 6e-4, -2e-4, 1.55, 0.54, -2.5, 1.48),
    (-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, -0.05, 0.02, 1e-3, -2e-3, 5e-4, 1e-3),
    (-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, -0.05, 0.02, 1e-3, -2e-3, 5e-4, 1e-3, 0.03, -0.05),
    (-0.2, 0.05, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.04, 0.02),
]


@pytest.mark.parametrize("terms", LENSES)
def test_undistortion_of_more_terms_equals_the_camera_model(terms):
    matrix = [[900.0, 0.5, 639.5], [0, 910.0, 479.5], [0, 0, 1]]
    lens, straight = Intrinsics(matrix, terms), Intrinsics(matrix, (-0.1,))
    rig = Rig(tuple(Camera(n, (1280, 960), i, Rigid.identity()) for n, i in zip("ab", (straight, lens))))
    records = camera_records(rig.cameras)
    assert records["many"].tolist() == [0.0, 1.0]
    pixels = np.random.default_rng(0).uniform([0, 0], [1280, 960], (2, 200, 2))
    plane, magnification, good = undistort_points(pixels, np.ones((2, 200), bool), np.arange(2), records)
    expected = lens.undistort(pixels[1])
    assert good[1].all() and np.isfinite(expected).all()
    assert np.abs(plane[1] - expected).max() < 1e-9
    assert np.abs(plane[0] - straight.undistort(pixels[0])).max() < 1e-9
    growth = np.sqrt(np.linalg.det(derivative(Intrinsics(matrix, terms[:12]), plane[1])))
    assert np.allclose(magnification[1], growth, rtol=1e-6) and (magnification[0] == 1.0).all()
    for k in range(0, 200, 20):
        x, y, r2 = bent_by_many(records[1], *plane[1, k])
        assert np.allclose((x, y), lens.distort(plane[1, k]), atol=1e-12)
        assert np.isclose(r2, (plane[1, k] ** 2).sum())
