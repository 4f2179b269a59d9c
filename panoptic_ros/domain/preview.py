"""Small pictures of what cameras see."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.domain.checks import check_stamp
from panoptic_ros.errors import DataError


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """One image of one camera, made small: for people who look on, never for a stage.

    Args:
        stamp_ns: that of the image, on the camera's clock.
        jpeg: the whole image, with the lens's distortion; pixels scale with its size.
    """

    camera: str
    stamp_ns: int
    jpeg: bytes

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        if self.jpeg[:2] != b"\xff\xd8":
            raise DataError(f"the preview of camera {self.camera} is no JPEG")
