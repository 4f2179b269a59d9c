"""The camera model against OpenCV, and against itself."""

import cv2
import numpy as np
import pytest
from derivatives import derivative
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics

LENSES = st.tuples(
    st.floats(-0.3, 0.3),
    st.floats(-0.1, 0.1),
    st.floats(-3e-3, 3e-3),
    st.floats(-3e-3, 3e-3),
    st.floats(-0.05, 0.05),
)
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
    slope = derivative(camera, plane)
    inside &= np.linalg.det(slope) > 0.05  # tangential terms can fold earlier than the radial ones
    back = camera.undistort(camera.pixels_from_plane(camera.distort(plane)))
    assert np.nanmax(np.abs(back - plane)[inside], initial=0.0) < 1e-9


# OpenCV's models with more terms, in its order: rational (Azure Kinect, OAK), thin prism, tilted sensor.
RATIONAL = st.tuples(
    st.floats(-0.3, 0.6),
    st.floats(-0.4, 0.1),
    st.floats(-3e-3, 3e-3),
    st.floats(-3e-3, 3e-3),
    st.floats(-0.05, 0.2),
    st.floats(-0.2, 0.5),
    st.floats(-0.3, 0.1),
    st.floats(0.0, 0.2),
)
PRISM = st.tuples(*(st.floats(-5e-3, 5e-3) for _ in range(4)))
TILT = st.tuples(*(st.floats(-0.05, 0.05) for _ in range(2)))
MANY = st.one_of(
    RATIONAL,
    st.builds(lambda a, b: a + b, RATIONAL, PRISM),
    st.builds(lambda a, b, c: a + b + c, RATIONAL, PRISM, TILT),
)
KINECT = (0.66, -2.7, 6e-4, -2e-4, 1.55, 0.54, -2.5, 1.48)  # as an Azure Kinect's colour camera
OAK = (2.1, -11.5, -1e-3, 4e-4, 33.6, 2.0, -11.3, 33.1, 1e-3, -2e-4, 5e-4, 1e-4, 0.012, -0.02)  # of 14 terms


@settings(max_examples=120, deadline=None)
@given(lens=MANY, seed=st.integers(0, 10**6))
def test_projection_with_more_terms_equals_opencv(lens, seed):
    camera = Intrinsics(MATRIX, lens)
    cloud = points(seed)
    pixels, seen = camera.project(cloud)
    expected = cv2.projectPoints(cloud, np.zeros(3), np.zeros(3), MATRIX, np.array(lens))[0][:, 0]
    assert np.abs(pixels[seen] - expected[seen]).max(initial=0.0) < 1e-9
    assert np.isnan(pixels[~seen]).all()


@settings(max_examples=80, deadline=None)
@given(lens=MANY, seed=st.integers(0, 10**6))
def test_undistort_with_more_terms_inverts_distort_inside_of_the_fold(lens, seed):
    camera = Intrinsics(MATRIX, lens)
    plane = np.random.default_rng(seed).uniform(-0.5, 0.5, (40, 2))
    inside = np.linalg.norm(plane, axis=1) < 0.9 * camera.radius_limit
    assume(inside.any())
    inside &= np.linalg.det(derivative(camera, plane)) > 0.05
    back = camera.undistort(camera.pixels_from_plane(camera.distort(plane)))
    assert np.nanmax(np.abs(back - plane)[inside], initial=0.0) < 1e-9
    assert np.isfinite(back[inside]).all()


@pytest.mark.parametrize("lens", [KINECT, OAK])
def test_lenses_of_real_cameras_are_undone_in_the_whole_image(lens):
    camera = Intrinsics(MATRIX, lens)
    rows, columns = np.mgrid[0:720:40, 0:1280:40]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    plane = camera.undistort(pixels)
    assert np.isfinite(plane).all()
    again, seen = camera.project(np.concatenate([plane, np.ones((len(plane), 1))], axis=1))
    assert seen.all() and np.abs(again - pixels).max() < 1e-5


@settings(max_examples=80, deadline=None)
@given(lens=RATIONAL)
@example(lens=(0.0, -0.25, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0))  # the pole at sqrt(2) cancels
def test_the_radius_increases_up_to_the_fold_and_not_beyond(lens):
    camera = Intrinsics(MATRIX, (*lens[:2], 0.0, 0.0, *lens[4:]))
    limit = min(camera.radius_limit, 3.0)
    radius = np.linspace(0.0, limit, 300)[:-1]
    bent = camera.distort(np.stack([radius, 0.0 * radius], axis=-1))[:, 0]
    assert (np.diff(bent) > -1e-12).all()
    if camera.radius_limit < 3.0:
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = derivative(camera, np.array([[camera.radius_limit, 0.0]]))[0, 0, 0]
        assert abs(slope) < 1e-3 or not np.isfinite(slope) or abs(slope) > 1e3  # a fold, or a pole


def test_zeros_at_the_end_mean_nothing():
    five, eight = Intrinsics(MATRIX, KINECT[:5]), Intrinsics(MATRIX, KINECT)
    for count in (8, 12, 14):
        padded = np.zeros(count)
        padded[:5] = KINECT[:5]
        assert np.array_equal(Intrinsics(MATRIX, padded).distortion, five.distortion)
    assert np.array_equal(Intrinsics(MATRIX, (*KINECT, 0, 0, 0, 0)).distortion, eight.distortion)
    assert Intrinsics(MATRIX, np.zeros(14)).distortion.shape == (5,)
    fisheye = Intrinsics(MATRIX, (0.1, 0.2, 0.0, 0.0, 0.0, 0.0), "fisheye")
    assert fisheye.distortion.tolist() == [0.1, 0.2, 0.0, 0.0]


@pytest.mark.parametrize("count", [3, 6, 7, 9, 13])
def test_counts_that_no_model_has_are_refused(count):
    with pytest.raises(CalibrationError, match=f"{count} distortion coefficients; a brown lens has 4, 5, 8"):
        Intrinsics(MATRIX, np.full(count, 0.01))


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
        (MATRIX, np.ones(15), "k1 k2 p1 p2 k3 k4 k5 k6"),
        (MATRIX * np.nan, np.zeros(5), "finite"),
        (-MATRIX, np.zeros(5), "positive"),
    ],
)
def test_impossible_intrinsics_are_refused(matrix, lens, told):
    with pytest.raises(CalibrationError, match=told):
        Intrinsics(matrix, lens)


FISHEYES = st.tuples(*(st.floats(-s, s) for s in (0.08, 0.02, 0.01, 0.004)))


def rays(seed, count=40, widest=1.3):
    rng = np.random.default_rng(seed)
    theta, turn = rng.uniform(0.0, widest, count), rng.uniform(0.0, 2.0 * np.pi, count)
    direction = np.stack([np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)], -1)
    return direction * rng.uniform(0.5, 6.0, (count, 1))


@settings(max_examples=80, deadline=None)
@given(lens=FISHEYES, seed=st.integers(0, 10**6))
def test_fisheye_projection_equals_opencv(lens, seed):
    camera = Intrinsics(MATRIX, lens, "fisheye")
    cloud = rays(seed)
    pixels, seen = camera.project(cloud)
    expected = cv2.fisheye.projectPoints(cloud[:, None], np.zeros(3), np.zeros(3), MATRIX, np.array(lens))[0]
    assert np.abs(pixels[seen] - expected[:, 0][seen]).max(initial=0.0) < 1e-9
    assert np.isnan(pixels[~seen]).all()
    angle = np.arctan(np.linalg.norm(cloud[:, :2], axis=1) / cloud[:, 2])
    assert (seen == (angle < np.arctan(camera.radius_limit))).all()


@settings(max_examples=80, deadline=None)
@given(lens=FISHEYES, seed=st.integers(0, 10**6))
def test_fisheye_undistort_inverts_distort_inside_of_the_fold(lens, seed):
    camera = Intrinsics(MATRIX, lens, "fisheye")
    cloud = rays(seed)
    plane = cloud[:, :2] / cloud[:, 2:]
    inside = np.arctan(np.linalg.norm(plane, axis=1)) < 0.95 * np.arctan(camera.radius_limit)
    back = camera.undistort(camera.pixels_from_plane(camera.distort(plane)))
    assert np.abs(back - plane)[inside].max(initial=0.0) < 1e-7


def test_a_fisheye_is_straight_on_its_axis():
    camera = Intrinsics(MATRIX, [0.1, 0.0, 0.0, 0.0], "fisheye")
    origin = np.zeros((1, 2))
    assert np.array_equal(camera.distort(origin), origin)
    assert np.allclose(derivative(camera, origin), np.eye(2))
    assert np.allclose(camera.undistort(MATRIX[None, :2, 2]), origin)


def test_a_fisheye_sees_nothing_beyond_ninety_degrees_and_beyond_its_fold():
    wide = Intrinsics(MATRIX, np.zeros(4), "fisheye")
    assert wide.project(np.array([[1.0, 0, 0.01], [1.0, 0, 0.0], [1.0, 0, -0.1]]))[1].tolist() == [
        True,
        False,
        False,
    ]
    beyond = MATRIX[:2, 2] + [812.5 * 1.6, 0.0]  # 1.6 rad off the axis
    assert np.isnan(wide.undistort(beyond)).all()
    folded = Intrinsics(MATRIX, [-0.5, 0, 0, 0], "fisheye")  # t (1 - 0.5 t^2) turns at sqrt(2/3) rad
    assert folded.radius_limit == pytest.approx(np.tan(np.sqrt(2 / 3)))


def test_the_lens_is_named_and_its_terms_counted():
    with pytest.raises(CalibrationError, match="unknown lens 'omni'; lenses are brown, fisheye"):
        Intrinsics(MATRIX, np.zeros(4), "omni")
    with pytest.raises(CalibrationError, match="5 distortion .* a fisheye lens has only k1 k2 k3 k4"):
        Intrinsics(MATRIX, np.ones(5), "fisheye")
    assert Intrinsics(MATRIX, [0.1], "fisheye").distortion.tolist() == [0.1, 0.0, 0.0, 0.0]
