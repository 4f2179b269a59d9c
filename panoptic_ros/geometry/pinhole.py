"""The pinhole camera with Brown-Conrady distortion k1 k2 p1 p2 k3, as in OpenCV."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from panoptic_ros.errors import CalibrationError

Array = np.ndarray
MIN_DEPTH = 1e-3  # m; points closer to the camera plane, or behind it, have no projection


@dataclass(frozen=True, slots=True, eq=False)
class Intrinsics:
    """Focal lengths, principal point and lens distortion of one camera.

    Args:
        matrix: (3, 3) px, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]].
        distortion: (5,) k1, k2, p1, p2, k3; shorter ones are filled with zeros.

    Raises:
        CalibrationError: on wrong shapes or impossible values.
    """

    matrix: Array
    distortion: Array
    radius_limit: float = field(init=False)  # undistorted radius where the distortion folds back

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        given = np.array(self.distortion, np.float64).reshape(-1)
        if matrix.shape != (3, 3):
            raise CalibrationError(f"an intrinsic matrix must be 3x3, found {matrix.shape}")
        if given.size > 5:
            raise CalibrationError(
                f"{given.size} distortion coefficients; only k1 k2 p1 p2 k3 are supported"
            )
        if not (np.isfinite(matrix).all() and np.isfinite(given).all()):
            raise CalibrationError("intrinsics have numbers that are not finite")
        if np.abs(given).max(initial=0.0) > 1e6 or np.abs(matrix).max() > 1e9:
            raise CalibrationError("intrinsics have absurdly large numbers")
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise CalibrationError(f"focal lengths must be positive, found {matrix[0, 0]}, {matrix[1, 1]}")
        distortion = np.zeros(5)
        distortion[: given.size] = given
        matrix.flags.writeable = distortion.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "radius_limit", _fold_radius(distortion))

    def project(self, points_cam: Array) -> tuple[Array, Array]:
        """Pixels (..., 2) of camera points (..., 3) m, and whether they can be seen (...).

        False for points behind the camera or beyond the radius at which the distortion polynomial
        folds back; their pixels are NaN. Being inside of the image is not tested.
        """
        points = np.asarray(points_cam, np.float64)
        depth = points[..., 2]
        front = depth > MIN_DEPTH
        plane = points[..., :2] / np.where(front, depth, 1.0)[..., None]
        seen = front & ((plane * plane).sum(-1) < self.radius_limit**2)
        pixels = self.pixels_from_plane(self.distort(plane))
        return np.where(seen[..., None], pixels, np.nan), seen

    def pixels_from_plane(self, plane: Array) -> Array:
        """Pixels (..., 2) of distorted normalised image points (..., 2)."""
        return plane @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def plane_from_pixels(self, pixels: Array) -> Array:
        """Distorted normalised image points (..., 2) of pixels (..., 2)."""
        fx, skew, cx = self.matrix[0]
        fy, cy = self.matrix[1, 1:]
        y = (np.asarray(pixels)[..., 1] - cy) / fy
        x = (np.asarray(pixels)[..., 0] - cx - skew * y) / fx
        return np.stack([x, y], axis=-1)

    def distort(self, plane: Array) -> Array:
        """Distorted normalised image points (..., 2) of undistorted ones (..., 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = plane[..., 0], plane[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def distort_jacobian(self, plane: Array) -> Array:
        """Derivative (..., 2, 2) of `distort` at undistorted points (..., 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = plane[..., 0], plane[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))  # d radial / d r2, times 2
        cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        dx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        dy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return np.stack([np.stack([dx, cross], -1), np.stack([cross, dy], -1)], axis=-2)

    def undistort(self, pixels: Array) -> Array:
        """Undistorted normalised image points (..., 2) of pixels (..., 2), by Newton's method.

        NaN where the pixel is NaN or has no undistorted point inside of the fold radius.
        """
        goal = self.plane_from_pixels(np.asarray(pixels, np.float64))
        if not self.distortion.any():
            return goal
        plane = goal.copy()
        limit = min(self.radius_limit, 1e3)
        for _ in range(20):
            miss = self.distort(plane) - goal
            if not np.nanmax(np.abs(miss), initial=0.0) > 1e-14:
                break
            j = self.distort_jacobian(plane)
            det = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
            det = np.where(np.abs(det) > 1e-6, det, 1e-6)
            step_x = (j[..., 1, 1] * miss[..., 0] - j[..., 0, 1] * miss[..., 1]) / det
            step_y = (j[..., 0, 0] * miss[..., 1] - j[..., 1, 0] * miss[..., 0]) / det
            plane = plane - np.stack([step_x, step_y], axis=-1)
            radius = np.linalg.norm(plane, axis=-1, keepdims=True)
            plane = np.where(radius > limit, plane * (limit / np.maximum(radius, 1e-12)), plane)
        good = np.abs(self.distort(plane) - goal).max(axis=-1) < 1e-8
        return np.where(good[..., None], plane, np.nan)

    def project_jacobian(self, points_cam: Array) -> Array:
        """Derivative (..., 2, 3) of the projection of camera points (..., 3), px per m."""
        points = np.asarray(points_cam, np.float64)
        inverse = 1.0 / np.maximum(points[..., 2], MIN_DEPTH)
        plane = points[..., :2] * inverse[..., None]
        normalise = np.zeros((*points.shape[:-1], 2, 3))
        normalise[..., 0, 0] = normalise[..., 1, 1] = inverse
        normalise[..., :, 2] = -plane * inverse[..., None]
        return self.matrix[:2, :2] @ self.distort_jacobian(plane) @ normalise


def _fold_radius(distortion: Array) -> float:
    """Largest undistorted radius up to which the radial polynomial increases; inf if always."""
    k1, k2, _, _, k3 = np.where(np.abs(distortion) < 1e-15, 0.0, distortion)  # roots() divides by them
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # of d(r * radial)/dr, in r^2
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real
    return float(np.sqrt(real.min())) if real.size else float("inf")
