"""Joints from 3D node proposals where the 2D people say too little.

Score maps keep what a detector's list of people loses: a joint that a person lacks in all but one view, or
two views that disagree. Voting finds it as a node; a node near the place where the joint should be is
then the measurement.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import ProposalSet

Array = np.ndarray

NODE_VIEWS = 2  # that support a node


def has_maps(item: ProposalSet) -> bool:
    """Whether the nodes say more than the 2D people that they came with."""
    return len(item.nodes) > 0 and any(view.maps is not None for view in item.detections.views)


def take_nodes(item: ProposalSet, expected: Array, weak: Array, gate: float) -> Array:
    """The node for each weak joint, closest pairs first, every node once.

    Args:
        expected: (P, J, 3) m, where the joints are or should be, NaN = nowhere.
        weak: (P, J) joints that may take one. gate: m, largest distance.

    Returns:
        (P, J) index of the node, -1 = none.
    """
    chosen = np.full(weak.shape, -1, np.int64)
    good = item.node_views >= NODE_VIEWS
    for joint in range(weak.shape[1]):
        nodes = np.flatnonzero((item.node_joints == joint) & good)
        people = np.flatnonzero(weak[:, joint] & np.isfinite(expected[:, joint, 0]))
        if not len(nodes) or not len(people):
            continue
        gaps = np.linalg.norm(expected[people, joint][:, None] - item.nodes[nodes][None], axis=-1)
        for index in np.argsort(gaps, axis=None, kind="stable"):
            i, k = np.unravel_index(index, gaps.shape)
            if gaps[i, k] > gate:
                break
            if chosen[people[i], joint] < 0 and nodes[k] not in chosen[:, joint]:
                chosen[people[i], joint] = nodes[k]
    return chosen
