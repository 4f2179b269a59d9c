"""Relative poses of two cameras from the people that both see: essential matrices over pairs of tracklets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.essential import (
    epipolar_residuals,
    fitted_essential,
    parallax,
    relative_pose,
)
from panoptic_ros.calibration.people.sightings import JointSightings
from panoptic_ros.domain.bone_shares import Bones, log_scale
from panoptic_ros.geometry import ProjectionStack, Rigid, triangulate_linear

Array = np.ndarray
GATE_PX = 4.0  # px, residual of an inlier of an essential matrix
FEWEST_INSTANTS, FEWEST_JOINTS = 8, 60  # common instants and joints of two tracklets that are compared
SAMPLE = 300  # joints of one hypothesis
MOST_TRIES = 8  # pairs of tracklets that give a hypothesis
CHANCE = 0.35  # share of inliers of wrong pairs of people, upper limit
REFITS = 2
REFINED = 2000  # joints of a refit


class TrackletMatch(NamedTuple):
    """Pair of tracklets that show the same person, with its score: instants times the surplus of inliers."""

    first: int
    second: int
    score: float


class CameraLink(NamedTuple):
    """Relative pose of two cameras.

    Args:
        pose: Second camera from first camera, m.
        matches: Tracklets of the same people.
        support: Sum of the scores times the sine of the median angle between rays.
    """

    pose: Rigid
    matches: list[TrackletMatch]
    support: float


class _Common(NamedTuple):
    """Common joints of all pairs of tracklets of two cameras.

    Args:
        pairs: (P, 2) tracklets.
        owner: (M,) pair of each joint. first, second: (M, 2) normalised points.
        counts: (P,) joints. instants: (P,) common instants.
    """

    pairs: Array
    owner: Array
    first: Array
    second: Array
    counts: Array
    instants: Array


def common_joints(seen: JointSightings, a: int, b: int) -> _Common | None:
    """Return the common joints of the tracklets of cameras a and b; None if no pair has enough."""
    pairs: list[tuple[int, int]] = []
    instants: list[int] = []
    owner, first, second = [], [], []
    good = np.isfinite(seen.plane).all(axis=-1)
    for n in np.flatnonzero(seen.cameras == a):
        for m in np.flatnonzero(seen.cameras == b):
            both = seen.seen[n] & seen.seen[m]
            if both.sum() < FEWEST_INSTANTS:
                continue
            use = good[n] & good[m] & both[:, None]
            if use.sum() < FEWEST_JOINTS:
                continue
            owner.append(np.full(int(use.sum()), len(pairs)))
            first.append(seen.plane[n][use])
            second.append(seen.plane[m][use])
            pairs.append((int(n), int(m)))
            instants.append(int(both.sum()))
    if not pairs:
        return None
    return _Common(
        np.array(pairs),
        np.concatenate(owner),
        np.concatenate(first),
        np.concatenate(second),
        np.bincount(np.concatenate(owner)),
        np.array(instants),
    )


def matches_of(common: _Common, essential: Array, gate: float, seen: JointSightings) -> list[TrackletMatch]:
    """Return the pairs of tracklets that an essential matrix explains, best first, each instant once.

    Args:
        gate: Residual of an inlier, in units of the normalised plane.
    """
    inlier = epipolar_residuals(essential, common.first, common.second) < gate
    share = np.bincount(common.owner, weights=inlier, minlength=len(common.pairs)) / common.counts
    scores = (share - CHANCE) * common.instants
    chosen: list[TrackletMatch] = []
    for k in np.argsort(-scores, kind="stable"):
        if scores[k] <= 0.0:
            break
        n, m = (int(v) for v in common.pairs[k])
        if not any(_rivals(seen, n, m, other) for other in chosen):
            chosen.append(TrackletMatch(n, m, float(scores[k])))
    return chosen


def _rivals(seen: JointSightings, n: int, m: int, other: TrackletMatch) -> bool:
    """Return whether a pair of tracklets and a match give one tracklet to two people at one time."""
    if other.first == n:
        return bool((seen.seen[m] & seen.seen[other.second]).any())
    return other.second == m and bool((seen.seen[n] & seen.seen[other.first]).any())


def link_cameras(seen: JointSightings, a: int, b: int, focal: float, bones: Bones) -> CameraLink | None:
    """Return the relative pose of cameras a and b; None if no essential matrix explains people of both.

    Args:
        focal: px, mean of both cameras.
    """
    common = common_joints(seen, a, b)
    if common is None:
        return None
    gate = GATE_PX / focal
    best: tuple[float, Array, list[TrackletMatch]] | None = None
    for k in np.argsort(-common.counts, kind="stable")[:MOST_TRIES]:
        essential = _fitted(common, np.flatnonzero(common.owner == k), SAMPLE, gate)
        if essential is None:
            continue
        matches = matches_of(common, essential, gate, seen)
        score = sum(match.score for match in matches)
        if matches and (best is None or score > best[0]):
            best = (score, essential, matches)
    for _ in range(REFITS):
        if best is None:
            return None
        essential = _fitted(common, np.flatnonzero(_of_matches(common, best[2])), REFINED, gate)
        if essential is None:
            break
        matches = matches_of(common, essential, gate, seen)
        score = sum(match.score for match in matches)
        if score <= best[0]:
            break
        best = (score, essential, matches)
    return _link(common, best[1], best[2], gate, seen, bones) if best else None


def _of_matches(common: _Common, matches: Sequence[TrackletMatch]) -> Array:
    """Return a mask (M,) of the joints of matches."""
    chosen = {(match.first, match.second) for match in matches}
    use = np.array([(int(n), int(m)) in chosen for n, m in common.pairs])
    mask: Array = use[common.owner]
    return mask


def _fitted(common: _Common, joints: Array, most: int, gate: float) -> Array | None:
    """Return the essential matrix (3, 3) of at most `most` of the joints by RANSAC; None if it has none."""
    chosen = joints[np.unique(np.linspace(0, len(joints) - 1, most).astype(int))]
    return fitted_essential(common.first[chosen], common.second[chosen], gate)


def _link(
    common: _Common,
    essential: Array,
    matches: list[TrackletMatch],
    gate: float,
    seen: JointSightings,
    bones: Bones,
) -> CameraLink | None:
    """Return the metric pose of an essential matrix."""
    use = _of_matches(common, matches)
    use &= epipolar_residuals(essential, common.first, common.second) < gate
    if use.sum() < FEWEST_JOINTS:
        return None
    first, second = common.first[use], common.second[use]
    pose = relative_pose(essential, first, second)
    logs = [log_scale(_triangulated(seen, match, pose), bones) for match in matches]
    weights = np.array([match.score for match in matches])
    known = np.isfinite(logs)
    if not known.any():
        return None
    scale = float(np.exp(np.average(np.array(logs)[known], weights=weights[known])))
    support = float(weights.sum() * parallax(pose, first, second))
    return CameraLink(Rigid(pose.rotation, scale * pose.translation), matches, support)


def _triangulated(seen: JointSightings, match: TrackletMatch, pose: Rigid) -> Array:
    """Return the joints (K, J, 3) of a match in the frame of the first camera; NaN: not in both views."""
    plane = np.stack([seen.plane[match.first], seen.plane[match.second]], axis=2)
    shape = plane.shape[:2]
    stack = ProjectionStack(
        np.stack([np.eye(3), pose.rotation]), np.stack([np.zeros(3), pose.translation]), np.ones(2)
    )
    flat = plane.reshape(-1, 2, 2)
    weights = np.isfinite(flat).all(axis=-1).astype(float)
    return triangulate_linear(stack, flat, weights).reshape(*shape, 3)
