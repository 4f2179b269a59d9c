"""Poses of a planar target in one camera, and the relative poses of cameras that see it together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.projection import FISHEYE_TERMS
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
FEWEST_POINTS = 4  # points of a planar target that determine a pose
FLAT_M = 1e-6  # m, extent across their longest direction below which points are on a line
LEVER = 1.0  # m, distance at which a rotation counts like a translation
MOST_INSTANTS = 20  # common instants of two cameras, evenly spaced, that give their relative pose
SAME = 0.1  # m, distance between relative poses of two cameras that agree


def intrinsics_of(lens: Array, fisheye: bool) -> Intrinsics:
    """Return the intrinsics of a row (12,) of `CameraStates.lenses`."""
    fx, fy, cx, cy = lens[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    terms = lens[4 : 4 + FISHEYE_TERMS] if fisheye else lens[4:]
    return Intrinsics(matrix, terms, "fisheye" if fisheye else "brown")


def poses_of(
    views: Sequence[TargetView], points: Array, intrinsics: Sequence[Intrinsics]
) -> list[list[Rigid]]:
    """Return, for each view, the one or two poses, camera from target, that explain it; the better one first.

    A planar target far away has two poses of nearly equal residuals (Collins and Bartoli 2014, IPPE).

    Args:
        points: (N, 3) m, points of the target. intrinsics: Lenses of all cameras.
    """
    found: list[list[Rigid]] = [[] for _ in views]
    for camera, own in enumerate(intrinsics):
        numbers = [k for k, view in enumerate(views) if view.camera == camera]
        if not numbers:
            continue
        plane = own.undistort(
            np.concatenate([views[k].pixels for k in numbers])
        )  # at once, because it iterates
        ends = np.cumsum([len(views[k].numbers) for k in numbers])
        for k, pixels in zip(numbers, np.split(plane, ends[:-1])):
            found[k] = _poses(pixels, points[views[k].numbers])
    return found


def _poses(plane: Array, points: Array) -> list[Rigid]:
    """Return the poses that explain points (N, 3) at positions (N, 2) in the plane at 1 m."""
    good = np.isfinite(plane).all(axis=1)
    if good.sum() < FEWEST_POINTS:
        return []
    own = points[good]
    centre = own.mean(axis=0)
    _, extents, across = np.linalg.svd(own - centre, full_matrices=False)
    if extents[1] < FLAT_M:
        return []
    if np.linalg.det(across) < 0.0:
        across[2] = -across[2]
    flat = (own - centre) @ across.T
    flat[:, 2] = 0.0
    try:
        count, turns, moves, _ = cv2.solvePnPGeneric(
            flat, plane[good], np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    found = []
    for turn, move in zip(turns[:count], moves[:count]):
        rotation = cv2.Rodrigues(turn)[0] @ across
        translation = move.reshape(3) - rotation @ centre
        if np.isfinite(rotation).all() and np.isfinite(translation).all():
            found.append(Rigid(rotation, translation))
    return found


class PoseTable(NamedTuple):
    """Candidates of the pose of a target in each view, padded with copies of the first.

    Args:
        rotations: (V, K, 3, 3), translations: (V, K, 3) m, camera from target.
        known: (V,) whether a view has a candidate.
    """

    rotations: Array
    translations: Array
    known: Array


def pose_table(poses: Sequence[Sequence[Rigid]]) -> PoseTable:
    """Return the candidates of all views as arrays."""
    most = max((len(own) for own in poses), default=0)
    padded = [[*own, *([own[0]] * (most - len(own)))] if own else [Rigid.identity()] * most for own in poses]
    return PoseTable(
        np.array([[pose.rotation for pose in own] for own in padded]),
        np.array([[pose.translation for pose in own] for own in padded]),
        np.array([len(own) > 0 for own in poses]),
    )


def _distances(turns: Array, moves: Array, others: Array, others_moves: Array) -> Array:
    """Return the distances (N, M) m of poses (N, 3, 3), (N, 3) m to others: rotations count `LEVER` times."""
    cosines = 0.5 * (turns.reshape(-1, 9) @ others.reshape(-1, 9).T - 1.0)
    apart = np.linalg.norm(moves[:, None] - others_moves[None], axis=2)
    distances: Array = LEVER * np.arccos(np.clip(cosines, -1.0, 1.0)) + apart
    return distances


def relative_poses(
    views: Sequence[TargetView], poses: Sequence[Sequence[Rigid]]
) -> dict[tuple[int, int], tuple[Rigid, int]]:
    """Return, for pairs of cameras with common instants, the pose second from first and its support.

    The pose is the medoid of the candidates of at most `MOST_INSTANTS` instants: the one with the least sum
    of truncated distances to the others. One candidate of each instant is right. A mean would mix them.
    """
    table = pose_table(poses)
    at: dict[int, list[int]] = defaultdict(list)
    for k, view in enumerate(views):
        if table.known[k]:
            at[view.instant].append(k)
    common: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for own in at.values():
        for a in own:
            for b in own:
                if views[a].camera < views[b].camera:
                    common[views[a].camera, views[b].camera].append((a, b))
    return {pair: _medoid(table, np.array(instants)) for pair, instants in common.items()}


def _medoid(table: PoseTable, common: Array) -> tuple[Rigid, int]:
    """Return the relative pose of two cameras and its support, given views (N, 2) at common instants."""
    a, b = common.T
    turns = np.einsum("nqij,npkj->npqik", table.rotations[b], table.rotations[a])
    moves = table.translations[b][:, None] - np.einsum("npqij,npj->npqi", turns, table.translations[a])
    turns, moves = turns.reshape(len(a), -1, 3, 3), moves.reshape(len(a), -1, 3)
    chosen = np.unique(np.linspace(0, len(a) - 1, MOST_INSTANTS).astype(int))
    few, few_moves = turns[chosen].reshape(-1, 3, 3), moves[chosen].reshape(-1, 3)
    apart = np.minimum(_distances(few, few_moves, few, few_moves), SAME)
    best = int(np.argmin(apart.reshape(len(few), len(chosen), -1).min(axis=2).sum(axis=1)))
    every = _distances(few[best, None], few_moves[best, None], turns.reshape(-1, 3, 3), moves.reshape(-1, 3))
    support = int((every.reshape(len(a), -1).min(axis=1) < SAME).sum())
    return Rigid(few[best], few_moves[best]), support


def spanning_tree(
    count: int, links: Mapping[tuple[int, int], tuple[Rigid, int]]
) -> tuple[list[Rigid | None], list[int]]:
    """Return the pose of each of `count` cameras from the first, along the links of greatest support.

    Returns:
        poses: camera from camera 0; None = not linked. missing: indices of these cameras.
    """
    poses: list[Rigid | None] = [Rigid.identity(), *([None] * (count - 1))]
    while True:
        open_links = [
            (support, pair, pose)
            for pair, (pose, support) in links.items()
            if support > 0 and (poses[pair[0]] is None) != (poses[pair[1]] is None)
        ]
        if not open_links:
            break
        _, (a, b), pose = max(open_links, key=lambda link: link[0])
        known = poses[a]
        if known is not None:
            poses[b] = pose.compose(known)
        else:
            other = poses[b]
            assert other is not None
            poses[a] = pose.inverse().compose(other)
    return poses, [k for k, pose in enumerate(poses) if pose is None]
