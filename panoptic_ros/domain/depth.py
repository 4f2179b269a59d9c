"""Depth maps as a stream of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrame:
    """One depth map of a depth sensor, or of a camera to which depth is registered.

    Args:
        camera: name of the depth sensor or of the camera.
        stamp_ns: mid-exposure, on the clock of that sensor or camera.
        frame_number: counts the maps that the device gave, so gaps are visible.
        depth: (h, w) float32 m along the z axis of the sensor or camera; 0 and what is not finite =
            unknown (REP 118). Not copied; a read-only view is kept.

    Raises:
        DataError: without a name, or on another type or shape.
    """

    camera: str
    stamp_ns: int
    frame_number: int
    depth: Array

    def __post_init__(self) -> None:
        if not self.camera:
            raise DataError("DepthFrame without the name of its camera or sensor")
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        depth = np.asarray(self.depth)
        if depth.dtype != np.float32 or depth.ndim != 2 or not depth.size:
            found = f"{depth.dtype} {depth.shape}"
            raise DataError(f"depth map of {self.camera}: {found}, expected float32 (h, w)")
        view = depth.view()
        view.flags.writeable = False
        object.__setattr__(self, "depth", view)

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height in px."""
        return self.depth.shape[1], self.depth.shape[0]

    def check_image(self, image_size: tuple[int, int]) -> None:
        """Whether it can be registered to an image: it has the proportions of width and height (px).

        Raises:
            DataError: if not.
        """
        (width, height), (columns, rows) = image_size, self.image_size
        if abs(columns * height - rows * width) > max(width, height):
            raise DataError(
                f"depth map of camera {self.camera} has {columns} x {rows} pixels, its image {width} x "
                f"{height}: another shape; register the depth to the colour camera"
            )
