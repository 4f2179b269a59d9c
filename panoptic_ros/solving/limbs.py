"""Limbs that a detector may exchange as a whole, left for right, and tests of their sides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.kernels import njit

Array = np.ndarray

ANATOMY_VOTES = 2.0  # views, weight of the nose's position in the vote about exchanged sides
NOSE_AHEAD = 0.08  # m, distance of the nose in front of the shoulders from which the test is certain


class Limbs(NamedTuple):
    """Limbs that a detector may exchange with their counterpart on the other side.

    Args:
        groups: (J,) limb of each joint, -1 = none.
        mirror: (J,) joint on the other side.
        number: Number of limbs.
    """

    groups: Array
    mirror: Array
    number: int


def limbs_of(skeleton: SkeletonModel) -> Limbs:
    """Return the limbs of a skeleton.

    Joints of one side that bones connect form a limb: an arm, a leg, or an eye with an ear. Its counterpart
    on the other side has the same group. A bone between two branching joints (hip to shoulder) would join two
    limbs, so it is cut.
    """
    mirror = skeleton.mirror
    degree = np.bincount(np.array(skeleton.bones).ravel(), minlength=len(skeleton))
    group = np.array([j if mirror[j] != j else -1 for j in range(len(skeleton))])
    for left, right in skeleton.left_right:
        group[[left, right]] = min(left, right)
    for _ in range(len(skeleton)):
        for a, b in skeleton.bones:
            linked = group[a] >= 0 and group[b] >= 0 and mirror[a] != b
            if linked and not (degree[a] > 2 and degree[b] > 2):
                low, high = sorted((group[a], group[b]))
                group[group == high] = low
    names = sorted(set(group[group >= 0].tolist()))
    groups = np.array([names.index(g) if g >= 0 else -1 for g in group], np.int64)
    return Limbs(groups, np.array(mirror, np.int64), len(names))


@njit(cache=True, error_model="numpy")
def exchanged_views(source, observed, groups):
    """Return the number (P, G) of views that see each limb exchanged, minus the number that do not.

    A view counts by the share of the limb's joints that it sees.

    Args:
        source: (P, V, J) joint of the 2D pose that stands for joint j.
        observed: (P, V, J) whether the 2D pose shows that joint.
        groups: (J,) limb of each joint, -1 = none.
    """
    (people, views, joints), count = source.shape, groups.max() + 1
    votes, sizes = np.zeros((people, count)), np.zeros(count)
    for j in range(joints):
        if groups[j] < 0:
            continue
        sizes[groups[j]] += 1.0
        for p in range(people):
            for v in range(views):
                if observed[p, v, j]:
                    votes[p, groups[j]] += -1.0 if source[p, v, j] == j else 1.0
    return votes / np.maximum(sizes, 1.0)


class SideTest:
    """Anatomical test for exchanged sides: the nose is in front of the shoulders.

    Detectors exchange left and right, often for people seen from behind. Where half of the views do so, the
    images alone cannot decide which half is right.
    """

    def __init__(self, skeleton: SkeletonModel, groups: Array):
        self._head = skeleton.head
        self._pairs: list[tuple[int, int, int]] = []  # limb, left and right joint at its upper end
        depth, away = _bones_to(skeleton, skeleton.root), _bones_to(skeleton, skeleton.head)
        for group in range(groups.max(initial=-1) + 1):
            pairs = [pair for pair in skeleton.left_right if groups[pair[0]] == group]
            left, right = min(pairs, key=lambda pair: depth[list(pair)].sum())
            self._pairs.append((group, left, right))
        limbs = [pair for pair in self._pairs if (groups == pair[0]).sum() >= 6]
        limbs.sort(key=lambda pair: int(away[pair[1]]))
        # left and right joints of the shoulders and of the hips
        self.torso = (limbs[0][1:], limbs[1][1:]) if len(limbs) >= 2 else None

    def right_way(self, positions: Array, views: Array | None = None) -> Array:
        """Return a value (P, G) in -1..1 for each limb: 1 = correct sides, -1 = exchanged, 0 = undecided.

        Args:
            positions: (P, J, 3) m, world.
            views: (P, J) number of views behind each joint. Joints of a single view are ignored: a shoulder
                at any position on its ray would turn the torso round.
        """
        if self.torso is None:
            return np.zeros((len(positions), len(self._pairs)))
        if views is not None:
            positions = np.where(views[..., None] >= 2, positions, np.nan)
        sides: Array = sides_of_nose(positions, np.array(self._pairs), np.array(self.torso), self._head)
        return sides

    def of_body(self, positions: Array) -> Array:
        """Return the mean (P,) of `right_way` over the limbs."""
        shares: Array = self.right_way(positions).sum(axis=1) / max(len(self._pairs), 1)
        return shares


@njit(cache=True, error_model="numpy")
def sides_of_nose(positions, pairs, torso, head):
    """Return the values (P, G) of `SideTest.right_way`.

    The forward direction is the cross product of the vectors from right to left and from hips to shoulders.
    The value is the distance of the nose in front of the shoulders in units of NOSE_AHEAD, clipped to -1..1.

    Args:
        positions: (P, J, 3) m, world, NaN = unknown.
        pairs: (G, 3) limb, left and right joint at its upper end.
        torso: (2, 2) left and right shoulder, left and right hip.
        head: Joint of the nose.
    """
    signs = np.zeros((len(positions), len(pairs)))
    up, ahead, across = np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(positions)):
        x = positions[p]
        for k in range(3):
            shoulders = 0.5 * (x[torso[0, 0], k] + x[torso[0, 1], k])
            up[k] = shoulders - 0.5 * (x[torso[1, 0], k] + x[torso[1, 1], k])
            ahead[k] = x[head, k] - shoulders
        for i in range(len(pairs)):
            for k in range(3):
                across[k] = x[pairs[i, 1], k] - x[pairs[i, 2], k]
            along = square = 0.0
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                normal = across[a] * up[b] - across[b] * up[a]
                along += normal * ahead[k]
                square += normal * normal
            front = along / max(np.sqrt(square), 1e-6)
            if np.isfinite(front):
                signs[p, pairs[i, 0]] = min(1.0, max(-1.0, front / NOSE_AHEAD))
    return signs


def _bones_to(skeleton: SkeletonModel, joint: int) -> Array:
    """Return the number of bones (J,) between a joint and every joint."""
    count = np.full(len(skeleton), len(skeleton))
    count[joint] = 0
    for _ in range(len(skeleton)):
        for a, b in skeleton.bones:
            count[[a, b]] = np.minimum(count[[a, b]], count[[b, a]] + 1)
    return count
