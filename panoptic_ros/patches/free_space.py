"""Joints in free space, in front of what a depth sensor measures, are outliers (Joo et al. 2017, 6.2)."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.domain.parts import Part
from panoptic_ros.patches.depth_maps import DepthMaps, in_front

Array = np.ndarray


def free_joints(
    depth: DepthMaps, parts: tuple[Part, ...], before: TrackedPoseSet, item: TrackedPoseSet, last: Array
) -> Array:
    """Ids and joints (F, 2) of a set that some believed sensor sees through.

    A map of another instant is held against where joints were then, between two sets. Joints of the face lie
    on the surface and tell nothing.

    Args:
        last: those of the set before, which tell no motion.
    """
    row_of = {number: row for row, number in enumerate(before.ids.tolist())}
    rows = np.array([row_of.get(number, -1) for number in item.ids.tolist()], np.int64)
    moved = np.zeros_like(item.positions)
    known = rows >= 0
    moved[known] = np.nan_to_num(item.positions[known] - before.positions[rows[known]])
    own_row = {number: row for row, number in enumerate(item.ids.tolist())}
    for person, joint in last.tolist():
        if person in own_row:
            moved[own_row[person], joint] = 0.0
    free = np.zeros(item.positions.shape[:2], bool)
    for stamp_ns, sensed in depth.near(item.stamp_ns):
        share = (item.stamp_ns - stamp_ns) / (item.stamp_ns - before.stamp_ns)
        places = item.positions - share * moved
        free |= in_front(sensed, places.reshape(-1, 3)).reshape(free.shape)
    free[:, [joint for part in parts if part.name == "head" for joint in part.joints]] = False
    people, joints = np.nonzero(free)
    found: Array = np.stack([item.ids[people], joints], axis=1)
    return found
