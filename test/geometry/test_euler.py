"""Angles of joints: turns about the axes, one after another, give the rotation again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.geometry.euler import ORDERS, euler_angles
from panoptic_ros.geometry.rotations import rotations_of

ANGLES = st.floats(-3.1, 3.1)


def turned(order, angles):
    found = np.eye(3)
    for axis, angle in zip(order, angles):
        vector = np.zeros((1, 3))
        vector[0, "xyz".index(axis)] = angle
        found = found @ rotations_of(vector)[0]
    return found


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(ORDERS), ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_angles_are_found_again(order, first, middle, last):
    found = euler_angles(turned(order, (first, middle, last)), order)
    np.testing.assert_allclose(found, (first, middle, last), atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [np.pi / 2, -np.pi / 2])
def test_a_right_middle_angle_still_gives_the_rotation(order, middle):
    rotation = turned(order, (0.3, middle, 0.5))
    found = euler_angles(rotation, order)
    np.testing.assert_allclose(turned(order, found), rotation, atol=1e-7)
    assert found[2] == 0.0
