"""Positions below the voxel: the soft-argmax of the vote of eq. 1 about a point."""
from __future__ import annotations

import numpy as np

from panoptic_ros.voting import kernels, soft_kernels
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.soft_kernels import Moving

Array = np.ndarray
SOFTNESS = 0.05  # vote difference that counts 1/e
RADII = np.array([0.12, 0.08, 0.03])  # m, of the balls of points looked at
ROUNDS = 6  # steps at most for each ball until a proposal stays, wherever its voxel was


def ball(steps: int) -> Array:
    """The points (3, G) of a cubic grid, so many steps from 0 to 1, that are not farther than 1 from 0."""
    axis = np.arange(-steps, steps + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return np.ascontiguousarray((grid[(grid**2).sum(1) <= steps**2] / steps).T)


BALL = ball(2)


def refine(points: Array, joints: Array, scene: VoteScene) -> tuple[Array, Array]:
    """Move points (N, 3) m for the joints (N,) to where the votes about them hold them.

    Steps go to the mean of the votes S of the points of a ball, weighted by exp((S - S_max) / 0.05):
    balls of 12 (where fewer than ten views see the point), 8 and 3 cm, each until the point stays.
    Points without any vote near them stay where they are.

    Returns:
        points (N, 3) m and their votes (N,).
    """
    moved = move(points, joints, scene, ROUNDS)
    votes, _ = kernels.vote_points(scene, np.ascontiguousarray(joints, np.int64), moved, 0.0)
    return moved, votes


def move(
    points: Array, joints: Array, scene: VoteScene, rounds: int = 1, moving: Moving | None = None
) -> Array:
    """The points (N, 3) m of `refine`; one round per ball does where points are close to joints.

    Args:
        moving: how the points move from stamp to stamp of the views; None: they rest.
    """
    starts, which = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(joints, np.int64)
    ball = soft_kernels.Ball(BALL, RADII, rounds, SOFTNESS)
    moved: Array = soft_kernels.move_to_votes(scene, which, starts, moving or at_rest(starts, scene), ball)
    return moved


def at_rest(points: Array, scene: VoteScene) -> Moving:
    """Points (N, 3) that do not move, or views of one instant."""
    return Moving(np.zeros((len(points), 3)), np.zeros(len(scene.cameras)))
