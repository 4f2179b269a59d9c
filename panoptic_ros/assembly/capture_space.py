"""The space that a rig covers: bystanders beyond it are not reported.

A person in the fields of view of two cameras alone, where four or more look at one place, stands outside of
what the rig was set up for: behind another camera, or at the far wall. (One whom two views see although more
could is inside.)
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Camera

Array = np.ndarray

FEW_CAMERAS = 3  # where no more look at one place, the rig covers whatever two cameras see
INSIDE = 0.5  # share of the joints that must lie in a camera's image
DEPTHS = np.geomspace(0.5, 16.0, 21)  # m, along optical axes, where places are tried
ONE_PLACE = 0.05  # m, cameras that are closer together see a person from one side


def needed_views(wanted: int, cameras: Sequence[Camera]) -> int:
    """Fields of view in which a person must be; cameras that look elsewhere do not count."""
    most = most_overlap(cameras, wanted + FEW_CAMERAS)
    return 2 if most <= FEW_CAMERAS else max(2, min(wanted, most))


def most_overlap(cameras: Sequence[Camera], enough: int) -> int:
    """How many cameras look at one place from different sides, at most; stops counting at `enough`.

    Places are tried along the optical axes.
    """
    centres = np.array([camera.centre for camera in cameras])
    near = np.linalg.norm(centres[:, None] - centres[None], axis=-1) < ONE_PLACE
    distinct = [cameras[k] for k in range(len(cameras)) if not near[k, :k].any()]
    most = 0
    for camera in distinct:
        places = camera.centre + DEPTHS[:, None] * camera.cam_from_world.rotation[2]
        count = np.sum([other.sees(places) for other in distinct], axis=0)
        most = max(most, int(count.max()))
        if most >= enough:
            break
    return most


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
