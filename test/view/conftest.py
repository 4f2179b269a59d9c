"""A small skeleton, a rig on a ring and poses to draw."""

import numpy as np
import pytest

from panoptic_ros.domain import Camera, JointState, Rig, SkeletonModel, TrackedPoseSet, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid


def ring_camera(name: str, angle: float, size=(320, 240), radius: float = 4.0, distortion=(0.0,)) -> Camera:
    """A camera at height 1 m that looks at the vertical axis of the world."""
    right = [-np.sin(angle), np.cos(angle), 0.0]
    forward = [-np.cos(angle), -np.sin(angle), 0.0]
    rotation = np.array([right, [0.0, 0.0, -1.0], forward])
    centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 1.0])
    matrix = [[300.0, 0.0, (size[0] - 1) / 2], [0.0, 300.0, (size[1] - 1) / 2], [0.0, 0.0, 1.0]]
    return Camera(name, size, Intrinsics(matrix, distortion), Rigid(rotation, -rotation @ centre))


@pytest.fixture
def skeleton():
    return SkeletonModel("stick", ("hip", "head", "left_knee", "left_ankle"), 0, ((0, 1), (0, 2), (2, 3)), 1)


@pytest.fixture
def rig():
    return Rig(tuple(ring_camera(f"cam{i}", 2 * np.pi * i / 4) for i in range(4)))


@pytest.fixture
def make_camera():
    return ring_camera


@pytest.fixture
def make_poses(skeleton):
    """make_poses(places, ids, index=0, states=None, stamp_ns=None): people that stand at (x, y)."""

    def make(places, ids, index=0, states=None, stamp_ns=None):
        body = np.array([[0, 0, 1.0], [0, 0, 1.7], [0, 0, 0.55], [0, 0, 0.1]])
        positions = np.array([body + [x, y, 0.0] for x, y in places]).reshape(-1, 4, 3)
        states = np.full(positions.shape[:2], JointState.MEASURED) if states is None else np.asarray(states)
        there = states != JointState.MISSING
        return TrackedPoseSet(
            index,
            33_333_333 * index if stamp_ns is None else stamp_ns,
            skeleton.hash,
            np.where(there[..., None], positions, np.nan),
            np.where(there[..., None, None], np.eye(3) * 1e-4, np.nan),
            0.9 * there,
            4 * there,
            states,
            np.full(len(positions), 0.9),
            ids=ids,
        )

    return make


@pytest.fixture
def detect(skeleton):
    """detect(camera, poses, shift=(0, 0)): exactly what a camera would see, moved by some px."""

    def make(camera, poses, shift=(0.0, 0.0), order=None):
        points = camera.project(poses.positions)[0] + shift
        points = points[list(order)] if order is not None else points
        scores = 0.8 * np.isfinite(points).all(-1)
        return ViewDetections(
            camera.name,
            poses.stamp_ns,
            poses.index,
            camera.image_size,
            skeleton.hash,
            points,
            scores,
            np.full(len(points), 0.8),
        )

    return make
