"""Geometry on arrays: rigid transforms, cameras with the lens models of OpenCV, rays, triangulation.

This package has no people and no camera names. Arrays are float64; units are metres, pixels, radians. Pixel
(0, 0) is the centre of the top-left pixel. Camera axes are x right, y down, z forward.
"""

from panoptic_ros.geometry.pinhole import Intrinsics, Lens
from panoptic_ros.geometry.rigid import Rigid
from panoptic_ros.geometry.triangulation import (
    ProjectionStack,
    Triangulation,
    triangulate_linear,
    triangulate_robust,
)

__all__ = [
    "Intrinsics",
    "Lens",
    "ProjectionStack",
    "Rigid",
    "Triangulation",
    "triangulate_linear",
    "triangulate_robust",
]
