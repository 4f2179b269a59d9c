"""Maths on arrays: rigid transforms, cameras with the lenses of OpenCV, rays, triangulation.

Nothing here knows about people or camera names. Arrays are float64; metres, pixels, radians.
Pixel (0, 0) is the centre of the top-left pixel, camera axes are x right, y down, z forward.
"""

from panoptic_ros.geometry.pinhole import Intrinsics, Lens
from panoptic_ros.geometry.rigid import Rigid
from panoptic_ros.geometry.triangulation import (
    ProjectionStack,
    Triangulated,
    triangulate_linear,
    triangulate_robust,
)

__all__ = [
    "Intrinsics",
    "Lens",
    "ProjectionStack",
    "Rigid",
    "Triangulated",
    "triangulate_linear",
    "triangulate_robust",
]
