"""Part proposals: pairs of nodes that may be a bone, and how well 2D people connect them (5.2)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.voting import kernels
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray


class Bone(NamedTuple):
    """A kind of part: joints, index in `SkeletonModel.bones` (-1 = skips a joint), longest length in m."""

    parent: int
    child: int
    index: int
    length: float


def bones_and_skips(skeleton: SkeletonModel, max_bone: float, max_skip: float | None) -> tuple[Bone, ...]:
    """The bones of a skeleton and, if wanted, the pairs of joints that one missing joint lies between.

    These are grandparents and grandchildren, and the children of the root among each other.
    """
    kinds = [Bone(u, v, k, max_bone) for k, (u, v) in enumerate(skeleton.bones)]
    if max_skip is None:
        return tuple(kinds)
    parents = skeleton.parents
    for _, joint in skeleton.bones:
        grandparent = parents[parents[joint]] if parents[joint] >= 0 else -1
        if grandparent >= 0:
            kinds.append(Bone(grandparent, joint, -1, max_skip))
    top = [child for parent, child in skeleton.bones if parent == skeleton.root]
    kinds += [Bone(a, b, -1, max_skip) for k, a in enumerate(top) for b in top[k + 1 :]]
    return tuple(kinds)


def score_parts(
    scene: VoteScene, nodes: Array, joints: Array, kinds: tuple[Bone, ...], threshold: float
) -> tuple[Array, Array, Array]:
    """Parts between nodes (N, 3) m of the joints (N,), and their connectivity scores.

    Phi = mean over the views that cover both ends of max_i of (h_iu + h_iv) / 2 where both are above the
    threshold, else 0; i runs over the 2D people of the view. Parts without any score are left out.

    Returns:
        parts (M, 2) nodes, bones (M,) index into `SkeletonModel.bones` or -1, scores (M,).
    """
    pairs, bones = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
    of_joint = {joint: np.flatnonzero(joints == joint) for joint in np.unique(joints).tolist()}
    nothing = np.zeros(0, np.int64)
    for kind in kinds:
        u, v = of_joint.get(kind.parent, nothing), of_joint.get(kind.child, nothing)
        lengths = np.linalg.norm(nodes[u][:, None] - nodes[v][None], axis=-1)
        a, b = np.nonzero(lengths <= kind.length)
        pairs.append(np.column_stack([u[a], v[b]]))
        bones.append(np.full(len(a), kind.index))
    parts = np.concatenate(pairs)
    scores, covers = kernels.person_scores(scene, np.ascontiguousarray(joints, np.int64), nodes)
    phi = connectivity(scores, covers, parts, threshold)
    connected = phi > 0.0
    return parts[connected], np.concatenate(bones)[connected], phi[connected]


@njit(cache=True, error_model="numpy", nogil=True)
def connectivity(scores, covers, parts, threshold):
    """Part scores (M,) of parts (M, 2) from h_ij (N, V, P) and the views that cover the nodes (N, V)."""
    result = np.zeros(len(parts))
    _, views, people = scores.shape
    for m in range(len(parts)):
        a, b = parts[m, 0], parts[m, 1]
        total, covering = 0.0, 0
        for v in range(views):
            if not (covers[a, v] and covers[b, v]):
                continue
            covering += 1
            best = 0.0
            for i in range(people):
                if scores[a, v, i] > threshold and scores[b, v, i] > threshold:
                    best = max(best, 0.5 * (scores[a, v, i] + scores[b, v, i]))
            total += best
        if covering:
            result[m] = total / covering
    return result
