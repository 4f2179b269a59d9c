"""Opaque walls of simulated scenes: upright boxes on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Occluders

Array = np.ndarray


@dataclass(frozen=True)
class Wall:
    """Axis-aligned box on the floor with size (x, y, z) m and the centre (x, y) m of its base."""

    size: tuple[float, float, float]
    place: tuple[float, float] = (0.0, 0.0)

    @property
    def centre(self) -> Array:
        """Return the centre of the box (3,) m."""
        return np.array([*self.place, 0.5 * self.size[2]])


def behind_walls(centres: Array, joints: Array, walls: Sequence[Wall]) -> Array:
    """Return a mask (C, P, J) of joints that a wall hides from the cameras.

    A line of sight hits a box where it lies between all three pairs of opposite faces at once.

    Args:
        centres: Camera centres (C, 3) m.
        joints: Joints (C, P, J, 3) m.
    """
    origin = centres[:, None, None]
    direction = joints - origin
    direction = np.where(direction == 0.0, 1e-12, direction)
    hidden = np.zeros(joints.shape[:-1], bool)
    for wall in walls:
        half = 0.5 * np.array(wall.size)
        ends = [(wall.centre + side * half - origin) / direction for side in (-1.0, 1.0)]
        enter, leave = np.minimum(*ends).max(axis=-1), np.maximum(*ends).min(axis=-1)
        hidden |= (enter < leave) & (enter < 1.0) & (leave > 0.0)
    return hidden


def occluders_of(walls: Sequence[Wall]) -> Occluders | None:
    """Return the walls as occluders of a rig, or None without walls."""
    if not walls:
        return None
    return Occluders.joined(Occluders.box(np.array(w.size), np.eye(3), w.centre) for w in walls)
