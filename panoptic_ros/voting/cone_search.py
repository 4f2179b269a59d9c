"""The exact search: local maxima of eq. 1, found coarse to fine without visiting empty space."""

from __future__ import annotations

import numpy as np

from panoptic_ros.voting.cone_kernels import visit
from panoptic_ros.voting.cones import cones_of
from panoptic_ros.voting.proposals import Demands, Nodes
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
STEPS = sorted(np.ndindex(3, 3, 3), key=lambda step: sum(axis != 1 for axis in step))[1:]  # few axes first


def maxima(scene: VoteScene, volume: Volume, wanted: Demands) -> Nodes:
    """Nodes at the centres of all local maxima, in the order of joint and voxel.

    These are voxels that satisfy the demands, and none of whose 26 neighbours that do has more votes (nor
    equally many and comes before it).
    """
    found = visit(scene, cones_of(scene, wanted.view_threshold), volume, wanted)
    at = found[:, :4].astype(np.int64)
    top = highest(at - (0, *volume.lower), found[:, 5])
    return Nodes(volume.centres(at[:, 1:]), at[:, 0], found[:, 5], found[:, 4].astype(np.int64)).rows(top)


def highest(at: Array, votes: Array) -> Array:
    """Of joints and voxels (N, 4), from 0, which none of the neighbours among them beats, in their order."""
    shape = at.max(axis=0, initial=0) + 3  # nobody is the neighbour of one on the other side
    keys = np.ravel_multi_index(tuple(at.T), shape)
    order = np.argsort(keys)
    keys, votes, left = keys[order], votes[order], np.arange(len(keys))
    for step in STEPS:  # one of the first mostly beats
        move = int(np.dot(np.array(step) - 1, [shape[2] * shape[3], shape[3], 1]))
        other = np.minimum(np.searchsorted(keys, keys[left] + move), len(keys) - 1)
        more = votes[other] - votes[left]
        beaten = (keys[other] == keys[left] + move) & ((more > 0.0) | ((more == 0.0) & (move < 0)))
        left = left[~beaten]
    return order[left]
