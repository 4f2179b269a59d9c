"""Projection of the adjustment: values of `Intrinsics`, derivatives against finite differences."""

import numpy as np
import pytest

from panoptic_ros.calibration.projection import LENS, OFFSET, POSE, derivatives, project
from panoptic_ros.calibration.target_poses import intrinsics_of
from panoptic_ros.geometry.rotations import rotations_of

LENSES = {
    "brown": (False, [1000, 1010, 640, 360, -0.25, 0.08, 0.001, -0.002, -0.01, 0, 0, 0]),
    "rational": (False, [900, 905, 630, 350, 0.3, -0.1, 0.001, 0.002, 0.02, 0.05, -0.02, 0.01]),
    "fisheye": (True, [400, 402, 640, 360, -0.03, 0.01, -0.002, 0.001, 0, 0, 0, 0]),
}
STEP = 1e-6


def scene():
    rotation = rotations_of(np.array([[0.3, -0.8, 0.2]]))[0]
    translation = np.array([0.2, -0.1, 2.0])
    return rotation, translation, np.array([0.5, 0.4, 0.3])


def pixel_of(lens, fisheye, rotation, translation, point):
    pixel = np.empty(2)
    assert project(lens, fisheye, rotation, translation, *point, pixel)
    return pixel


@pytest.mark.parametrize("name", LENSES)
def test_projection_is_that_of_the_intrinsics(name):
    fisheye, lens = LENSES[name][0], np.array(LENSES[name][1], float)
    rotation, translation, point = scene()
    pixels, seen = intrinsics_of(lens, fisheye).project((rotation @ point + translation)[None])
    assert seen.all()
    np.testing.assert_allclose(pixel_of(lens, fisheye, rotation, translation, point), pixels[0], atol=1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_derivatives_are_those_of_finite_differences(name):
    fisheye, lens = LENSES[name][0], np.array(LENSES[name][1], float)
    rotation, translation, point = scene()
    pixel, by_camera, by_point = np.empty(2), np.empty((2, OFFSET)), np.empty((2, 3))
    assert derivatives(lens, fisheye, rotation, translation, *point, pixel, by_camera, by_point)
    np.testing.assert_allclose(pixel, pixel_of(lens, fisheye, rotation, translation, point))

    def moved(k, step):
        vector, move, terms = np.zeros((1, 3)), translation.copy(), lens.copy()
        if k < 3:
            vector[0, k] = step
        elif k < POSE:
            move[k - 3] += step
        else:
            terms[k - POSE] += step
        return pixel_of(terms, fisheye, rotations_of(vector)[0] @ rotation, move, point)

    free = 8 if fisheye else LENS
    for k in range(POSE + free):
        slope = (moved(k, STEP) - moved(k, -STEP)) / (2 * STEP)
        np.testing.assert_allclose(by_camera[:, k], slope, atol=1e-5 * max(1.0, abs(slope).max()))
    for k in range(3):
        shift = STEP * np.eye(3)[k]
        ends = [pixel_of(lens, fisheye, rotation, translation, point + s * shift) for s in (1, -1)]
        np.testing.assert_allclose(by_point[:, k], (ends[0] - ends[1]) / (2 * STEP), rtol=1e-5, atol=1e-5)


def test_a_point_behind_the_camera_has_no_pixel():
    lens = np.array(LENSES["brown"][1], float)
    assert not project(lens, False, np.eye(3), np.zeros(3), 0.0, 0.0, -1.0, np.empty(2))
