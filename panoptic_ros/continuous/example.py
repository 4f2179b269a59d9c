"""An artificial person in artificial cameras, to compile all kernels in advance."""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.config import ContinuousStageConfig
from panoptic_ros.continuous.online import OnlineMotion
from panoptic_ros.domain import Camera, Rig, SkeletonModel
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.solving.frames import CameraFrame

CAMERAS, DISTANCE, FOCAL = 4, 4.0, 600.0  # number of cameras around the person, m, px
SIZE = (640, 480)  # px
VIEWS, STEP_S = 70, 0.01  # number of views, s between them
EXTENT = 0.15  # m, standard deviation of the joints: a person of human size


def follow_example(skeleton: SkeletonModel) -> None:
    """Follow a person at rest for long enough that lengths are learnt."""
    matrix = np.array([[FOCAL, 0.0, 319.5], [0.0, FOCAL, 239.5], [0.0, 0.0, 1.0]])
    lens = Intrinsics(matrix, np.zeros(5))
    cameras = []
    for k in range(CAMERAS):
        angle = 2.0 * np.pi * (k + 0.3) / CAMERAS
        ahead = -np.array([np.cos(angle), np.sin(angle), 0.0])
        rotation = np.stack([np.cross([0.0, 0.0, -1.0], ahead), [0.0, 0.0, -1.0], ahead])
        cameras.append(Camera(f"{k}", SIZE, lens, Rigid(rotation, np.array([0.0, 0.0, DISTANCE]))))
    arrays = RigArrays.of(Rig(tuple(cameras)))
    joints = np.random.default_rng(0).normal(0.0, EXTENT, (len(skeleton), 3))
    motion = OnlineMotion(arrays, skeleton, ContinuousStageConfig())
    for number in range(VIEWS):
        camera = number % CAMERAS
        local = joints @ arrays.rotations[camera].T + arrays.translations[camera]
        plane = (local[:, :2] / local[:, 2:])[None]
        ones = np.ones((1, len(skeleton)))
        frame = CameraFrame(camera, 0, plane, ones, 240.0 * ones)
        motion.take(frame, number * STEP_S)
        motion.settle()
        motion.at((number - 0.5) * STEP_S)
