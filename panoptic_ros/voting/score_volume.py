"""Eq. 1 of Joo et al. 2017 over voxels, and its local maxima: the reference, and the dense search."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.voting import kernels
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.score_field import ViewField
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
BLOCK_VALUES = 4_000_000  # votes that are held in memory at a time
ENOUGH = 2.0  # added to the vote of voxels that enough views support, so that others never suppress them


class Peaks(NamedTuple):
    """Local maxima: joints (N,), voxels (N, 3), votes (N,), supporting views (N,)."""

    joints: Array
    voxels: Array
    votes: Array
    support: Array


def vote_reference(
    fields: Sequence[ViewField],
    cameras: Sequence[Camera],
    joint: int,
    points: Array,
    view_threshold: float = 0.1,
) -> tuple[Array, Array]:
    """Eq. 1 in numpy: votes (N,) of a joint at points (N, 3) m, and numbers of supporting views (N,).

    The mean over the views that see the point: in front of the camera, inside of the image and of the maps,
    and not beyond the view's limit (see `VisibilityLimit`); 0 where no view does. A view supports a point
    if its score is above `view_threshold`.
    """
    total, seeing = np.zeros(len(points)), np.zeros(len(points), np.int64)
    support = np.zeros(len(points), np.int64)
    for field, camera in zip(fields, cameras):
        pixels, ahead = camera.project(points)
        seen = ahead & field.sees(pixels, camera.cam_from_world.apply(points)[:, 2])
        scores = np.where(seen, field.sample(joint, np.where(seen[:, None], pixels, 0.0)), 0.0)
        total += scores
        seeing += seen
        support += scores > view_threshold
    return total / np.maximum(seeing, 1), support


def dense_peaks(
    scene: VoteScene, volume: Volume, threshold: float, view_threshold: float, enough: int
) -> Peaks:
    """All local maxima above the threshold in the volume.

    A voxel is one if none of its 26 neighbours has more votes (nor equally many and comes before it);
    voxels with fewer than `enough` supporting views neither count nor suppress. Works slab by slab, so
    memory stays bounded.
    """
    nx, ny, nz = volume.shape
    joint_count = scene.map_start.shape[1]
    thick = max(1, BLOCK_VALUES // max(joint_count * ny * nz, 1))
    found = [no_peaks()]
    for begin in range(0, nx, thick):
        low, high = max(begin - 1, 0), min(begin + thick + 1, nx)
        first = np.array(volume.lower) + (low, 0, 0)
        votes, support = kernels.vote_block(
            scene, first, (high - low, ny, nz), volume.side, view_threshold
        )
        rank = votes + ENOUGH * (support >= enough)
        mine = slice(begin - low, min(begin + thick, nx) - low)
        wanted = np.zeros(votes.shape, bool)
        wanted[:, mine] = (votes[:, mine] > threshold) & (support[:, mine] >= enough)
        at = np.argwhere(wanted)
        at = at[_is_maximum(rank, at)]
        index = tuple(at.T)
        found.append(Peaks(at[:, 0], at[:, 1:] + first, votes[index], support[index]))
    return sorted_peaks(Peaks(*(np.concatenate(parts) for parts in zip(*found))))


def sorted_peaks(peaks: Peaks) -> Peaks:
    """In the order of joint and voxel, without repetitions."""
    _, first = np.unique(order_keys(peaks.joints, peaks.voxels), return_index=True)
    return Peaks(*(values[first] for values in peaks))


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


def _is_maximum(rank: Array, at: Array) -> Array:
    """Whether the places at (N, 4) of rank (J, nx, ny, nz) are local maxima (N,)."""
    padded = np.pad(rank, ((0, 0), (1, 1), (1, 1), (1, 1)), constant_values=-1.0)
    joint, x, y, z = at.T
    own = rank[joint, x, y, z]
    best = np.ones(len(at), bool)
    for step in np.ndindex(3, 3, 3):
        other = padded[joint, x + step[0], y + step[1], z + step[2]]
        if step < (1, 1, 1):
            best &= other < own
        elif step > (1, 1, 1):
            best &= other <= own
    return best
