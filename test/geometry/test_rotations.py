"""Against scipy."""

import numpy as np
from scipy.spatial.transform import Rotation

from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions


def test_quaternions_of_rotations():
    half_turns = np.pi * np.vstack([np.eye(3), -np.eye(3)])
    near = (1.0 - 1e-9) * half_turns
    some = Rotation.random(200, np.random.default_rng(1))
    matrices = np.concatenate([r.as_matrix() for r in (some, *map(Rotation.from_rotvec, (half_turns, near)))])
    found = to_quaternions(matrices)
    assert (found[:, 0] >= 0.0).all()
    expected = Rotation.from_matrix(matrices).as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs((found * expected).sum(-1)), 1.0, atol=1e-12)  # up to the sign
    np.testing.assert_allclose(from_quaternions(found), matrices, atol=1e-12)
    np.testing.assert_allclose(to_quaternions(matrices[:6].reshape(2, 3, 3, 3)), found[:6].reshape(2, 3, 4))
