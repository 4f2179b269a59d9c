"""Against scipy."""
import numpy as np
from scipy.spatial.transform import Rotation

from panoptic_ros.geometry.rotations import from_quaternions, quaternion_of


def test_quaternion_of_a_rotation():
    half_turns = np.pi * np.vstack([np.eye(3), -np.eye(3)])
    for rotation in [*Rotation.random(200, np.random.default_rng(1)), *Rotation.from_rotvec(half_turns)]:
        matrix = rotation.as_matrix()
        found = quaternion_of(matrix)
        np.testing.assert_allclose(found, rotation.from_matrix(matrix).as_quat()[[3, 0, 1, 2]], atol=1e-12)
        np.testing.assert_allclose(from_quaternions(found), matrix, atol=1e-12)
