"""One calibrated camera."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A name, an image size (width, height) px, intrinsics and a pose in the world.

    Raises:
        CalibrationError: on an empty name or a size that is not positive.
    """

    name: str
    image_size: tuple[int, int]
    intrinsics: Intrinsics
    cam_from_world: Rigid

    def __post_init__(self) -> None:
        if not self.name:
            raise CalibrationError("a camera has no name")
        width, height = (int(value) for value in self.image_size)
        if width <= 0 or height <= 0:
            raise CalibrationError(f"camera {self.name} has image size {width} x {height}")
        object.__setattr__(self, "image_size", (width, height))

    @property
    def centre(self) -> Array:
        """Optical centre (3,) m in the world."""
        return -self.cam_from_world.rotation.T @ self.cam_from_world.translation

    def project(self, points_world: Array) -> tuple[Array, Array]:
        """Pixels (..., 2) of world points (..., 3) m and whether they can be seen (...).

        As `Intrinsics.project`: the image's borders are not tested, see `contains`.
        """
        return self.intrinsics.project(self.cam_from_world.apply(points_world))

    def sees(self, points_world: Array) -> Array:
        """Whether world points (..., 3) m project into the image (...)."""
        pixels, seen = self.project(points_world)
        return seen & self.contains(pixels)

    def contains(self, pixels: Array) -> Array:
        """Whether pixels (..., 2) are on the sensor (...); its border lies half a pixel outside."""
        width, height = self.image_size
        x, y = pixels[..., 0], pixels[..., 1]
        return (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)

    def rays(self, pixels: Array) -> Array:
        """Unit viewing rays (..., 3) in the world of pixels (..., 2)."""
        plane = self.intrinsics.undistort(pixels)
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        rays = rays @ self.cam_from_world.rotation
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
