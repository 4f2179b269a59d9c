"""A small rig with all parameters different from each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid


@pytest.fixture
def rig() -> Rig:
    cameras = []
    for i in range(3):
        turn = Rotation.from_euler("xyz", [100 + 7 * i, 20 - 5 * i, 30 + 80 * i], degrees=True).as_matrix()
        matrix = [[900.5 + i, 0.0, 640.25], [0.0, 905.125 - i, 361.0 + i], [0.0, 0.0, 1.0]]
        lens = [-0.11 + 0.01 * i, 0.03, 1e-4, -2e-5, 0.001]
        pose = Rigid(turn, np.array([0.1 * i, 1.5, 3.2 + i / 3]))
        cameras.append(Camera(f"cam{i:02d}", (1280, 720), Intrinsics(np.array(matrix), np.array(lens)), pose))
    return Rig(tuple(cameras))
