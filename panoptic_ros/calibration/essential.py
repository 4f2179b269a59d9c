"""Essential matrices of two cameras with known lenses, from points in their planes at 1 m."""

from __future__ import annotations

import cv2
import numpy as np

from panoptic_ros.geometry import Rigid

Array = np.ndarray
CONFIDENCE = 0.999  # of RANSAC
TINY = 1e-18  # least squared slope of an epipolar line


def fitted_essential(first: Array, second: Array, gate: float) -> Array | None:
    """Return the essential matrix (3, 3) of points (N, 2) by RANSAC; None if they have none.

    Args:
        gate: Residual of an inlier, m on the plane at 1 m.
    """
    try:
        essential, _ = cv2.findEssentialMat(
            first, second, np.eye(3), method=cv2.RANSAC, prob=CONFIDENCE, threshold=gate
        )
    except cv2.error:
        return None
    return None if essential is None or essential.shape[0] < 3 else essential[:3]


def essential_of(pose: Rigid) -> Array:
    """Return the essential matrix (3, 3) of a pose, second camera from first."""
    x, y, z = pose.translation / max(float(np.linalg.norm(pose.translation)), 1e-12)
    matrix: Array = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ pose.rotation
    return matrix


def epipolar_residuals(essential: Array, first: Array, second: Array) -> Array:
    """Return the Sampson residuals (...) of points (..., 2) of two cameras in the planes at 1 m."""
    a = np.concatenate([first, np.ones_like(first[..., :1])], axis=-1)
    b = np.concatenate([second, np.ones_like(second[..., :1])], axis=-1)
    along, back = a @ essential.T, b @ essential
    slope = (along[..., :2] ** 2).sum(axis=-1) + (back[..., :2] ** 2).sum(axis=-1)
    residuals: Array = np.abs((b * along).sum(axis=-1)) / np.sqrt(np.maximum(slope, TINY))
    return residuals


def relative_pose(essential: Array, first: Array, second: Array) -> Rigid:
    """Return the pose second camera from first, with a translation of length 1.

    Args:
        first, second: (N, 2) inliers; most of them are in front of both cameras.
    """
    _, rotation, move, _ = cv2.recoverPose(essential, first, second, np.eye(3))
    return Rigid(rotation, move.reshape(3))


def parallax(pose: Rigid, first: Array, second: Array) -> float:
    """Return the sine of the median angle between the rays of common points (N, 2)."""
    rays = [np.concatenate([points, np.ones((len(points), 1))], axis=1) for points in (first, second)]
    rays = [ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays]
    return float(np.median(np.linalg.norm(np.cross(rays[0] @ pose.rotation.T, rays[1]), axis=1)))
