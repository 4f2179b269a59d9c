"""Points triangulated by a rig, and the similarity that aligns two sets of points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.bundle import PLAIN
from panoptic_ros.domain import Rig
from panoptic_ros.geometry import triangulate_robust

Array = np.ndarray


class Similarity(NamedTuple):
    """Rotation (3, 3), factor and translation (3,) m: x -> factor * rotation @ x + translation."""

    rotation: Array
    factor: float
    translation: Array

    def apply(self, points: Array) -> Array:
        """Return the moved points (..., 3)."""
        moved: Array = self.factor * points @ self.rotation.T + self.translation
        return moved


def similarity(points: Array, targets: Array) -> Similarity:
    """Return the similarity that moves points (N, 3) nearest to targets (N, 3) (Umeyama 1991)."""
    a, b = points - points.mean(axis=0), targets - targets.mean(axis=0)
    u, sizes, v = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    rotation = (u * signs) @ v
    factor = float((sizes * signs).sum() / (a**2).sum())
    return Similarity(rotation, factor, targets.mean(axis=0) - factor * rotation @ points.mean(axis=0))


def triangulated(rig: Rig, pixels: Array, plain: bool = True) -> Array:
    """Return points (N, 3) m of pixels (N, C, 2), NaN = not seen; NaN with fewer than two views.

    Args:
        plain: Least squares; else outliers are left out.
    """
    plane = np.stack([c.intrinsics.undistort(pixels[:, k]) for k, c in enumerate(rig.cameras)], axis=1)
    if plain:
        return triangulate_robust(
            rig.stack(), plane, np.ones(plane.shape[:2]), cauchy=PLAIN, gate=PLAIN
        ).points
    return triangulate_robust(rig.stack(), plane, np.ones(plane.shape[:2])).points
