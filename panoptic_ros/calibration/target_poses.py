"""Poses of a planar target in one camera, and the relative poses of cameras that see it together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from panoptic_ros.calibration.projection import FISHEYE_TERMS
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import vectors_of

Array = np.ndarray
FEWEST_POINTS = 4  # points of a planar target that determine a pose
LEVER = 1.0  # m, distance at which a rotation counts like a translation
SAME = 0.1  # m, distance between relative poses of two cameras that agree


def intrinsics_of(lens: Array, fisheye: bool) -> Intrinsics:
    """Return the intrinsics of a row (12,) of `CameraStates.lenses`."""
    fx, fy, cx, cy = lens[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    terms = lens[4 : 4 + FISHEYE_TERMS] if fisheye else lens[4:]
    return Intrinsics(matrix, terms, "fisheye" if fisheye else "brown")


def poses_of(view: TargetView, points: Array, intrinsics: Intrinsics) -> list[Rigid]:
    """Return the one or two poses, camera from target, that explain a view; the better one first.

    A planar target far away has two poses of nearly equal residuals (Collins and Bartoli 2014, IPPE).
    """
    plane = intrinsics.undistort(view.pixels)
    good = np.isfinite(plane).all(axis=1)
    if good.sum() < FEWEST_POINTS:
        return []
    own = points[view.numbers[good]]
    centre, across = own.mean(axis=0), np.linalg.svd(own - own.mean(axis=0))[2]
    if np.linalg.det(across) < 0.0:
        across[2] = -across[2]
    flat = (own - centre) @ across.T
    if np.linalg.matrix_rank(flat[:, :2], tol=1e-6) < 2:
        return []
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


def _distances(poses: Sequence[Rigid]) -> Array:
    """Return the distances (N, N) m between poses: of translations, and of rotations times `LEVER`."""
    turns = np.stack([pose.rotation for pose in poses])
    moves = np.stack([pose.translation for pose in poses])
    between = np.ascontiguousarray(np.einsum("aij,bkj->abik", turns, turns).reshape(-1, 3, 3))
    angles = np.linalg.norm(vectors_of(between), axis=1).reshape(len(poses), len(poses))
    distances: Array = LEVER * angles + np.linalg.norm(moves[:, None] - moves[None], axis=2)
    return distances


def relative_poses(
    views: Sequence[TargetView], poses: Sequence[Sequence[Rigid]]
) -> dict[tuple[int, int], tuple[Rigid, int]]:
    """Return, for pairs of cameras with common instants, the pose second from first and its support.

    The pose is the medoid of all candidates: the one with the least sum of truncated distances to the others.
    Each common instant has at most four candidates, and one of them is right. A mean would mix them.
    """
    at: dict[int, list[int]] = defaultdict(list)
    for k, view in enumerate(views):
        if poses[k]:
            at[view.instant].append(k)
    candidates: dict[tuple[int, int], list[list[Rigid]]] = defaultdict(list)
    for own in at.values():
        for a in own:
            for b in own:
                if views[a].camera < views[b].camera:
                    candidates[views[a].camera, views[b].camera].append(
                        [q.compose(p.inverse()) for p in poses[a] for q in poses[b]]
                    )
    found = {}
    for pair, groups in candidates.items():
        every = [pose for group in groups for pose in group]
        first = np.cumsum([0, *(len(group) for group in groups[:-1])])
        nearest = np.minimum.reduceat(np.minimum(_distances(every), SAME), first, axis=1)
        best = int(np.argmin(nearest.sum(axis=1)))
        found[pair] = (every[best], int((nearest[best] < SAME).sum()))
    return found


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
