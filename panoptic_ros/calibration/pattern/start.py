"""Start of the adjustment for a pattern: a pair of cameras, then one camera after the other by resection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, CameraStates, Observations, adjust
from panoptic_ros.calibration.essential import epipolar_residuals, fitted_essential, parallax, relative_pose
from panoptic_ros.calibration.free_points import points_at, points_seen, with_gauge
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.rig_start import SCALE
from panoptic_ros.calibration.target_poses import intrinsics_of
from panoptic_ros.geometry import ProjectionStack, Rigid, triangulate_robust

Array = np.ndarray
GATE_PX = 4.0  # px, residual of an inlier of an essential matrix
RESECTION_PX = 8.0  # px, of a resection: points and lenses have errors
FEWEST = 12  # common points of two cameras, or known points of a camera, that are linked
LEAST_SHARE = 0.5  # share of inliers of a resection
MOST_PAIRS = 40  # pairs of cameras with the most common points, that are compared as first pair
MOST_STARTS = 3  # first pairs that are tried
START_PX = 2.0  # px, noise with which points are triangulated, and gates them
STEPS = 8  # steps of an adjustment between resections
CHUNK = 500  # points that are triangulated at once, to limit memory


class PatternTable(NamedTuple):
    """Pixels of the pattern.

    Args:
        pixels: (B, C, 2) px, NaN = not seen. plane: (B, C, 2) the same on the planes at 1 m.
        given: (B, C) whether a camera sees a point.
    """

    pixels: Array
    plane: Array
    given: Array


def pattern_table(pixels: Array, states: CameraStates) -> PatternTable:
    """Return the table of pixels (B, C, 2) of cameras with known lenses."""
    plane = np.full(pixels.shape, np.nan)
    for c in range(len(states)):
        own = np.isfinite(pixels[:, c]).all(axis=1)
        lens = intrinsics_of(states.lenses[c], bool(states.fisheye[c]))
        plane[own, c] = lens.undistort(pixels[own, c])
    given = np.isfinite(plane).all(axis=2)
    return PatternTable(pixels, plane, given)


def placed_cameras(table: PatternTable, states: CameraStates) -> list[Rigid | None]:
    """Return the poses of the cameras, from the first of them, with an arbitrary scale; None = not linked."""
    best: dict[int, Rigid] = {}
    for first, second, pose in _first_pairs(table, states):
        found = _grown(table, states, {first: Rigid.identity(), second: pose})
        if len(found) > len(best):
            best = found
        if len(best) == len(states):
            break
    if not best:
        return [Rigid.identity(), *([None] * (len(states) - 1))]
    reference = best[min(best)].inverse()
    return [best[c].compose(reference) if c in best else None for c in range(len(states))]


def _first_pairs(table: PatternTable, states: CameraStates) -> list[tuple[int, int, Rigid]]:
    """Return pairs of cameras with relative poses, best first by inliers times the sine of parallax."""
    common = np.triu(table.given.T.astype(float) @ table.given, 1)
    found = []
    for flat in np.argsort(-common, axis=None, kind="stable")[:MOST_PAIRS]:
        a, b = divmod(int(flat), len(states))
        if common[a, b] < FEWEST:
            break
        both = table.given[:, a] & table.given[:, b]
        first, second = table.plane[both, a], table.plane[both, b]
        gate = GATE_PX / float(states.lenses[[a, b], :2].mean())
        essential = fitted_essential(first, second, gate)
        if essential is None:
            continue
        good = epipolar_residuals(essential, first, second) < gate
        if good.sum() >= FEWEST:
            pose = relative_pose(essential, first[good], second[good])
            found.append((good.sum() * parallax(pose, first[good], second[good]), a, b, pose))
    found.sort(key=lambda pair: -pair[0])
    return [(a, b, pose) for _, a, b, pose in found[:MOST_STARTS]]


def _grown(table: PatternTable, states: CameraStates, placed: dict[int, Rigid]) -> dict[int, Rigid]:
    """Return the poses of all cameras that follow from those of a first pair.

    The camera that sees the most known points comes next. After each doubling of their number, all poses and
    points are adjusted, so that errors do not add up.
    """
    points = _points(table, states, placed, np.arange(len(table.given)))
    adjusted_at = 2
    refused: set[int] = set()
    while True:
        known = np.isfinite(points).all(axis=1)
        counts = (table.given & known[:, None]).sum(axis=0)
        counts[[*placed, *refused]] = 0
        camera = int(np.argmax(counts))
        done = counts[camera] < FEWEST
        if not done:
            pose = _resected(table, states, points, camera)
            if pose is None:
                refused.add(camera)
                continue
            placed = {**placed, camera: pose}
            own = np.flatnonzero(table.given[:, camera])
            points[own] = _points(table, states, placed, own)
        if (done and len(placed) > adjusted_at) or len(placed) >= 2 * adjusted_at:
            adjusted_at = len(placed)
            placed, points = _adjusted(table, states, placed, points)
            refused.clear()
        elif done:
            return placed


def _resected(table: PatternTable, states: CameraStates, points: Array, camera: int) -> Rigid | None:
    """Return the pose of a camera from known points (B, 3); None if they contradict each other."""
    use = table.given[:, camera] & np.isfinite(points).all(axis=1)
    gate = RESECTION_PX / float(states.lenses[camera, :2].mean())
    scale = float(np.linalg.norm(points[use] - points[use].mean(axis=0), axis=1).mean())
    own, plane = points[use] / scale, table.plane[use, camera]
    try:
        found, turn, move, inliers = cv2.solvePnPRansac(
            own, plane, np.eye(3), None, reprojectionError=gate, flags=cv2.SOLVEPNP_AP3P
        )
        if not found or len(inliers) < max(FEWEST, LEAST_SHARE * len(own)):
            return None
        own, plane = own[inliers.reshape(-1)], plane[inliers.reshape(-1)]
        _, turns, moves, _ = cv2.solvePnPGeneric(own, plane, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        poses = [
            cv2.solvePnPRefineLM(own, plane, np.eye(3), None, *start)
            for start in [(turn, move), *zip(turns, moves)]
        ]
        turn, move = min(poses, key=lambda pose: _miss(own, plane, *pose))
    except cv2.error:
        return None
    return Rigid(cv2.Rodrigues(turn)[0], scale * move.reshape(3))


def _miss(points: Array, plane: Array, turn: Array, move: Array) -> float:
    """Return the mean squared residual of a pose on the plane at 1 m; a flat target has two local minima."""
    return float(np.square(cv2.projectPoints(points, turn, move, np.eye(3), None)[0][:, 0] - plane).mean())


def _points(table: PatternTable, states: CameraStates, placed: dict[int, Rigid], which: Array) -> Array:
    """Return the positions (N, 3) of points that placed cameras see; NaN = unknown."""
    order = sorted(placed)
    stack = ProjectionStack(
        np.stack([placed[c].rotation for c in order]),
        np.stack([placed[c].translation for c in order]),
        states.lenses[order, :2].mean(axis=1),
    )
    return triangulated_points(stack, table.plane[which][:, order], START_PX)


def triangulated_points(stack: ProjectionStack, plane: Array, noise_px: float) -> Array:
    """Return the positions (N, 3) of points (N, C, 2) on the planes at 1 m; NaN = fewer than two views."""
    parts = [
        triangulate_robust(stack, part, np.full(part.shape[:2], noise_px)).points
        for part in np.array_split(plane, max(1, -(-len(plane) // CHUNK)))
    ]
    return np.concatenate(parts)


def _adjusted(
    table: PatternTable, states: CameraStates, placed: dict[int, Rigid], points: Array
) -> tuple[dict[int, Rigid], Array]:
    """Return the poses and points after an adjustment with fixed lenses."""
    order = sorted(placed)
    some = CameraStates(*(getattr(states, name)[order] for name in CameraStates.__annotations__))
    free = np.zeros_like(some.free)
    free[1:, :POSE] = True
    some = replace(some, free=free)
    part = PatternTable(table.pixels[:, order], table.plane[:, order], table.given[:, order])
    seen, state, used = started(part, some, [placed[c] for c in order], points)
    state = adjust(seen, state, SCALE, STEPS)
    cameras = state.cameras
    points = np.full(points.shape, np.nan)
    points[used] = state.targets.translations
    poses = zip(order, cameras.rotations, cameras.translations)
    return {c: Rigid(turn, move) for c, turn, move in poses}, points


def started(
    table: PatternTable,
    states: CameraStates,
    poses: Sequence[Rigid],
    points: Array,
    noise_px: float = START_PX,
) -> tuple[Observations, Adjustment, Array]:
    """Return observations and state of the adjustment, and the numbers of the used points.

    Args:
        poses: Poses of all cameras; they are moved to the frame of the first.
        points: (B, 3) positions in the frame of the poses, NaN = unknown.
    """
    reference = poses[0].inverse()
    moved = [pose.compose(reference) for pose in poses]
    used = np.flatnonzero(np.isfinite(points).all(axis=1) & (table.given.sum(axis=1) >= 2))
    target, camera = np.nonzero(table.given[used])
    states = with_gauge(
        replace(
            states,
            rotations=np.stack([pose.rotation for pose in moved]),
            translations=np.stack([pose.translation for pose in moved]),
        )
    )
    seen = points_seen(camera, target, table.pixels[used[target], camera], noise_px**2)
    state = Adjustment(states, points_at(poses[0].apply(points[used])), np.zeros(len(target)))
    return seen, state, used
