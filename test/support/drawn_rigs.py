"""Rigs with calibration errors that follow their covariance, and what they triangulate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of


def drawn(camera: Camera, rng: np.random.Generator) -> Camera:
    """Return the camera with calibration errors that follow its covariance."""
    error = rng.multivariate_normal(np.zeros(len(camera.covariance)), camera.covariance)
    pose, lens = camera.cam_from_world, camera.intrinsics
    rotation = rotations_of(error[None, :3])[0] @ pose.rotation
    matrix = lens.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += error[6:10]
    intrinsics = replace(lens, matrix=matrix, distortion=lens.distortion + error[10:])
    return replace(
        camera, cam_from_world=Rigid(rotation, pose.translation + error[3:6]), intrinsics=intrinsics
    )


def triangulated(cameras: Sequence[Camera], pixels: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return points (N, 3) with least squares of pixel errors on the plane, by Gauss-Newton."""
    points = start.copy()
    for _ in range(4):
        normal, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
        for camera, own in zip(cameras, pixels):
            rotation, focal = camera.cam_from_world.rotation, camera.intrinsics.matrix[[0, 1], [0, 1]].mean()
            local = camera.cam_from_world.apply(points)
            plane = local[:, :2] / local[:, 2:]
            slopes = (rotation[:2] - plane[..., None] * rotation[2]) / local[:, 2, None, None]
            normal += focal**2 * slopes.transpose(0, 2, 1) @ slopes
            error = camera.intrinsics.undistort(own) - plane
            right += focal**2 * (slopes.transpose(0, 2, 1) @ error[..., None])[..., 0]
        points += np.linalg.solve(normal, right[..., None])[..., 0]
    return points
