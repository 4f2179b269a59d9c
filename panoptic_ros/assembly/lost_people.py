"""People without 2D poses, from voted nodes that no known person explains.

The person head of a detector may fail although the score maps still show every joint, for example for large
people or people in a heap. Such a person is a set of nodes that three or more views show, and that bones of
human length connect. The dynamic program of the paper (5.3) joins these nodes. Votes replace its part scores,
because parts need 2D poses. The final solve has no 2D joints for these people, so they stay at their nodes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from panoptic_ros.assembly.dynamic_programming import PartTree
from panoptic_ros.domain import ProposalSet, SkeletonModel
from panoptic_ros.domain.of_all import joined
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import JointPredictions, PersonCandidates, SolvedJoints

Array = np.ndarray

MIN_VIEWS = 3  # minimum number of views of a node; two views of an empty place can agree by chance
MIN_SHARE = 0.5  # minimum share of joints that nodes show
MIN_VOTE = 0.3  # smallest mean vote of the joints. Joints that most views show exceed it, others reach 0.2
EXPLAINED = 0.15  # m, nodes nearer to a known person's joint, or its mirror joint, are explained
LENGTH_SHARE = 0.25  # relative standard deviation of bone lengths between people
SKIP_WEIGHT = 0.5  # weight of a part that skips a joint
MAX_BONE = 0.9  # m, longest bone of a person
LEAST_SCORE = 0.01  # smallest score of a part
SPREAD = 0.03  # m, standard deviation of the positions, as for people with a prediction


def with_lost_people(
    item: ProposalSet, found: PersonCandidates, solved: SolvedJoints, skeleton: SkeletonModel
) -> tuple[PersonCandidates, SolvedJoints]:
    """Return the candidates and their solution with lost people appended.

    Lost people have no 2D poses, and their joints are at nodes.
    """
    places = lost_people(item, solved.positions, skeleton)
    if not len(places):
        return found, solved
    (count, joints), views = places.shape[:2], found.member.shape[1]
    guide = JointPredictions.of_nobody_known(count, joints, SPREAD)._replace(positions=places)
    source, nobody = np.tile(np.arange(joints), (count, views, 1)), np.full((count, views), -1)
    lost = PersonCandidates(nobody, source, guide, nobody[:, 0], places)
    nothing = SolvedJoints.nothing(count, joints, views)
    return joined(found, lost), joined(solved, nothing)


def lost_people(item: ProposalSet, known: Array, skeleton: SkeletonModel) -> Array:
    """Return joints (P, J, 3) m of people among the nodes that known people (K, J, 3) m do not explain."""
    mirror = np.array(skeleton.mirror, np.int64)
    free = ~explained(item.nodes, item.node_joints, np.ascontiguousarray(known), mirror)
    free &= item.node_views >= MIN_VIEWS
    needed = MIN_SHARE * (len(skeleton) - len(skeleton.derived))
    people: list[Array] = []
    while np.count_nonzero(np.bincount(item.node_joints[free])) >= needed:
        nodes = _with_derived(item, np.flatnonzero(free), skeleton)
        parts = _with_parts(item, nodes, known, skeleton)
        _, chosen = PartTree(parts, skeleton, SKIP_WEIGHT).best()
        place = np.where((chosen >= 0)[:, None], parts.nodes[chosen], np.nan)
        own = np.ones(len(chosen), bool)
        own[[joint for joint, _ in skeleton.derived]] = False
        own &= chosen >= 0
        if own.sum() < needed or parts.node_scores[chosen[own]].mean() < MIN_VOTE:
            break
        people.append(place)
        free &= ~explained(item.nodes, item.node_joints, place[None], mirror)
    return np.stack(people) if people else np.empty((0, len(skeleton), 3))


@njit(cache=True, error_model="numpy")
def explained(nodes, joints, known, mirror):
    """Return a mask (N,) of nodes near the same joint of a known person, or near its mirror joint.

    Args:
        nodes: (N, 3) m, world.
        joints: (N,) joint of each node.
        known: (P, J, 3) m, world, joints of the known people, NaN = missing.
        mirror: (J,) joint on the other side.
    """
    near = np.zeros(len(nodes), np.bool_)
    for n in range(len(nodes)):
        own, other = joints[n], mirror[joints[n]]
        for p in range(len(known)):
            gap = _distance(nodes[n], known[p, own])
            near[n] |= gap < EXPLAINED or _distance(nodes[n], known[p, other]) < EXPLAINED  # False for NaN
    return near


@njit(cache=True, error_model="numpy")
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


def _with_derived(
    item: ProposalSet, rows: Array, skeleton: SkeletonModel
) -> tuple[Array, Array, Array, Array]:
    """Return the nodes `rows`, but for a derived joint all means of two nodes that could be this joint.

    Returns:
        positions: (N, 3) m.
        joints: (N,).
        votes: (N,).
        views: (N,) number of views.
    """
    kept = rows[~np.isin(item.node_joints[rows], [joint for joint, _ in skeleton.derived])]
    nodes, joints = [item.nodes[kept]], [item.node_joints[kept]]
    votes, views = [item.node_scores[kept]], [item.node_views[kept]]
    for joint, parts in skeleton.derived:
        if len(parts) != 2:
            continue
        a, b = (kept[item.node_joints[kept] == part] for part in parts)
        a, b = np.repeat(a, len(b)), np.tile(b, len(a))
        close = np.linalg.norm(item.nodes[a] - item.nodes[b], axis=1) <= MAX_BONE
        a, b = a[close], b[close]
        nodes.append(0.5 * (item.nodes[a] + item.nodes[b]))
        joints.append(np.full(len(a), joint, item.node_joints.dtype))
        votes.append(np.minimum(item.node_scores[a], item.node_scores[b]))
        views.append(np.minimum(item.node_views[a], item.node_views[b]))
    return np.concatenate(nodes), np.concatenate(joints), np.concatenate(votes), np.concatenate(views)


def _with_parts(
    item: ProposalSet,
    found: tuple[Array, Array, Array, Array],
    known: Array,
    skeleton: SkeletonModel,
) -> ProposalSet:
    """Return proposals with nodes of `_with_derived`, and with parts between all nodes that may form a bone.

    Votes and lengths determine the scores of the parts.

    Args:
        found: Result of `_with_derived`.
        known: (K, J, 3) m, people whose bones define usual lengths, NaN = missing.
    """
    nodes, joints, votes, views = found
    kinds = _kinds_of_parts(skeleton)
    parts, bones, scores = likely_parts(nodes, joints, votes, kinds, typical_lengths(known, kinds), MAX_BONE)
    return replace(
        item,
        nodes=nodes,
        node_joints=joints,
        node_scores=votes,
        node_views=views,
        parts=parts,
        part_bones=bones,
        part_scores=scores,
    )


@cache
def _kinds_of_parts(skeleton: SkeletonModel) -> Array:
    """Return the kinds of parts (K, 3): two joints and their bone; bone -1 = the part skips a joint."""
    parents = skeleton.parents
    kinds = [(a, b, k) for k, (a, b) in enumerate(skeleton.bones)]
    kinds += [(parents[a], b, -1) for a, b in skeleton.bones if parents[a] >= 0]
    top = [child for parent, child in skeleton.bones if parent == skeleton.root]
    kinds += [(a, b, -1) for k, a in enumerate(top) for b in top[k + 1 :]]
    return np.array(kinds, np.int64).reshape(-1, 3)


def typical_lengths(people: Array, kinds: Array) -> Array:
    """Return the median length (K,) m of each kind of part over people (P, J, 3) m.

    It is NaN for kinds that are not bones, and for bones that no person has.
    """
    lengths = np.linalg.norm(people[:, kinds[:, 0]] - people[:, kinds[:, 1]], axis=-1)
    known = (kinds[:, 2] >= 0) & np.isfinite(lengths).any(axis=0)
    typical = np.full(len(kinds), np.nan)
    typical[known] = np.nanmedian(lengths[:, known], axis=0)
    return typical


def likely_parts(
    nodes: Array, joints: Array, votes: Array, kinds: Array, lengths: Array, longest: float
) -> tuple[Array, Array, Array]:
    """Return parts (M, 2), their bones (M,) and their scores (M,).

    The score is the mean vote of both ends, reduced where the length differs from the typical length.

    Args:
        nodes: (N, 3) m.
        joints, votes: (N,) of the nodes.
        kinds: (K, 3), see `_kinds_of_parts`.
        lengths: (K,) m, typical lengths, NaN = unknown.
        longest: m, largest length of a part.
    """
    ends = (joints[:, None] == kinds[:, 0])[:, None] & (joints[:, None] == kinds[:, 1])[None]  # (N, N, K)
    a, b, kind = np.nonzero(ends)
    gaps, typical = np.linalg.norm(nodes[a] - nodes[b], axis=-1), lengths[kind]
    unlike = (gaps - typical) / (LENGTH_SHARE * typical + 0.02)
    scores = 0.5 * (votes[a] + votes[b]) * np.exp(-0.5 * np.nan_to_num(unlike) ** 2)
    good = (gaps <= longest) & (scores > LEAST_SCORE)
    return np.stack([a, b], axis=-1)[good], kinds[kind[good], 2], scores[good]
