"""N-view triangulation: a linear start, then robust least squares on the reprojection error.

Both steps use undistorted normalised image points, so a view is just its `cam_from_world`. Noise is given in
pixels and divided by the focal length. The objective is that of Joo et al. 2017, section 5.3 (reprojection
refinement), with a Cauchy weight instead of the plain norm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ProjectionStack:
    """Cameras of a rig as arrays, C cameras.

    Args:
        rotations: (C, 3, 3) of cam_from_world.
        translations: (C, 3) m of cam_from_world.
        focals: (C,) px, mean focal length: converts noise in px to the normalised plane.
    """

    rotations: Array
    translations: Array
    focals: Array

    @property
    def centres(self) -> Array:
        """Return the optical centres (C, 3) m in the world."""
        centres: Array = -np.einsum("cji,cj->ci", self.rotations, self.translations)
        return centres

    def rays(self, plane: Array) -> Array:
        """Return the unit viewing rays (C, ..., 3) in the world of normalised points (C, ..., 2)."""
        homogeneous = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        rays = np.einsum("c...i,cij->c...j", homogeneous, self.rotations)
        directions: Array = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return directions


@dataclass(frozen=True, slots=True, eq=False)
class Triangulation:
    """Triangulation result for N points seen by C cameras.

    points: (N, 3) m, NaN where fewer than two views were left.
    covariances: (N, 3, 3) m^2, inverse of the weighted normal matrix; NaN likewise.
    residuals: (N, C) px, NaN where a view was not given or the point is NaN.
    inliers: (N, C) bool, the views that the final point uses.
    """

    points: Array
    covariances: Array
    residuals: Array
    inliers: Array


def triangulate_linear(stack: ProjectionStack, plane: Array, weights: Array) -> Array:
    """Triangulate points linearly with weights, in normalised coordinates.

    Args:
        plane: (N, C, 2) undistorted normalised points, any value where the weight is 0.
        weights: (N, C) at least 0.

    Returns:
        points (N, 3) m, NaN with fewer than two views of positive weight.
    """
    used = (weights > 0.0) & np.isfinite(plane).all(-1)
    w = np.where(used, weights, 0.0)[..., None]
    safe = np.where(used[..., None], plane, 0.0)
    rows = w[..., None] * (safe[..., None] * stack.rotations[:, 2][:, None, :] - stack.rotations[:, :2])
    values = w * (stack.translations[:, :2] - safe * stack.translations[:, 2:])
    a = rows.reshape(len(plane), 2 * plane.shape[1], 3)
    b = values.reshape(len(plane), 2 * plane.shape[1], 1)
    scale = np.einsum("nri,nri->n", a, a)[:, None, None]
    normal = a.swapaxes(1, 2) @ a + 1e-12 * np.maximum(scale, 1e-12) * np.eye(3)
    points = np.linalg.solve(normal, a.swapaxes(1, 2) @ b)[..., 0]
    return np.where(used.sum(1)[:, None] >= 2, points, np.nan)


def triangulate_robust(
    stack: ProjectionStack,
    plane: Array,
    sigmas: Array,
    start: Array | None = None,
    *,
    cauchy: float = 3.0,
    gate: float = 5.0,
    iterations: int = 8,
) -> Triangulation:
    """Triangulate by Gauss-Newton with Cauchy weights on the reprojection error, gated in the last steps.

    Args:
        plane: (N, C, 2) undistorted normalised points, NaN where there is no observation.
        sigmas: (N, C) px, standard deviation per axis; ignored where plane is NaN.
        start: (N, 3) m, or None for a weighted linear start; NaN rows get the linear start.
        cauchy: Scale of the Cauchy weight 1 / (1 + (r / cauchy)^2), in standard deviations.
        gate: Residual beyond which the last two steps drop a view, in standard deviations.
        iterations: Number of steps.

    Returns:
        see `Triangulation`. The covariance is that of the remaining views, without inflation.
    """
    from panoptic_ros.geometry.robust import growth  # imported here, because numba is slow to load

    given = np.isfinite(plane).all(-1)
    precision = np.where(given, stack.focals / np.where(given, sigmas, 1.0), 0.0)  # 1 / plane unit
    points = triangulate_linear(stack, plane, precision)
    if start is not None:
        points = np.where(np.isfinite(start).all(-1, keepdims=True), start, points)
    safe = np.where(given[..., None], plane, 0.0)
    solvable = np.isfinite(points).all(-1)
    x = np.where(solvable[:, None], points, 0.0)
    for step in range(iterations + 1):
        error, jacobian, front = _linearised(stack, x, safe)
        residual = np.where(front, np.linalg.norm(error, axis=-1) * precision, np.inf)
        residual = np.where(given, residual, 0.0)
        weights = given / growth(residual**2, cauchy)
        if step >= iterations - 2:
            weights = np.where(residual < gate, weights, 0.0)
        w = weights * precision**2
        normal = np.einsum("nc,ncki,nckj->nij", w, jacobian, jacobian)
        if step == iterations:
            break
        right = np.einsum("nc,ncki,nck->ni", w, jacobian, error)
        delta = np.linalg.solve(_damped(normal, 1e-6), right[..., None])[..., 0]
        length = np.linalg.norm(delta, axis=-1, keepdims=True)
        x = x + delta * np.minimum(1.0, 0.5 / np.maximum(length, 1e-12))  # at most 0.5 m per step
    inliers = given & (weights > 0.0)
    good = solvable & (inliers.sum(1) >= 2)
    covariances = np.linalg.inv(np.where(good[:, None, None], _damped(normal), np.eye(3)))
    pixels = np.where(given, residual / np.maximum(precision, 1e-12) * stack.focals, np.nan)
    return Triangulation(
        np.where(good[:, None], x, np.nan),
        np.where(good[:, None, None], covariances, np.nan),
        np.where(good[:, None], pixels, np.nan),
        inliers & good[:, None],
    )


def _linearised(stack: ProjectionStack, points: Array, plane: Array) -> tuple[Array, Array, Array]:
    """Linearise the projection at points (N, 3) m.

    Returns:
        errors (N, C, 2) on the plane, d projection / d point (N, C, 2, 3), and which points are in front of
            the camera (N, C).
    """
    local = np.einsum("cij,nj->nci", stack.rotations, points) + stack.translations
    front = local[..., 2] > 1e-3
    inverse = 1.0 / np.where(front, local[..., 2], 1.0)
    projected = local[..., :2] * inverse[..., None]
    jacobian = inverse[..., None, None] * (
        stack.rotations[:, :2] - projected[..., None] * stack.rotations[:, 2][:, None, :]
    )
    return plane - projected, jacobian, front


def _damped(normal: Array, least: float = 0.0) -> Array:
    """Return matrices (N, 3, 3) with 1e-9 of their trace, but at least of `least`, added to the diagonals."""
    scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    regular: Array = normal + 1e-9 * np.eye(3) * np.maximum(scale, least)
    return regular
