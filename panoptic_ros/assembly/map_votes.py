"""Joints at the votes of the score maps, where the detections carry maps.

A pose net's joint is the best cell of one view, and that cell may be another person's wrist, or the wrist of
the other side. The maps hold more: the soft vote of all views about a node (voting, `refine_nodes`) weighs
every cell and lies 5 to 15 % closer to the joint; and where the views' 2D people disagree, a node with
many votes close to where the joint should be is the better choice. Joints that no map shows keep their
triangulated position.
"""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import ProposalSet, SkeletonModel

Array = np.ndarray

CHOICE_SIGMA = 0.07  # m, by which joints differ from where they should be
FARTHEST = 0.6  # m, no node beyond is looked at
WORST_DISTANCE = 3.0  # half squared deviation beyond which it says no more, from where it should be
WORST_MOVE = 2.0  # and from where it was triangulated
OWN_VOTE = 0.1  # of a triangulated joint without a node
NODE_VIEWS = 2  # that support a node
BONE_SIGMA, BONE_SHARE = 0.03, 0.1  # m and share of the length, by which the sides differ
WORST_BONE = 36.0  # squared deviation beyond which a bone says no more
_NEVER = 1e3


def chosen_nodes(
    positions: Array, expected: Array, item: ProposalSet, gate: float, skeleton: SkeletonModel
) -> Array:
    """The node (P, J) of each joint, -1 = none: it stays where it was triangulated.

    Votes against distance from where the joint should be and from where it was triangulated (truncated:
    people move, views err) and against bones that differ from those of the other side: log(vote) less half of
    the squared deviations is to be most in sum over the people, and a node belongs to one person. Where
    nothing is expected, the joint should be where it was triangulated.

    Args:
        positions: (P, J, 3) m, as triangulated; NaN = missing.
        expected: (P, J, 3) m, NaN = no idea.
        gate: m, nodes so near to the triangulated joint need no second view.
    """
    chosen = np.full(positions.shape[:2], -1, np.int64)
    if not len(item.nodes) or not len(positions):
        return chosen
    for joint in np.intersect1d(np.unique(item.node_joints), _mapped_joints(item)):
        nodes = np.flatnonzero((item.node_joints == joint) & (item.node_scores > 0.0))
        here, there = positions[:, joint], expected[:, joint]
        guided = np.isfinite(there[:, 0])
        there = np.where(guided[:, None], there, here)
        away = np.linalg.norm(item.nodes[nodes] - there[:, None], axis=-1)  # (P, N)
        moved = np.linalg.norm(item.nodes[nodes] - here[:, None], axis=-1)
        strong = item.node_views[nodes] >= NODE_VIEWS
        allowed = (moved <= gate) | (strong & (away <= FARTHEST))  # False for NaN
        if _is_clear(allowed, moved <= gate, item.node_scores[nodes]):
            chosen[:, joint] = nodes[allowed.argmax(axis=1)]
            continue
        places = np.concatenate([np.tile(item.nodes[nodes], (len(here), 1, 1)), here[:, None]], axis=1)
        strange = bone_differences(places, positions, int(joint), skeleton)
        cost = _cost(away, item.node_scores[nodes]) + strange[:, :-1]
        cost += np.nan_to_num(np.minimum(0.5 * (moved / CHOICE_SIGMA) ** 2, WORST_MOVE))
        cost[~allowed] = _NEVER
        stay = _cost(np.nan_to_num(np.linalg.norm(here - there, axis=-1)), OWN_VOTE) + strange[:, -1]
        own = np.full((len(here), len(here)), _NEVER)
        np.fill_diagonal(own, stay)
        people, columns = linear_sum_assignment(np.concatenate([cost, own], axis=1))
        taken = (columns < len(nodes)) & (cost[people, np.minimum(columns, len(nodes) - 1)] < _NEVER)
        chosen[people[taken], joint] = nodes[columns[taken]]
    return chosen


def _is_clear(allowed: Array, near: Array, votes: Array) -> bool:
    """Whether everybody has one node that is allowed (P, N), at hand, with votes, and nobody else's."""
    alone = (allowed.sum(axis=1) == 1).all() and (allowed.sum(axis=0) <= 1).all()
    return bool(alone and (allowed & near & (votes > OWN_VOTE)).any(axis=1).all())


def bone_differences(places: Array, positions: Array, joint: int, skeleton: SkeletonModel) -> Array:
    """Half squared deviations (P, N) of the bones of a joint from those of the other side, summed.

    Args:
        places: (P, N, 3) m, where the joint could be. positions: (P, J, 3) m, all others; NaN = missing.
    """
    ends, mirror = _neighbours(skeleton, joint)
    return sum_differences(np.ascontiguousarray(places), np.ascontiguousarray(positions), joint, ends, mirror)


@lru_cache(maxsize=1024)
def _neighbours(skeleton: SkeletonModel, joint: int) -> tuple[Array, Array]:
    """Joints that bones connect with a joint and whose bones have another side, and the mirror (J,)."""
    mirror = np.array(skeleton.mirror, np.int64)
    ends = [b if a == joint else a for a, b in skeleton.bones if joint in (a, b)]
    return np.array([e for e in ends if mirror[e] != e or mirror[joint] != joint], np.int64), mirror


@njit(cache=True, error_model="numpy")
def sum_differences(places, positions, joint, ends, mirror):  # type: ignore[no-untyped-def]
    """The loops of `bone_differences`, over the bones to the joints `ends`."""
    people, count = places.shape[:2]
    total = np.zeros((people, count))
    for p in range(people):
        for n in range(count):
            for end in ends:
                start = places[p, n] if mirror[joint] == joint else positions[p, mirror[joint]]
                length = other = 0.0
                for i in range(3):
                    length += (places[p, n, i] - positions[p, end, i]) ** 2
                    other += (start[i] - positions[p, mirror[end], i]) ** 2
                length, other = np.sqrt(length), np.sqrt(other)
                square = ((length - other) / (BONE_SIGMA + BONE_SHARE * min(length, other))) ** 2
                if np.isfinite(square):
                    total[p, n] += 0.5 * min(square, WORST_BONE)
    return total


def _cost(distance: Array, vote: Array | float) -> Array:
    return np.minimum(0.5 * (distance / CHOICE_SIGMA) ** 2, WORST_DISTANCE) - np.log(vote)


def _mapped_joints(item: ProposalSet) -> Array:
    """Joints that the maps of at least two views show."""
    views = [np.unique(view.maps.joints) for view in item.detections.views if view.maps is not None]
    joints, counts = np.unique(np.concatenate([np.zeros(0, np.int32), *views]), return_counts=True)
    return joints[counts >= 2]
