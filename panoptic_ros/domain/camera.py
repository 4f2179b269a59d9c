"""One calibrated camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid, brown

Array = np.ndarray
POSE_AND_MATRIX = 10  # rotation, translation, fx, fy, cx, cy: rows of a covariance before the distortion
FARTHEST = 1e6  # m, limit of t: earth-centred coordinates are larger, and float32 cannot hold them to 1 mm
BROWN_SHAPES = tuple((POSE_AND_MATRIX + count, POSE_AND_MATRIX + count) for count in brown.KEPT)
SYMMETRY = 1e-6  # relative to the standard deviations: files may round


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Camera with a name, image size (width, height) px, intrinsics and a pose in the world.

    Args:
        type: Kind of camera, e.g. "vga", "hd", "kinect"; "" = not stated.
        panel: Panel or host of the camera; "" = not stated.
        clock: Name of the clock that stamps its images; "" = the common one.
        line_delay_us: Rolling shutter, delay from one row to the next: the timestamp is the exposure of the
            first row. 0 = global shutter: the timestamp is mid-exposure.
        covariance: (N, N) of the calibration: rotation vector of R (rad, perturbs R from the left), t (m),
            fx, fy, cx, cy (px), distortion terms. N is 15 with a Brown lens of five terms, 14 with a fisheye.
            Rows of terms that are 0 and cut from the lens are cut too. None = unknown. A read-only copy is
            kept.

    Raises:
        CalibrationError: on an empty name, a size that is not positive, or an impossible position, delay or
            covariance.
    """

    name: str
    image_size: tuple[int, int]
    intrinsics: Intrinsics
    cam_from_world: Rigid
    type: str = ""
    panel: str = ""
    clock: str = ""
    line_delay_us: float = 0.0
    covariance: Array | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise CalibrationError("a camera has no name")
        width, height = (int(value) for value in self.image_size)
        if width <= 0 or height <= 0:
            raise CalibrationError(f"camera {self.name} has image size {width} x {height}")
        object.__setattr__(self, "image_size", (width, height))
        away = float(np.abs(self.cam_from_world.translation).max())
        if not away <= FARTHEST:
            raise CalibrationError(
                f"camera {self.name} has t = {away:.3g} m, more than {FARTHEST:g} m; is its unit right?"
            )
        object.__setattr__(self, "line_delay_us", float(self.line_delay_us))
        if not 0.0 <= self.line_delay_us < float("inf"):
            raise CalibrationError(
                f"camera {self.name}: line_delay_us is {self.line_delay_us}, expected 0 or more"
            )
        if self.covariance is not None:
            object.__setattr__(self, "covariance", self._checked_covariance())

    def _checked_covariance(self) -> Array:
        """Return a read-only copy of the covariance, after checking that it fits this camera."""
        covariance = np.array(self.covariance, np.float64)
        size = POSE_AND_MATRIX + len(self.intrinsics.distortion)
        if self.intrinsics.lens == "brown" and covariance.shape in BROWN_SHAPES:
            covariance = covariance[:size, :size]
        if covariance.shape != (size, size):
            raise CalibrationError(
                f"camera {self.name}: covariance has shape {covariance.shape}, expected {size} x {size}: "
                f"rotation, t, fx, fy, cx, cy and {size - POSE_AND_MATRIX} terms of distortion"
            )
        if not np.isfinite(covariance).all():
            raise CalibrationError(f"camera {self.name}: covariance has numbers that are not finite")
        scale = np.sqrt(np.abs(np.diag(covariance)))
        if (np.abs(covariance - covariance.T) > SYMMETRY * np.outer(scale, scale)).any():
            raise CalibrationError(f"camera {self.name}: covariance is not symmetric")
        if (np.diag(covariance) < 0.0).any():
            raise CalibrationError(f"camera {self.name}: covariance has a negative variance")
        covariance.flags.writeable = False
        return covariance

    @property
    def centre(self) -> Array:
        """Return the optical centre (3,) m in the world."""
        centre: Array = -self.cam_from_world.rotation.T @ self.cam_from_world.translation
        return centre

    @property
    def middle_s(self) -> float:
        """Return the exposure of the middle image row minus the timestamp (s); 0 with a global shutter."""
        return 0.5e-6 * self.line_delay_us * (self.image_size[1] - 1)

    def resized(
        self, image_size: tuple[int, int], scale: tuple[float, float], shift: tuple[float, float] = (0.0, 0.0)
    ) -> Camera:
        """Return the camera of images that were scaled, then shifted.

        Scaling keeps the upper left border of the image, which lies half a pixel outside the first pixel's
        centre. The sensor reads its rows as before, so the delay between rows of the image changes.

        Args:
            image_size: (width, height) px afterwards.
            scale: Factors along x and y.
            shift: px, along x and y.
        """
        half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
        move = np.array([[scale[0], 0.0, shift[0]], [0.0, scale[1], shift[1]], [0.0, 0.0, 1.0]])
        matrix = np.linalg.inv(half) @ move @ half @ self.intrinsics.matrix
        covariance = self.covariance
        if covariance is not None:
            factors = np.ones(len(covariance))
            factors[6:POSE_AND_MATRIX] = scale * 2
            covariance = covariance * np.outer(factors, factors)
        return replace(
            self,
            image_size=image_size,
            intrinsics=replace(self.intrinsics, matrix=matrix),
            covariance=covariance,
            line_delay_us=self.line_delay_us / scale[1],
        )

    def project(self, points_world: Array) -> tuple[Array, Array]:
        """Return pixels (..., 2) of world points (..., 3) m, and whether the points are visible (...).

        The image borders are not tested, as in `Intrinsics.project`; see `contains`.
        """
        return self.intrinsics.project(self.cam_from_world.apply(points_world))

    def sees(self, points_world: Array) -> Array:
        """Return whether world points (..., 3) m project into the image (...)."""
        pixels, seen = self.project(points_world)
        visible: Array = seen & self.contains(pixels)
        return visible

    def contains(self, pixels: Array) -> Array:
        """Return whether pixels (..., 2) are on the sensor (...).

        The border of the sensor lies half a pixel outside the outer pixel centres.
        """
        width, height = self.image_size
        x, y = pixels[..., 0], pixels[..., 1]
        return (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)

    def rays(self, pixels: Array) -> Array:
        """Return the unit viewing rays (..., 3) in the world of pixels (..., 2)."""
        plane = self.intrinsics.undistort(pixels)
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        rays = rays @ self.cam_from_world.rotation
        directions: Array = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return directions
