"""Walls of simulated scenes: upright boxes on the floor, through which nothing is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Occluders

Array = np.ndarray


@dataclass(frozen=True)
class Wall:
    """A box along the axes of the world: size (x, y, z) m, and the middle of its foot (x, y) m."""

    size: tuple[float, float, float]
    place: tuple[float, float] = (0.0, 0.0)

    @property
    def centre(self) -> Array:
        """(3,) m."""
        return np.array([*self.place, 0.5 * self.size[2]])


def behind_walls(centres: Array, joints: Array, walls: Sequence[Wall]) -> Array:
    """Which joints (C, P, J) a wall hides from the cameras; joints (C, P, J, 3) m, centres (C, 3) m.

    A line of sight meets a box where it is between all three pairs of its sides at once.
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
    """The walls as a rig knows them; None if there are none."""
    if not walls:
        return None
    return Occluders.joined(Occluders.box(np.array(w.size), np.eye(3), w.centre) for w in walls)
