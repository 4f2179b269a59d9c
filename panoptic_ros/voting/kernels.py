"""The compiled kernel of votes (eq. 1 of Joo et al. 2017) at points."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.voting.lanes import (
    LANES,
    SIZE,
    SUPPORT,
    VOTE,
    add_vote,
    begin_vote,
    end_vote,
    place,
    vote,
)


@njit(cache=True, error_model="numpy", nogil=True)
def vote_points(scene, joints, points, view_threshold):
    """Votes (N,) and supporting views (N,) of points (N, 3) m for the joints (N,); scene: `VoteScene`."""
    votes, support = np.zeros(len(points)), np.zeros(len(points), np.int64)
    lanes, mine = np.zeros(SIZE), np.zeros(LANES, np.int64)
    for first in range(0, len(points), LANES):
        count = min(LANES, len(points) - first)
        for c in range(LANES):
            n = first + min(c, count - 1)
            mine[c] = joints[n]
            place(lanes, c, points[n, 0], points[n, 1], points[n, 2])
        vote(scene, mine, view_threshold, lanes)
        for c in range(count):
            votes[first + c], support[first + c] = lanes[VOTE + c], int(lanes[SUPPORT + c])
    return votes, support


@njit(cache=True, error_model="numpy", nogil=True)
def vote_moving(scene, joints, points, moving, view_threshold):
    """As `vote_points`, of points that each view sees where they are at its own stamp; moving: `Moving`."""
    votes, support = np.zeros(len(points)), np.zeros(len(points), np.int64)
    lanes, mine = np.zeros(SIZE), np.zeros(LANES, np.int64)
    for first in range(0, len(points), LANES):
        count = min(LANES, len(points) - first)
        begin_vote(lanes)
        for v in range(len(scene.cameras)):
            late = moving.delays[v]
            for c in range(LANES):
                n = first + min(c, count - 1)
                mine[c] = joints[n]
                place(
                    lanes, c, points[n, 0] + late * moving.velocities[n, 0],
                    points[n, 1] + late * moving.velocities[n, 1],
                    points[n, 2] + late * moving.velocities[n, 2],
                )  # fmt: skip
            add_vote(scene, v, mine, view_threshold, lanes)
        end_vote(lanes)
        for c in range(count):
            votes[first + c], support[first + c] = lanes[VOTE + c], int(lanes[SUPPORT + c])
    return votes, support
