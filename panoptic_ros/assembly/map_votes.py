"""Corrections of joints by the votes of score maps, where the detections contain maps.

The joint of a pose network is the best cell of one view. That cell may show the wrist of another person, or
the wrist of the other side. The maps contain more information. The soft vote of all views about a node
(`voting.soft_vote`) weights every cell, and is 5 to 15 % closer to the joint than the cell of one view. If
the 2D poses of the views disagree, a node with many votes near the expected joint is the better choice.

A vote contains errors that the network makes in all views, and more views do not reduce them. So a vote has a
standard deviation of its own. It counts more where few views show the joint, because the triangulated
position is then less certain. The deviation is larger in the torso: its joints have no point on the surface
that all views could show. Joints that no map shows keep their triangulated position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.assembly.judgement import JointEstimates
from panoptic_ros.domain import ProposalSet, SkeletonModel
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.kernels import njit

Array = np.ndarray

CHOICE_SIGMA = 0.07  # m, standard deviation of nodes about the predicted and the triangulated joint
FARTHEST = 0.3  # m, gate about the prediction; nodes beyond belong to another limb or person
WORST_DISTANCE = 3.0  # truncation of half the squared deviation from the prediction
WORST_MOVE = 2.0  # truncation of half the squared deviation from the triangulated position
OWN_VOTE = 0.1  # assumed vote of a triangulated joint without a node
NODE_VIEWS = 2  # minimum number of views of a node outside the gate
BONE_SIGMA, BONE_SHARE = 0.03, 0.1  # m and share of the length, deviation between both sides
WORST_BONE = 36.0  # truncation of the squared deviation of a bone
CHANCE = 0.2  # votes; with each such increase, the share of wrong nodes falls by a factor of e
WRONG_SIGMA = 0.16  # m, standard deviation of a wrong node: a joint of another limb or person
_NEVER = 1e3


class _NodeAssignmentProblem(NamedTuple):
    """Joints of P people, and the N nodes to choose from.

    Args:
        positions: (P, J, 3) m, triangulated joints, NaN = missing.
        expected: (P, J, 3) m, predicted joints, NaN = none.
        nodes: (N, 3) m.
        joints, votes, views: (N,) of the nodes.
        gate: Nodes nearer to the triangulated joint than this need no second view, m.
    """

    positions: Array
    expected: Array
    nodes: Array
    joints: Array
    votes: Array
    views: Array
    gate: float


def node_doubts(votes: Array) -> Array:
    """Return the variances (N,) m^2 per axis of joints at nodes, because a node may be the wrong one.

    Args:
        votes: (N,) votes of the nodes.
    """
    variances: Array = np.exp(-votes / CHANCE) * WRONG_SIGMA**2
    return variances


class VoteNoise(NamedTuple):
    """Noise of votes.

    Args:
        gate: A node farther from the triangulated joint than this is another place, m.
        near: (J,) m, standard deviation of a vote within the gate, per axis.
        far: Standard deviation of a node beyond the gate, m per axis.
    """

    gate: float
    near: Array
    far: float


def vote_sigmas(skeleton: SkeletonModel, others: float, torso: float) -> Array:
    """Return the standard deviations (J,) m of votes within the gate.

    Args:
        others: m, standard deviation of joints outside the torso.
        torso: m, standard deviation of joints of the torso.
    """
    sigmas = np.full(len(skeleton), others)
    for part in rigid_parts(skeleton):
        if part.name == "torso":
            sigmas[list(part.joints)] = torso
    return sigmas


def move_to_votes(
    joints: JointEstimates, expected: Array, item: ProposalSet, skeleton: SkeletonModel, noise: VoteNoise
) -> None:
    """Move the positions in `joints` towards the votes of the score maps.

    A node within the gate is one more measurement of the position. The covariance stays unchanged, because
    the vote is from the same images. A joint that moves to a node beyond the gate takes all values of the
    node.

    Args:
        expected: (P, J, 3) m, predicted joints, NaN = none.
    """
    chosen = chosen_nodes(joints.positions, expected, item, noise.gate, skeleton)
    p, j = np.nonzero(chosen >= 0)
    nodes = chosen[p, j]
    gaps = item.nodes[nodes] - joints.positions[p, j]
    far = ~(np.linalg.norm(gaps, axis=-1) <= noise.gate)
    own = joints.covariances[p[~far], j[~far]]
    near = (noise.near[j[~far]] ** 2)[:, None, None] * np.eye(3)
    weighed = np.linalg.solve(own + near, gaps[~far, :, None])
    joints.positions[p[~far], j[~far]] += (own @ weighed)[..., 0]
    p, j, nodes = p[far], j[far], nodes[far]
    joints.positions[p, j] = item.nodes[nodes]
    joints.covariances[p, j] = noise.far**2 * np.eye(3)
    joints.scores[p, j], joints.views[p, j] = item.node_scores[nodes], item.node_views[nodes]
    joints.doubts[p, j] = node_doubts(item.node_scores[nodes])


def chosen_nodes(
    positions: Array, expected: Array, item: ProposalSet, gate: float, skeleton: SkeletonModel
) -> Array:
    """Return the node (P, J) of each joint, -1 = none: the joint keeps its triangulated position.

    The choice maximises the sum over the people of log(vote) minus half of the squared deviations. Truncated
    deviations count: from the prediction, from the triangulated position, and of bones from those of the
    other side. A node belongs to one person. The triangulated position replaces a missing prediction.

    Args:
        positions: (P, J, 3) m, triangulated joints, NaN = missing.
        expected: (P, J, 3) m, predicted joints, NaN = none.
        gate: Nodes nearer to the triangulated joint than this need no second view, m.
    """
    chosen = np.full(positions.shape[:2], -1, np.int64)
    if len(item.nodes) and len(positions):
        choice = _NodeAssignmentProblem(
            positions,
            expected,
            item.nodes.copy(),
            item.node_joints,
            item.node_scores,
            item.node_views,
            float(gate),
        )
        bones, mirror = np.array(skeleton.bones, np.int64).reshape(-1, 2), np.array(skeleton.mirror, np.int64)
        for joint in np.flatnonzero(_mapped_joints(item, len(skeleton))):
            own, cost = joint_costs(choice, joint, bones, mirror)
            people, columns = linear_sum_assignment(cost)
            moved = (columns < len(own)) & (cost[people, columns] < _NEVER)
            chosen[people[moved], joint] = own[columns[moved]]
    return chosen


@njit(cache=True, error_model="numpy")
def joint_costs(choice, joint, bones, mirror):
    """Return the nodes (K,) of a joint, and the costs (P, K + P) of each node and of no node (`stay`).

    Args:
        bones: (B, 2) joints at the ends.
        mirror: (J,) joint on the other side.
    """
    positions, expected, nodes, node_joints, votes, views, gate = choice
    own, people = np.flatnonzero((node_joints == joint) & (votes > 0.0)), len(positions)
    count = len(own)
    cost = np.full((people, count + people), _NEVER)
    for p in range(people if count else 0):
        here, there = positions[p, joint], expected[p, joint]
        for k in range(count):
            place = nodes[own[k]]
            moved, away = _distances(place, here, there)
            if _is_allowed(moved, away, views[own[k]], gate):
                strange = difference(place, positions[p], joint, bones, mirror)
                cost[p, k] = _cost(away, votes[own[k]]) + strange
                if np.isfinite(moved):
                    cost[p, k] += min(0.5 * (moved / CHOICE_SIGMA) ** 2, WORST_MOVE)
        _, stay = _distances(here, here, there)
        cost[p, count + p] = _cost(stay if np.isfinite(stay) else 0.0, OWN_VOTE)
        cost[p, count + p] += difference(here, positions[p], joint, bones, mirror)
    return own, cost


@njit(cache=True, error_model="numpy")
def _distances(node, here, there):
    """Return the distances, m, of a node from the triangulated and from the predicted joint.

    Without a prediction, both are from the triangulated joint.
    """
    moved = away = 0.0
    for i in range(3):
        moved += (node[i] - here[i]) ** 2
        away += (node[i] - there[i]) ** 2
    moved = np.sqrt(moved)
    return moved, (np.sqrt(away) if np.isfinite(there[0]) else moved)


@njit(cache=True, error_model="numpy")
def _is_allowed(moved, away, views, gate):
    """Return whether a joint may move to a node; False if the distances of the node are NaN."""
    return moved <= gate or (views >= NODE_VIEWS and away <= FARTHEST)


@njit(cache=True, error_model="numpy")
def _cost(distance, vote):
    return min(0.5 * (distance / CHOICE_SIGMA) ** 2, WORST_DISTANCE) - np.log(vote)


@njit(cache=True, error_model="numpy")
def difference(place, person, joint, bones, mirror):
    """Return the sum of half squared deviations of a joint's bones from the bones of the other side.

    Args:
        place: (3,) m, assumed position of the joint.
        person: (J, 3) m, all other joints, NaN = missing.
        bones: (B, 2) joints at the ends.
        mirror: (J,) joint on the other side.
    """
    total = 0.0
    start = place if mirror[joint] == joint else person[mirror[joint]]
    for b in range(len(bones)):
        end = bones[b, 1] if bones[b, 0] == joint else bones[b, 0]
        if joint not in (bones[b, 0], bones[b, 1]) or (mirror[end] == end and mirror[joint] == joint):
            continue
        length = other = 0.0
        for i in range(3):
            length += (place[i] - person[end, i]) ** 2
            other += (start[i] - person[mirror[end], i]) ** 2
        length, other = np.sqrt(length), np.sqrt(other)
        square = ((length - other) / (BONE_SIGMA + BONE_SHARE * min(length, other))) ** 2
        if np.isfinite(square):
            total += 0.5 * min(square, WORST_BONE)
    return total


def _mapped_joints(item: ProposalSet, joint_count: int) -> Array:
    """Return a mask (J,) of joints that the maps of at least two views contain."""
    shown = np.zeros((len(item.detections.views), joint_count), bool)
    for row, view in zip(shown, item.detections.views):
        if view.maps is not None:
            row[view.maps.joints] = True
    shared: Array = shown.sum(axis=0) >= 2
    return shared
