"""Joints from 3D node proposals where the 2D people say too little.

A detector's list of people may lack a joint in all but one view, or two views may disagree. The score maps
still show that joint, and voting finds it as a node. A node near the predicted joint is then the measurement.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import ProposalSet
from panoptic_ros.kernels import njit
from panoptic_ros.kernels.order import descending

Array = np.ndarray

NODE_VIEWS = 2  # that support a node
CHANCE = 0.2  # of votes, over which the share of wrong nodes falls by a factor of e
WRONG_SIGMA = 0.16  # m, of a wrong node, which is a joint of another limb, or of a neighbour


def has_maps(item: ProposalSet) -> bool:
    """Whether the nodes say more than the 2D people that they came with."""
    return len(item.nodes) > 0 and any(view.maps is not None for view in item.detections.views)


def node_doubts(votes: Array) -> Array:
    """Variances (N,) m^2 of joints at nodes of these votes (N,) because a node may be the wrong one."""
    variances: Array = np.exp(-votes / CHANCE) * WRONG_SIGMA**2
    return variances


def take_nodes(item: ProposalSet, expected: Array, weak: Array, gate: float) -> Array:
    """The node for each weak joint, closest pairs first, every node once.

    Args:
        expected: (P, J, 3) m, where the joints are or should be, NaN = nowhere.
        weak: (P, J) joints that may take one. gate: m, largest distance.

    Returns:
        (P, J) index of the node, -1 = none.
    """
    closest: Array = closest_nodes(
        item.nodes, item.node_joints, item.node_views, np.ascontiguousarray(expected), weak, float(gate)
    )
    return closest


@njit(cache=True, error_model="numpy")
def closest_nodes(nodes, node_joints, views, expected, weak, gate):
    """The loops of `take_nodes`."""
    chosen = np.full(weak.shape, -1, np.int64)
    people, near = np.empty(len(weak), np.int64), np.empty(len(nodes), np.int64)
    used = np.zeros(len(nodes), np.bool_)
    for joint in range(weak.shape[1]):
        waiting = beside = 0
        for p in range(len(weak)):
            if weak[p, joint] and np.isfinite(expected[p, joint, 0]):
                people[waiting] = p
                waiting += 1
        for n in range(len(nodes)):
            if waiting and node_joints[n] == joint and views[n] >= NODE_VIEWS:
                near[beside] = n
                beside += 1
        nearness = np.empty(waiting * beside)
        for i in range(waiting):
            for k in range(beside):
                square = 0.0
                for axis in range(3):
                    square += (expected[people[i], joint, axis] - nodes[near[k], axis]) ** 2
                nearness[i * beside + k] = -np.sqrt(square)
        for at in descending(nearness):
            p, n = people[at // beside], near[at % beside]
            if nearness[at] < -gate:
                break
            if chosen[p, joint] < 0 and not used[n]:
                chosen[p, joint] = n
                used[n] = True
    return chosen
