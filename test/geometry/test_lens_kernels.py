"""Undistortion of many points equals that of the camera model."""
import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.rig_arrays import camera_records
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.lens_kernels import undistort_points


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
    growth = np.sqrt(np.linalg.det(lens.distort_jacobian(plane[good])))
    assert np.allclose(magnification[good], growth, rtol=1e-6)
