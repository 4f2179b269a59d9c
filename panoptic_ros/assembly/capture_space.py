"""The space that a rig covers: bystanders beyond it are not reported.

A person in the fields of view of two cameras alone, of four or more, stands outside of what the rig was set
up for: behind another camera, or at the far wall. (One whom two views see although more could is inside.)
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Camera

Array = np.ndarray

FEW_CAMERAS = 3  # rigs up to this size cover whatever two cameras see
INSIDE = 0.5  # share of the joints that must lie in a camera's image


def needed_views(wanted: int, cameras: int) -> int:
    """Fields of view in which a person must be, for a rig of so many cameras."""
    return 2 if cameras <= FEW_CAMERAS else max(2, min(wanted, cameras))


def in_capture_space(positions: Array, supporting: Array, cameras: Sequence[Camera], needed: int) -> Array:
    """Which people (P,) stand where at least `needed` cameras look.

    Args:
        positions: (P, J, 3) m, NaN = missing.
        supporting: (P,) number of views that show the person; enough of them need no test.
    """
    inside = supporting >= needed
    open_rows = np.flatnonzero(~inside)
    if not len(open_rows):
        return inside
    points = positions[open_rows]
    there = np.isfinite(points[..., 0])
    count = np.zeros(len(open_rows), int)
    for camera in cameras:
        seen = camera.sees(np.where(there[..., None], points, 0.0)) & there
        count += seen.sum(axis=1) >= INSIDE * np.maximum(there.sum(axis=1), 1)
    inside[open_rows] = count >= needed
    return inside
