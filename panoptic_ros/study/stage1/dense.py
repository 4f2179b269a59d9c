"""Baseline of the exact search: eq. 1 of Joo et al. 2017 at every voxel, and its local maxima."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain.of_all import selected
from panoptic_ros.kernels import njit
from panoptic_ros.voting.proposals import NodeCriteria, NodeProposals
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.volume import Volume
from panoptic_ros.voting.votes import COVERED, LANES, SIZE, place, score, see, strides

Array = np.ndarray
BLOCK_VALUES = 4_000_000  # limit of votes in memory at a time


def dense_nodes(scene: VoteScene, volume: Volume, wanted: NodeCriteria) -> NodeProposals:
    """Return the nodes that `exact.maxima` also finds; work in slabs, so that memory stays bounded."""
    nx, ny, nz = volume.shape
    joint_count = scene.map_start.shape[1]
    thick = max(1, BLOCK_VALUES // max(joint_count * ny * nz, 1))
    found = [(np.zeros((0, 4), np.int64), np.zeros(0), np.zeros(0, np.int64))]
    for begin in range(0, nx, thick):
        low, high = max(begin - 1, 0), min(begin + thick + 1, nx)
        first = np.array(volume.lower) + (low, 0, 0)
        slab = Volume(tuple(first), tuple(first + (high - low, ny, nz)), volume.side)
        votes, support = vote_block(scene, slab, wanted.view_threshold)
        rank = np.where(support >= wanted.min_views, votes, -1.0)
        mine = np.zeros(votes.shape, bool)
        mine[:, begin - low : min(begin + thick, nx) - low] = True
        at = np.argwhere(mine & (rank > wanted.threshold))
        at = at[is_maximum(rank, at)]
        found.append((at + (0, *first), votes[tuple(at.T)], support[tuple(at.T)]))
    at, votes, support = (np.concatenate(parts) for parts in zip(*found))
    order = np.lexsort(at.T[::-1])
    return selected(NodeProposals(volume.centres(at[:, 1:]), at[:, 0], votes, support), order)


def is_maximum(rank: Array, at: Array) -> Array:
    """Return which voxels are local maxima (N,).

    Args:
        rank: votes (J, nx, ny, nz).
        at: indices (N, 4) of the voxels to test. Among equal neighbours, the first in index order is the
            maximum.
    """
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


@njit(cache=True, error_model="numpy", nogil=True)
def vote_block(scene, volume, view_threshold):
    """Compute votes and supporting views (J, nx, ny, nz) at the centres of all voxels of a volume."""
    (x0, y0, z0), (x1, y1, z1), side = volume
    shape = scene.map_start.shape[1], x1 - x0, y1 - y0, z1 - z0
    votes, support, lanes = np.zeros(shape), np.zeros(shape, np.int64), np.zeros(SIZE)
    covering = np.zeros(LANES)
    for line in range(shape[1] * shape[2]):
        p, q = line // shape[2], line % shape[2]
        for s in range(0, shape[3], LANES):
            count = min(LANES, shape[3] - s)
            for c in range(LANES):
                place(lanes, c, (x0 + p + 0.5) * side, (y0 + q + 0.5) * side, (z0 + s + c + 0.5) * side)
            covering[:] = 0.0
            for v in range(len(scene.cameras)):
                see(scene.cameras, scene.limits, v, lanes)
                around = strides(scene.cameras[v])
                for c in range(count):
                    covering[c] += lanes[COVERED + c]
                    for j in range(shape[0] if lanes[COVERED + c] > 0.0 else 0):
                        value = score(scene, v, j, around, lanes, c)
                        votes[j, p, q, s + c] += value
                        support[j, p, q, s + c] += value > view_threshold
            for c in range(count):
                votes[:, p, q, s + c] /= max(covering[c], 1.0)
    return votes, support
