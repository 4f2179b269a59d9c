"""Torso frames of made bodies."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from panoptic_ros.geometry.torso import torso_frames

# left shoulder, right shoulder, left hip, right hip of somebody who stands and looks along x
STANDING = np.array([[0.0, 0.2, 1.4], [0.0, -0.2, 1.4], [0.0, 0.15, 0.9], [0.0, -0.15, 0.9]])


def test_somebody_who_looks_along_x():
    axes, length = torso_frames(STANDING)
    assert np.allclose(axes, np.eye(3)) and np.isclose(length, 0.5)


@given(st.integers(0, 10**6))
def test_frames_turn_with_the_body(seed):
    rng = np.random.default_rng(seed)
    corners = STANDING + rng.normal(0, 0.03, (2, 4, 3))
    turn = Rotation.random(random_state=seed).as_matrix()
    axes, lengths = torso_frames(corners)
    turned, same = torso_frames(corners @ turn.T + rng.normal(0, 3, 3))
    assert np.allclose(turn @ axes, turned) and np.allclose(lengths, same)
    assert np.allclose(np.swapaxes(axes, 1, 2) @ axes, np.eye(3)) and np.allclose(np.linalg.det(axes), 1.0)


def test_no_frame_without_a_corner_or_without_sides():
    missing = STANDING.copy()
    missing[2] = np.nan
    narrow = STANDING * [1.0, 0.0, 1.0]
    flat = STANDING * [1.0, 1.0, 0.0]
    axes, lengths = torso_frames(np.stack([missing, narrow, flat]))
    assert np.isnan(axes).all() and np.isnan(lengths).all()
