"""Capture space of a rig: where enough cameras look, so that people there are no bystanders.

If four or more cameras look at one place, a person in the fields of view of only two cameras is a bystander.
Bystanders are behind another camera, or at the far wall. (A person whom two views show although more could is
inside.) This applies to new people. Tracked people stay until no view shows them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Camera

Array = np.ndarray

CAPTURE_VIEWS = 3  # usual number of fields of view that must contain a new person
FEW_CAMERAS = 3  # if no more cameras look at one place, two cameras define the capture space
INSIDE = 0.5  # share of the joints that must project into a camera's image
DEPTHS = np.geomspace(0.5, 16.0, 21)  # m, depths of tested places along optical axes
ONE_PLACE = 0.05  # m, cameras closer together see a person from one side


def needed_views(wanted: int, cameras: Sequence[Camera]) -> int:
    """Return the number of fields of view that must contain a person.

    Cameras that look elsewhere are ignored.

    Args:
        wanted: number where enough cameras look at one place.
    """
    most = most_overlap(cameras, wanted + FEW_CAMERAS)
    return 2 if most <= FEW_CAMERAS else max(2, min(wanted, most))


def most_overlap(cameras: Sequence[Camera], enough: int) -> int:
    """Return the largest number of cameras that look at one place from different sides.

    Places along the optical axes are tested. The count stops at `enough`.
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
    """Return a mask (P,) of people who stand where at least `needed` cameras look.

    Args:
        positions: (P, J, 3) m, world, NaN = missing.
        supporting: (P,) number of views that show the person. People with enough of them pass without a test.
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
