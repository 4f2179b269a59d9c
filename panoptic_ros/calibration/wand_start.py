"""Start of the adjustment for a wand: relative poses of cameras with known lenses from essential matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, Targets
from panoptic_ros.calibration.essential import epipolar_residuals, fitted_essential, relative_pose
from panoptic_ros.calibration.rig_start import CameraInput, RigStart, free_cameras
from panoptic_ros.calibration.target_poses import intrinsics_of, pose_table, spanning_tree
from panoptic_ros.calibration.target_views import TargetView, in_order, observations_of
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import ProjectionStack, Rigid, triangulate_linear

Array = np.ndarray
GATE_PX = 4.0  # px, residual of an inlier of an essential matrix
FEWEST = 12  # common instants of two cameras that are linked
LONGEST_ERROR = 0.3  # relative error of the length of a wand beyond which its two views contradict each other


def start_wand(cameras: Sequence[CameraInput], views: Sequence[TargetView], points: Array) -> RigStart:
    """Return the start of the adjustment.

    Args:
        cameras: Cameras with known lenses.
        views: Views that show all markers; the order of markers may be reversed in any of them.
        points: (N, 3) m, markers, the first and the last at the ends.

    Raises:
        CalibrationError: if a lens is unknown, or a camera shares too few instants with the others.
    """
    if blind := [camera.name for camera in cameras if camera.known is None]:
        raise CalibrationError(
            f"a wand needs known lenses: camera{'s' * (len(blind) > 1)} {', '.join(blind)}; give "
            "--intrinsics, e.g. from a board before each camera"
        )
    lenses = np.stack([camera.known[0] for camera in cameras if camera.known is not None])
    plane = [
        intrinsics_of(lenses[view.camera], cameras[view.camera].model.fisheye).undistort(view.pixels)
        for view in views
    ]
    views, plane = _whole(views, plane, len(points))
    at = {(view.camera, view.instant): k for k, view in enumerate(views)}
    links = {}
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            common = [
                (k, at[b, view.instant])
                for k, view in enumerate(views)
                if view.camera == a and (b, view.instant) in at
            ]
            if len(common) >= FEWEST:
                gate = GATE_PX / float(lenses[[a, b], :2].mean())
                found = _relative_pose(
                    np.stack([plane[k] for k, _ in common]),
                    np.stack([plane[m] for _, m in common]),
                    points,
                    gate,
                )
                if found is not None:
                    links[a, b] = found
    placed, missing = spanning_tree(len(cameras), links)
    if missing:
        names = ", ".join(cameras[k].name for k in missing)
        raise CalibrationError(
            f"camera{'s' * (len(missing) > 1)} {names} and {cameras[0].name} are not linked: two cameras "
            f"must see the wand together at {FEWEST} places or more"
        )
    poses = [pose for pose in placed if pose is not None]
    views, targets = _targets(views, plane, poses, points)
    states = replace(
        free_cameras(cameras, list(lenses)),
        rotations=np.stack([pose.rotation for pose in poses]),
        translations=np.stack([pose.translation for pose in poses]),
    )
    first = Targets(
        np.stack([pose.rotation for pose in targets]), np.stack([pose.translation for pose in targets])
    )
    seen = observations_of(views, points, np.ones(len(cameras)))
    supports = {pair: support for pair, (_, support) in links.items()}
    candidates = pose_table([[pose] for pose in targets])
    return RigStart(views, Adjustment(states, first, np.zeros(len(seen.cameras))), candidates, supports)


def _whole(
    views: Sequence[TargetView], plane: Sequence[Array], count: int
) -> tuple[list[TargetView], list[Array]]:
    """Return the views that show all markers, by number, and their positions in the plane at 1 m."""
    use = [k for k, own in enumerate(plane) if len(own) == count and np.isfinite(own).all()]
    order = [np.argsort(views[k].numbers) for k in use]
    return (
        [
            replace(views[k], numbers=views[k].numbers[o], pixels=views[k].pixels[o])
            for k, o in zip(use, order)
        ],
        [plane[k][o] for k, o in zip(use, order)],
    )


def _relative_pose(first: Array, second: Array, points: Array, gate: float) -> tuple[Rigid, int] | None:
    """Return the pose second camera from first and the number of instants that support it.

    The middle of the ends corresponds in any order of the markers. Its essential matrix gives the order of
    each instant, and all markers give the final one. The length of the wand gives the scale.

    Args:
        first, second: (K, N, 2) markers in the plane at 1 m.
    """
    essential = fitted_essential(first[:, [0, -1]].mean(axis=1), second[:, [0, -1]].mean(axis=1), gate)
    if essential is None:
        return None
    for _ in range(2):
        kept = epipolar_residuals(essential, first, second).max(axis=1)
        turned = epipolar_residuals(essential, first, second[:, ::-1]).max(axis=1)
        second = np.where((turned < kept)[:, None, None], second[:, ::-1], second)
        good = np.minimum(kept, turned) < gate
        if good.sum() < FEWEST:
            good = np.argsort(np.minimum(kept, turned))[:FEWEST]
        essential = fitted_essential(first[good].reshape(-1, 2), second[good].reshape(-1, 2), gate)
        if essential is None:
            return None
    pose = relative_pose(essential, first[good].reshape(-1, 2), second[good].reshape(-1, 2))
    placed = _triangulated([Rigid.identity(), pose], np.stack([first, second], axis=2))
    length = np.linalg.norm(placed[:, -1] - placed[:, 0], axis=1)
    true = float(np.linalg.norm(points[-1] - points[0]))
    scale = true / float(np.nanmedian(length))
    support = int((np.abs(scale * length / true - 1.0) < LONGEST_ERROR).sum())
    return Rigid(pose.rotation, scale * pose.translation), support


def _triangulated(poses: Sequence[Rigid], plane: Array) -> Array:
    """Return points (K, N, 3) of positions (K, N, C, 2) in the planes of cameras; NaN = not seen."""
    stack = ProjectionStack(
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.translation for pose in poses]),
        np.ones(len(poses)),
    )
    flat = plane.reshape(-1, len(poses), 2)
    points = triangulate_linear(stack, flat, np.isfinite(flat).all(axis=-1).astype(float))
    return points.reshape(*plane.shape[:2], 3)


def _targets(
    views: Sequence[TargetView], plane: Sequence[Array], poses: Sequence[Rigid], points: Array
) -> tuple[list[TargetView], list[Rigid]]:
    """Return the views, with one order of markers per instant and instants from 0, and the pose per instant.

    Each view takes the order that fits to the first view of its instant. The order of the instant is that of
    the wand; if this looks the same from both ends, the order of the instant before.
    """
    groups: dict[int, list[int]] = {}
    for k in in_order(views):
        groups.setdefault(views[k].instant, []).append(k)
    used: list[TargetView] = []
    targets: list[Rigid] = []
    symmetric, last = _symmetric(points), None
    for own in groups.values():
        if len(own) < 2:
            continue
        markers = np.full((1, len(points), len(poses), 2), np.nan)
        reversed_views = {own[0]: False}
        markers[0, :, views[own[0]].camera] = plane[own[0]]
        for k in own[1:]:
            reversed_views[k] = _reversed(plane[k], views[k].camera, markers, poses, points)
            markers[0, :, views[k].camera] = plane[k][::-1] if reversed_views[k] else plane[k]
        placed = _triangulated(poses, markers)[0]
        if not np.isfinite(placed).all():
            continue
        (pose, miss), (other, other_miss) = _fitted(points, placed), _fitted(points, placed[::-1])
        turned = other_miss < miss
        if symmetric and last is not None:
            turned = bool(np.linalg.norm(placed[::-1] - last) < np.linalg.norm(placed - last))
        last = placed[::-1] if turned else placed
        for k in own:
            pixels = views[k].pixels[::-1] if reversed_views[k] != turned else views[k].pixels
            used.append(replace(views[k], instant=len(targets), pixels=pixels))
        targets.append(other if turned else pose)
    return used, targets


def _symmetric(points: Array) -> bool:
    """Return whether the markers in reversed order have the same distances."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    return bool(np.allclose(apart, apart[::-1, ::-1], rtol=0.05))


def _reversed(own: Array, camera: int, markers: Array, poses: Sequence[Rigid], points: Array) -> bool:
    """Return whether the markers (N, 2) of a view agree better with other views in reversed order.

    The markers are placed as on the wand: without its length, both orders may agree with one other view.
    """
    losses = []
    for turned in (own, own[::-1]):
        tried = markers.copy()
        tried[0, :, camera] = turned
        placed = _triangulated(poses, tried)[0]
        if not np.isfinite(placed).all():
            losses.append(np.inf)
            continue
        forward, backward = _fitted(points, placed), _fitted(points[::-1], placed)
        placed = forward[0].apply(points) if forward[1] <= backward[1] else backward[0].apply(points[::-1])
        loss = 0.0
        for c, own_pose in enumerate(poses):
            if np.isfinite(tried[0, 0, c, 0]):
                seen = own_pose.apply(placed)
                loss += float(np.square(seen[:, :2] / seen[:, 2:] - tried[0, :, c]).sum())
        losses.append(loss)
    return losses[1] < losses[0]


def _fitted(points: Array, placed: Array) -> tuple[Rigid, float]:
    """Return the pose that moves points (N, 3) to placed points (N, 3), and the root mean square miss, m."""
    centre, middle = points.mean(axis=0), placed.mean(axis=0)
    u, _, v = np.linalg.svd((points - centre).T @ (placed - middle))
    turn = v.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(v.T @ u.T))]) @ u.T
    miss = (points - centre) @ turn.T - (placed - middle)
    return Rigid(turn, middle - turn @ centre), float(np.sqrt(np.mean(miss**2)))
