"""Positions below the voxel: the soft-argmax of the vote of eq. 1 about a point."""
from __future__ import annotations

import numpy as np

from panoptic_ros.voting import kernels, soft_kernels
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray
SOFTNESS = 0.05  # vote difference that counts 1/e
BALLS = ((0.12, 0.06), (0.08, 0.04), (0.04, 0.02))  # radius and step of the points looked at, m


def ball(radius: float, step: float) -> Array:
    """The points (3, G) m of a cubic grid about 0 that are not farther from it than `radius`."""
    side = round(radius / step)
    axis = np.arange(-side, side + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return np.ascontiguousarray((grid[(grid**2).sum(1) <= side**2] * step).T)


OFFSETS = tuple(ball(*each) for each in BALLS)


def refine(points: Array, joints: Array, scene: VoteScene) -> tuple[Array, Array]:
    """Move points (N, 3) m for the joints (N,) to the centre of the votes about them.

    The mean weighted by exp((S - S_max) / 0.05) of the votes S of a ball of 12 cm in steps of 6 cm, then
    of one of 8 cm in steps of 4 cm, then of one of 4 cm in steps of 2 cm. Points without any vote
    near them stay where they are.

    Returns:
        points (N, 3) m and their votes (N,).
    """
    moved = move(points, joints, scene)
    votes, _ = kernels.vote_points(scene, np.ascontiguousarray(joints, np.int64), moved, 0.0)
    return moved, votes


def move(points: Array, joints: Array, scene: VoteScene) -> Array:
    """The points (N, 3) m of `refine`."""
    moved = np.ascontiguousarray(points, np.float64)
    which = np.ascontiguousarray(joints, np.int64)
    for offsets in OFFSETS:
        moved = soft_kernels.soft_argmax(scene, which, moved, offsets, SOFTNESS)
    return moved
