"""Camera intrinsics: focal lengths, principal point, and one of two lens models, as in OpenCV."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import ModuleType
from typing import Literal

import numpy as np

from panoptic_ros.errors import CalibrationError, shown
from panoptic_ros.geometry import brown, fisheye

Array = np.ndarray
Lens = Literal["brown", "fisheye"]
LENSES: dict[str, ModuleType] = {"brown": brown, "fisheye": fisheye}
MIN_DEPTH = 1e-3  # m; points closer to the camera plane, or behind it, have no projection


@dataclass(frozen=True, slots=True, eq=False)
class Intrinsics:
    """Focal lengths, principal point and lens distortion of one camera.

    Args:
        matrix: (3, 3) px, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]].
        distortion: (5,), (8,), (12,) or (14,) of a Brown lens, see `brown.TERMS`, or (4,) k1, k2, k3, k4 of a
            fisheye. Missing terms are filled with zeros, trailing zeros are cut.
        lens: "brown" (Brown-Conrady, rational, with thin prism and tilt) or "fisheye" (`cv2.fisheye`). With
            both, points at 90 degrees or more from the axis are not visible.

    Raises:
        CalibrationError: on wrong shapes or impossible values.
    """

    matrix: Array
    distortion: Array
    lens: Lens = "brown"
    radius_limit: float = field(init=False)  # undistorted radius where the distortion folds back

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        given = np.array(self.distortion, np.float64).reshape(-1)
        if self.lens not in LENSES:
            raise CalibrationError(f"unknown lens {shown(self.lens)}; lenses are {', '.join(LENSES)}")
        if matrix.shape != (3, 3):
            raise CalibrationError(f"an intrinsic matrix must be 3x3, found {matrix.shape}")
        if not (np.isfinite(matrix).all() and np.isfinite(given).all()):
            raise CalibrationError("intrinsics have numbers that are not finite")
        if np.abs(given).max(initial=0.0) > 1e6 or np.abs(matrix).max() > 1e9:
            raise CalibrationError("intrinsics have absurdly large numbers")
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise CalibrationError(f"focal lengths must be positive, found {matrix[0, 0]}, {matrix[1, 1]}")
        distortion = _kept_terms(given, self.lens)
        matrix.flags.writeable = distortion.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "radius_limit", LENSES[self.lens].radius_limit(distortion))

    def project(self, points_cam: Array) -> tuple[Array, Array]:
        """Return pixels (..., 2) of camera points (..., 3) m, and whether the points are visible (...).

        A point is not visible behind the camera, or beyond the radius at which the distortion polynomial
        folds back. Its pixel is NaN. The image borders are not tested.
        """
        points = np.asarray(points_cam, np.float64)
        depth = points[..., 2]
        front = depth > MIN_DEPTH
        plane = points[..., :2] / np.where(front, depth, 1.0)[..., None]
        seen = front & ((plane * plane).sum(-1) < self.radius_limit**2)
        pixels = self.pixels_from_plane(self.distort(plane))
        return np.where(seen[..., None], pixels, np.nan), seen

    def pixels_from_plane(self, plane: Array) -> Array:
        """Return pixels (..., 2) of distorted normalised image points (..., 2)."""
        pixels: Array = plane @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        return pixels

    def plane_from_pixels(self, pixels: Array) -> Array:
        """Return distorted normalised image points (..., 2) of pixels (..., 2)."""
        fx, skew, cx = self.matrix[0]
        fy, cy = self.matrix[1, 1:]
        y = (np.asarray(pixels)[..., 1] - cy) / fy
        x = (np.asarray(pixels)[..., 0] - cx - skew * y) / fx
        return np.stack([x, y], axis=-1)

    def distort(self, plane: Array) -> Array:
        """Return distorted normalised image points (..., 2) of undistorted ones (..., 2)."""
        distorted: Array = LENSES[self.lens].distort(self.distortion, plane)
        return distorted

    def undistort(self, pixels: Array) -> Array:
        """Return undistorted normalised image points (..., 2) of pixels (..., 2), by Newton's method.

        The result is NaN where the pixel is NaN or has no undistorted point within the fold radius.
        """
        goal = self.plane_from_pixels(np.asarray(pixels, np.float64))
        plane: Array = LENSES[self.lens].undistort(self.distortion, goal, self.radius_limit)
        return plane


def _kept_terms(given: Array, lens: str) -> Array:
    """Return the distortion terms, as many as one of the lens's models has, without trailing zeros.

    Raises:
        CalibrationError: if there are more terms than the lens has, or if no model has their number.
    """
    model = LENSES[lens]
    used = int(np.max(np.nonzero(given)[0], initial=-1)) + 1
    if used > len(model.TERMS):
        raise CalibrationError(
            f"{given.size} distortion coefficients; a {lens} lens has only {' '.join(model.TERMS)}"
        )
    if not any(used <= count <= given.size for count in model.COUNTS):
        counts = ", ".join(str(count) for count in model.COUNTS if count > 2)
        raise CalibrationError(f"{given.size} distortion coefficients; a {lens} lens has {counts} of them")
    distortion = np.zeros(next(count for count in model.KEPT if count >= used))
    distortion[:used] = given[:used]
    return distortion
