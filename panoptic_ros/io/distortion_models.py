"""Read lens distortion by the model names and coefficient counts that drivers and calibration tools use."""

from __future__ import annotations

import re

import numpy as np

from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.geometry import Intrinsics, Lens

Array = np.ndarray
OPENCV = "opencv"  # assumed model of files that name none
# Names in lower case, letters and digits only. All OpenCV models except the fisheye form one model with 14
# terms.
_BROWN = frozenset(
    """brown brownconrady fullopencv opencv opencv4 opencv5 opencv8 opencv12 opencv14 perspective pinhole
    pinholebrown pinholeradtan plumbbob plumbbob8 radial radialtangential radtan radtan8 rational
    rationalmodel rationalpolynomial rationalthinprism simpleradial thinprism thinprismmodel tilted
    tiltedmodel""".split()
)
_FISHEYE = frozenset(
    """equi equidistant equidistantfisheye fisheye kannalabrandt kannalabrandt4 kannalabrandt8 kb kb4
    opencvfisheye pinholeequi pinholefisheye radialfisheye simpleradialfisheye""".split()
)
_NONE = frozenset(("", "ideal", "none", "nodistortion", "rectified", "undistorted"))
_MOST = {"plumbbob": 5, "radtan": 4, "radialtangential": 4}  # number of coefficients that the name implies
KNOWN = "plumb_bob, rational_polynomial, equidistant, and their names in OpenCV and Kalibr"


def ros_name(intrinsics: Intrinsics) -> str:
    """Return the name of a lens model in sensor_msgs/distortion_models.hpp."""
    if intrinsics.lens == "fisheye":
        return "equidistant"
    return "plumb_bob" if len(intrinsics.distortion) == 5 else "rational_polynomial"


def read_lens(model: object, numbers: Array) -> tuple[Lens, Array, str]:
    """Read lens distortion in one of OpenCV's models, under any of its names.

    Args:
        model: model name in a file or message; "" = not named.
        numbers: coefficients (N,) in OpenCV's order; trailing zeros are ignored.

    Returns:
        the lens; its coefficients as `Intrinsics` takes them; a notice about an assumption, or "".

    Raises:
        CalibrationError: if the model is unsupported, or unnamed although it has coefficients.
    """
    given = np.asarray(numbers, np.float64).reshape(-1)
    if not isinstance(model, str):
        raise CalibrationError(f"the distortion model is {shown(model)}, expected its name")
    name = re.sub("[^a-z0-9]", "", model.lower())
    if name in _FISHEYE:
        return "fisheye", given, ""
    if name in _BROWN:
        return _brown(model, given, _MOST.get(name, given.size))
    if given.any():
        named = f"is {shown(model)}" if name else "is not named, but has coefficients"
        raise CalibrationError(
            f"the distortion model {named}; models that are read: {KNOWN}. Calibrate the camera with one of "
            "them, or undistort its images"
        )
    unknown = f"distortion model {shown(model)} is unknown; as it has no coefficients, none is used"
    return "brown", np.zeros(0), "" if name in _NONE else unknown


def _brown(model: str, given: Array, most: int) -> tuple[Lens, Array, str]:
    if given.size == 3 and given[2]:
        terms = np.array([given[0], given[1], 0.0, 0.0, given[2]])
        return "brown", terms, "the 3 distortion coefficients are taken as k1 k2 k3"
    if given.size <= most:
        return "brown", given, ""
    rest = "are taken as those of OpenCV's model" if given[most:].any() else "are 0 and mean nothing"
    told = f"distortion model {model} has {most} coefficients, not {given.size}; the others {rest}"
    return "brown", given, told
