"""The camera model against OpenCV, and against itself."""
import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics

LENSES = st.tuples(
    st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3),
    st.floats(-0.05, 0.05),
)  # fmt: skip
MATRIX = np.array([[812.5, 0, 640.25], [0, 805.0, 355.5], [0, 0, 1]])


def points(seed, count=40):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.6, 0.6, (count, 2))
    z = rng.uniform(0.5, 6.0, (count, 1))
    return np.hstack([xy * z, z])


@settings(max_examples=80, deadline=None)
@given(lens=LENSES, seed=st.integers(0, 10**6))
def test_projection_equals_opencv(lens, seed):
    camera = Intrinsics(MATRIX, lens)
    cloud = points(seed)
    pixels, seen = camera.project(cloud)
    expected = cv2.projectPoints(cloud, np.zeros(3), np.zeros(3), MATRIX, np.array(lens))[0][:, 0]
    assert np.abs(pixels[seen] - expected[seen]).max(initial=0.0) < 1e-9
    assert np.isnan(pixels[~seen]).all()


@settings(max_examples=80, deadline=None)
@given(lens=LENSES, seed=st.integers(0, 10**6))
def test_undistort_inverts_distort_inside_of_the_fold(lens, seed):
    camera = Intrinsics(MATRIX, lens)
    plane = np.random.default_rng(seed).uniform(-0.5, 0.5, (40, 2))
    inside = np.linalg.norm(plane, axis=1) < 0.9 * camera.radius_limit
    assume(inside.any())
    slope = camera.distort_jacobian(plane)
    inside &= np.linalg.det(slope) > 0.05  # tangential terms can fold earlier than the radial ones
    back = camera.undistort(camera.pixels_from_plane(camera.distort(plane)))
    assert np.nanmax(np.abs(back - plane)[inside], initial=0.0) < 1e-9


@settings(max_examples=40, deadline=None)
@given(lens=LENSES, seed=st.integers(0, 10**6))
def test_jacobian_is_the_derivative(lens, seed):
    camera = Intrinsics(MATRIX, lens)
    cloud = points(seed, 10)
    assume(camera.project(cloud)[1].all())
    step = 1e-6
    columns = [
        (camera.project(cloud + step * e)[0] - camera.project(cloud - step * e)[0]) / (2 * step)
        for e in np.eye(3)
    ]
    assert np.allclose(camera.project_jacobian(cloud), np.stack(columns, -1), rtol=1e-5, atol=1e-3)


def test_points_behind_the_camera_have_no_pixel():
    pixels, seen = Intrinsics(MATRIX, np.zeros(5)).project(np.array([[0, 0, -1.0], [0, 0, 0.0], [0, 0, 1.0]]))
    assert seen.tolist() == [False, False, True]
    assert np.isnan(pixels[:2]).all() and np.allclose(pixels[2], MATRIX[:2, 2])


def test_points_beyond_the_fold_have_no_pixel():
    camera = Intrinsics(MATRIX, [-0.5, 0, 0, 0, 0])  # r (1 - 0.5 r^2) turns at r = sqrt(2/3)
    assert camera.radius_limit == pytest.approx(np.sqrt(2 / 3))
    assert camera.project(np.array([[0.7, 0, 1.0], [0.9, 0, 1.0]]))[1].tolist() == [True, False]


def test_skew_is_used_both_ways():
    matrix = MATRIX.copy()
    matrix[0, 1] = 12.0
    camera = Intrinsics(matrix, np.zeros(5))
    plane = np.array([[0.1, 0.3]])
    assert np.allclose(camera.plane_from_pixels(camera.pixels_from_plane(plane)), plane)


@pytest.mark.parametrize(
    ("matrix", "lens", "told"),
    [
        (np.eye(2), np.zeros(5), "3x3"),
        (MATRIX, np.zeros(8), "k1 k2 p1 p2 k3"),
        (MATRIX * np.nan, np.zeros(5), "finite"),
        (-MATRIX, np.zeros(5), "positive"),
    ],
)
def test_impossible_intrinsics_are_refused(matrix, lens, told):
    with pytest.raises(CalibrationError, match=told):
        Intrinsics(matrix, lens)
