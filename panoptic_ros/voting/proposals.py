"""Node proposals as arrays, what they must satisfy, and which of them are near duplicates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray


class Demands(NamedTuple):
    """What a node needs: a vote above `threshold`, and `min_views` views with more than `view_threshold`."""

    threshold: float
    min_views: int
    view_threshold: float


class Nodes(NamedTuple):
    """Node proposals: points (N, 3) m, joints (N,), votes (N,), supporting views (N,)."""

    points: Array
    joints: Array
    votes: Array
    support: Array


def no_nodes() -> Nodes:
    """Nothing."""
    nothing = np.zeros(0, np.int64)
    return Nodes(np.zeros((0, 3)), nothing, np.zeros(0), nothing)


def distinct(nodes: Array, joints: Array, votes: Array, distance: float) -> Array:
    """Indices of nodes to keep: of those of one joint within a distance, the one with most votes."""
    order = np.lexsort([*nodes.T, -votes, joints])
    return np.sort(order[_unrivalled(nodes[order], joints[order], distance)])


@njit(cache=True, error_model="numpy", nogil=True)
def _unrivalled(nodes, joints, distance):
    """Which (N,) nodes, in the order of joint and votes, are not close to a better one that stays."""
    kept = np.ones(len(nodes), np.bool_)
    for k in range(len(nodes)):
        i = k - 1
        while kept[k] and i >= 0 and joints[i] == joints[k]:
            x, y, z = nodes[i, 0] - nodes[k, 0], nodes[i, 1] - nodes[k, 1], nodes[i, 2] - nodes[k, 2]
            kept[k] = not (kept[i] and x * x + y * y + z * z < distance * distance)
            i -= 1
    return kept
