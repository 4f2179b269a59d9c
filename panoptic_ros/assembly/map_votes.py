"""Joints moved to the votes of the score maps, where the detections carry maps.

A pose net's joint is the best cell of one view. The maps hold more: the soft vote of all views about a
node (voting, `refine_nodes`) weighs every cell, and lies 5 to 15 % closer to the joint. Joints that no
map shows keep their triangulated position.
"""
from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import ProposalSet

Array = np.ndarray


def moved_to_votes(positions: Array, item: ProposalSet, gate: float) -> Array:
    """Positions (P, J, 3) m with each joint at its own node, if there is one within the gate.

    A node belongs to one person; the sum of distances is least.

    Args:
        positions: NaN = missing; these stay missing.
        gate: m, farthest that a joint is moved.
    """
    if not len(item.nodes):
        return positions
    mapped = _mapped_joints(item)
    result = positions.copy()
    for joint in np.intersect1d(np.unique(item.node_joints), mapped):
        nodes = item.nodes[item.node_joints == joint]
        distances = np.linalg.norm(positions[:, joint, None] - nodes[None], axis=-1)  # (P, N)
        cost = np.where(distances <= gate, distances, 10.0 * gate)  # False for NaN
        people, chosen = linear_sum_assignment(cost)
        near = cost[people, chosen] <= gate
        result[people[near], joint] = nodes[chosen[near]]
    return result


def _mapped_joints(item: ProposalSet) -> Array:
    """Joints that the maps of at least two views show."""
    views = [np.unique(view.maps.joints) for view in item.detections.views if view.maps is not None]
    joints, counts = np.unique(np.concatenate([np.zeros(0, np.int32), *views]), return_counts=True)
    return joints[counts >= 2]
