"""Lens models by all names and with all counts of numbers that drivers and calibrators use."""

import numpy as np
import pytest

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.distortion_models import read_lens, ros_name

MATRIX = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
TERMS = np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, -0.05, 0.02, 1e-3, -2e-3, 5e-4, 1e-3, 0.03, -0.05])


def lens_of(model, numbers):
    lens, terms, told = read_lens(model, np.array(numbers, float))
    return Intrinsics(MATRIX, terms, lens), told


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
@pytest.mark.parametrize(
    "model",
    [
        "rational_polynomial",
        "Rational Polynomial",
        "brown",
        "Brown-Conrady",
        "opencv",
        "FULL_OPENCV",
        "thin_prism",
        "Thin Prism Model",
        "tilted",
        "pinhole-radtan",
        "rational",
    ],
)
def test_all_models_of_opencv_are_one(model, count):
    intrinsics, told = lens_of(model, TERMS[:count])
    assert intrinsics.lens == "brown" and told == ""
    assert np.array_equal(intrinsics.distortion[:count], TERMS[:count])


@pytest.mark.parametrize(
    "model", ["equidistant", "fisheye", "Kannala-Brandt", "KannalaBrandt8", "equi", "kb4", "OPENCV_FISHEYE"]
)
@pytest.mark.parametrize("count", [4, 5, 8])
def test_fisheyes_have_four_terms_and_perhaps_zeros(model, count):
    numbers = np.zeros(count)
    numbers[:4] = [0.02, -0.01, 3e-3, -1e-3]
    intrinsics, _ = lens_of(model, numbers)
    assert intrinsics.lens == "fisheye" and intrinsics.distortion.tolist() == numbers[:4].tolist()
    with pytest.raises(CalibrationError, match="a fisheye lens has only k1 k2 k3 k4"):
        lens_of(model, np.full(5, 0.01))


def test_the_numbers_of_a_plumb_bob_are_five_or_it_is_told():
    assert lens_of("plumb_bob", TERMS[:5])[1] == lens_of("plumb_bob", TERMS[:4])[1] == ""
    five, told = lens_of("plumb_bob", [*TERMS[:5], 0, 0, 0])
    assert np.array_equal(five.distortion, TERMS[:5])
    assert "has 5 coefficients, not 8; the others are 0" in told
    eight, told = lens_of("plumb_bob", TERMS[:8])
    assert np.array_equal(eight.distortion, TERMS[:8]) and "are taken as those of OpenCV's model" in told
    assert "radtan has 4 coefficients, not 5" in lens_of("radtan", TERMS[:5])[1]


def test_three_numbers_are_radial():
    intrinsics, told = lens_of("plumb_bob", [0.1, -0.2, 0.3])
    assert intrinsics.distortion.tolist() == [0.1, -0.2, 0.0, 0.0, 0.3]
    assert told == "the 3 distortion coefficients are taken as k1 k2 k3"
    assert lens_of("opencv", [0.1, -0.2, 0.0])[0].distortion.tolist() == [0.1, -0.2, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("model", ["", "none", "None", "undistorted"])
def test_a_lens_without_a_model_and_without_numbers_is_straight(model):
    for numbers in ([], np.zeros(5)):
        intrinsics, told = lens_of(model, numbers)
        assert intrinsics.lens == "brown" and not intrinsics.distortion.any() and told == ""


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ("", "is not named, but has coefficients"),
        ("fov", "is 'fov'; models that are read: plumb_bob"),
        ("omni", "is 'omni'"),
        ("inverse_brown_conrady", "is 'inverse_brown"),
        (3, "is 3, expected its"),
    ],
)
def test_other_models_are_named(model, says):
    with pytest.raises(CalibrationError, match=says):
        lens_of(model, TERMS[:4])


def test_another_model_without_numbers_is_told():
    assert "distortion model 'division' is unknown" in lens_of("division", [0, 0])[1]


def test_names_for_ros():
    names = [ros_name(Intrinsics(MATRIX, TERMS[:count])) for count in (0, 4, 5, 8, 12, 14)]
    assert names == ["plumb_bob"] * 3 + ["rational_polynomial"] * 3
    assert ros_name(Intrinsics(MATRIX, TERMS[:4], "fisheye")) == "equidistant"
