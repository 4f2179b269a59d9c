"""Working volume: the range of voxels that voting uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError

Array = np.ndarray
EVERYWHERE = 1 << 19  # voxels from the origin along each axis


class Volume(NamedTuple):
    """Voxels lower <= index < upper; the centre of voxel i is at (i + 0.5) * side, m, in the world."""

    lower: tuple[int, int, int]
    upper: tuple[int, int, int]
    side: float

    @classmethod
    def everywhere(cls, side: float) -> Volume:
        """Return the largest volume whose voxels can be numbered."""
        return cls((-EVERYWHERE,) * 3, (EVERYWHERE,) * 3, side)

    @classmethod
    def between(cls, bounds: Sequence[float], side: float) -> Volume:
        """Return the voxels that touch the box of least x, y, z and largest x, y, z, m.

        Raises:
            ConfigError: if `bounds` is not a box.
        """
        if len(bounds) != 6 or not all(a < b for a, b in zip(bounds[:3], bounds[3:])):
            raise ConfigError(
                f"volume = {list(bounds)} is not a box; give least x, y, z and then largest x, y, z in metres"
            )
        x0, y0, z0 = (int(np.floor(a / side + 1e-9)) for a in bounds[:3])
        x1, y1, z1 = (int(np.ceil(b / side - 1e-9)) for b in bounds[3:])
        return cls((x0, y0, z0), (x1, y1, z1), side)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the number of voxels along each axis."""
        (x0, y0, z0), (x1, y1, z1) = self.lower, self.upper
        return x1 - x0, y1 - y0, z1 - z0

    def contains(self, points: Array) -> Array:
        """Return which points (N, 3) m are in voxels of the volume (N,)."""
        voxels = np.floor(points / self.side)
        inside: Array = np.all((voxels >= self.lower) & (voxels < self.upper), axis=-1)
        return inside

    def centres(self, voxels: Array) -> Array:
        """Return the centres (N, 3) m of voxels (N, 3)."""
        return (voxels + 0.5) * self.side


def volume_of_rig(rig: Rig, side: float, reach: float = 2.0) -> Volume:
    """Return the box round all points near the cameras that at least two of them see.

    The points are on a grid of 0.25 m. The grid covers the cameras and their mirror images about the point
    that they look at, extended by `reach` m.
    """
    centres = np.array([camera.centre for camera in rig.cameras])
    axes = np.array([camera.cam_from_world.rotation[2] for camera in rig.cameras])
    aside = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    ahead = centres + 4.0 * axes  # small weight, for cameras with parallel axes
    normal = aside.sum(0) + 0.01 * len(rig) * np.eye(3)
    focus = np.linalg.solve(normal, np.einsum("cij,cj->i", aside, centres) + 0.01 * ahead.sum(0))
    half = np.abs(centres - focus).max(axis=0) + reach
    grid = np.stack(np.meshgrid(*(np.arange(-h, h + 0.25, 0.25) for h in half), indexing="ij"), -1)
    points = focus + grid.reshape(-1, 3)
    seen = np.zeros(len(points), np.int64)
    for camera in rig.cameras:
        seen += camera.sees(points)
    both = points[seen >= min(2, len(rig))]
    if not len(both):
        both = focus[None]
    return Volume.between([*(both.min(0) - 0.25), *(both.max(0) + 0.25)], side)
