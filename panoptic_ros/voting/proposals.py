"""Node proposals as arrays, the demands on them, and the removal of near duplicates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray


class NodeCriteria(NamedTuple):
    """Demands on a node.

    Args:
        threshold: Its vote must be higher.
        min_views: Least number of supporting views.
        view_threshold: Score above which a view supports a node.
    """

    threshold: float
    min_views: int
    view_threshold: float


class NodeProposals(NamedTuple):
    """Node proposals.

    Args:
        points: (N, 3) m.
        joints: (N,) joint of each node.
        votes: (N,) votes.
        support: (N,) number of supporting views.
    """

    points: Array
    joints: Array
    votes: Array
    support: Array


def no_nodes() -> NodeProposals:
    """Return an empty instance."""
    nothing = np.zeros(0, np.int64)
    return NodeProposals(np.zeros((0, 3)), nothing, np.zeros(0), nothing)


def distinct(nodes: Array, joints: Array, votes: Array, distance: float) -> Array:
    """Return indices of the nodes to keep: among close nodes of one joint, the one with most votes.

    Args:
        distance: m, within which two nodes are close.
    """
    order = np.lexsort([*nodes.T, -votes, joints])
    return np.sort(order[_unrivalled(nodes[order], joints[order], distance)])


@njit(cache=True, error_model="numpy", nogil=True)
def _unrivalled(nodes, joints, distance):
    """Return which (N,) nodes, sorted by joint and votes, are not close to a better one that stays."""
    kept = np.ones(len(nodes), np.bool_)
    for k in range(len(nodes)):
        i = k - 1
        while kept[k] and i >= 0 and joints[i] == joints[k]:
            x, y, z = nodes[i, 0] - nodes[k, 0], nodes[i, 1] - nodes[k, 1], nodes[i, 2] - nodes[k, 2]
            kept[k] = not (kept[i] and x * x + y * y + z * z < distance * distance)
            i -= 1
    return kept
