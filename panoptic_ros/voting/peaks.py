"""Local maxima of eq. 1 of Joo et al. 2017 over voxels, and what they must satisfy."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Demands(NamedTuple):
    """What a node proposal needs.

    threshold: votes are above it. min_views: so many views support it, with scores above `view_threshold`.
    enough: voxels with fewer supporting views neither count nor suppress others.
    """

    threshold: float
    min_views: int
    view_threshold: float
    enough: int


class Peaks(NamedTuple):
    """Local maxima: joints (N,), voxels (N, 3), votes (N,), supporting views (N,)."""

    joints: Array
    voxels: Array
    votes: Array
    support: Array

    def rows(self, which: Array) -> Peaks:
        """Some of them."""
        return Peaks(*(values[which] for values in self))


def sorted_peaks(peaks: Peaks) -> Peaks:
    """In the order of joint and voxel, without repetitions."""
    _, first = np.unique(order_keys(peaks.joints, peaks.voxels), return_index=True)
    return peaks.rows(first)


def order_keys(joints: Array, voxels: Array) -> Array:
    """Numbers (N,) that are in the order of joints (N,) and then voxels (N, 3), equal where these are."""
    low = voxels.min(axis=0, initial=0)
    size = voxels.max(axis=0, initial=0) - low + 1
    if float(size.prod(dtype=float)) * (joints.max(initial=0) + 1) >= 2.0**62:
        table = np.column_stack([joints, voxels])
        return np.unique(table, axis=0, return_inverse=True)[1].ravel()
    key = joints
    for axis in range(3):
        key = key * size[axis] + voxels[:, axis] - low[axis]
    return key


def no_peaks() -> Peaks:
    """Nothing."""
    nothing = np.zeros(0, np.int64)
    return Peaks(nothing, np.zeros((0, 3), np.int64), np.zeros(0), nothing)
