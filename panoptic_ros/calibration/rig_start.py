"""Start of the joint adjustment: lenses, poses of cameras along their links, poses of the target."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, CameraStates, Observations, Targets, residuals_of
from panoptic_ros.calibration.lens_start import LensModel, one_camera, start_lens
from panoptic_ros.calibration.numbering import alternatives, consistent_numbers
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.target_poses import (
    PoseTable,
    intrinsics_of,
    pose_table,
    poses_of,
    relative_poses,
    spanning_tree,
)
from panoptic_ros.calibration.target_views import TargetView, observations_of
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid

Array = np.ndarray
FEWEST_VIEWS = 3  # views of a camera; fewer determine no lens
BETTER = 0.9  # share of the loss below which another pose of the target replaces its pose
MOST_CANDIDATES = 4  # views of an instant that suggest poses of the target; one of them has a right pose
SCALE = 3.0  # scale of the Cauchy losses, in standard deviations


class CameraInput(NamedTuple):
    """Camera to calibrate.

    Args:
        name: Name of the camera.
        size: (width, height) px.
        model: Lens model.
        known: Lens (12,) and information (12, 12) of an earlier calibration; None = unknown.
    """

    name: str
    size: tuple[int, int]
    model: LensModel = LensModel()
    known: tuple[Array, Array] | None = None


class RigStart(NamedTuple):
    """Start of the adjustment.

    Args:
        views: Views that are used, with instants 0 to B - 1.
        state: Start of all unknowns.
        candidates: Per instant, poses of the target, world from target, that single views suggest.
        links: Number of common instants that support the link of each pair of cameras.
    """

    views: list[TargetView]
    state: Adjustment
    candidates: PoseTable
    links: dict[tuple[int, int], int]


def start_rig(
    cameras: Sequence[CameraInput], views: Sequence[TargetView], points: Array, turns: Sequence[Rigid] = ()
) -> RigStart:
    """Return the start of the adjustment of all cameras.

    Args:
        turns: Motions after which the target looks the same; its points are numbered consistently.

    Raises:
        CalibrationError: if a camera has too few views, or shares none with the others.
    """
    lenses = [_lens(k, camera, views, points) for k, camera in enumerate(cameras)]
    intrinsics = [intrinsics_of(lens, camera.model.fisheye) for lens, camera in zip(lenses, cameras)]
    poses = poses_of(views, points, intrinsics)
    links = relative_poses(views, [alternatives(own, turns) for own in poses])
    placed, missing = spanning_tree(len(cameras), links)
    if missing:
        raise CalibrationError(_unlinked(cameras, missing))
    known = [pose for pose in placed if pose is not None]
    if turns:
        views = consistent_numbers(views, poses, known, points, turns)
        poses = poses_of(views, points, intrinsics)
    states = replace(
        free_cameras(cameras, lenses),
        rotations=np.stack([pose.rotation for pose in known]),
        translations=np.stack([pose.translation for pose in known]),
    )
    instants = sorted({view.instant for view, own in zip(views, poses) if own})
    number = {instant: n for n, instant in enumerate(instants)}
    used = [replace(view, instant=number[view.instant]) for view in views if view.instant in number]
    candidates = _candidates(used, [own for view, own in zip(views, poses) if view.instant in number], known)
    first = Targets(candidates.rotations[:, 0].copy(), candidates.translations[:, 0].copy())
    seen = observations_of(used, points, np.ones(len(cameras)))
    state = Adjustment(states, first, np.zeros(len(seen.cameras)))
    supports = {pair: support for pair, (_, support) in links.items()}
    return RigStart(used, with_best_targets(seen, state, candidates, 1.0), candidates, supports)


def free_cameras(cameras: Sequence[CameraInput], lenses: Sequence[Array]) -> CameraStates:
    """Return cameras at the origin with free lenses, each (12,).

    Poses are free, but for that of the first camera.
    """
    starts = [one_camera(c.size, float(lens[0]), c.model, c.known) for c, lens in zip(cameras, lenses)]
    states = CameraStates(
        *(np.concatenate([getattr(start, name) for start in starts]) for name in CameraStates.__annotations__)
    )
    states.free[1:, :POSE] = True
    return replace(states, lenses=np.stack(lenses))


def _lens(number: int, camera: CameraInput, views: Sequence[TargetView], points: Array) -> Array:
    own = [view for view in views if view.camera == number]
    if len(own) < FEWEST_VIEWS:
        raise CalibrationError(
            f"camera {camera.name} sees the board in {len(own)} images, at least {FEWEST_VIEWS} are needed; "
            "show it the board, or leave the camera out"
        )
    lens = start_lens(own, points, camera.size, camera.model, camera.known)
    if lens is None:
        raise CalibrationError(
            f"camera {camera.name}: no image of the board gives a pose; show it at least 4 points, tilted"
        )
    return lens


def _unlinked(cameras: Sequence[CameraInput], missing: Sequence[int]) -> str:
    names = ", ".join(cameras[k].name for k in missing)
    return (
        f"{'camera' if len(missing) == 1 else 'cameras'} {names} never "
        f"{'sees' if len(missing) == 1 else 'see'} the board together with {cameras[0].name} or a camera "
        "linked to it; hold the board where both see it, or leave them out"
    )


def _candidates(
    views: Sequence[TargetView], poses: Sequence[Sequence[Rigid]], cameras: Sequence[Rigid]
) -> PoseTable:
    """Return the poses of the target of each instant, world from target, by the views with the most points.

    Args:
        poses: Poses by view, camera from target. cameras: Poses, camera from world.
    """
    by_instant: dict[int, list[int]] = defaultdict(list)
    for k in sorted(range(len(views)), key=lambda k: -len(views[k].numbers)):
        if poses[k] and len(by_instant[views[k].instant]) < MOST_CANDIDATES:
            by_instant[views[k].instant].append(k)
    worlds = [pose.inverse() for pose in cameras]
    return pose_table(
        [
            [worlds[views[k].camera].compose(pose) for k in by_instant[instant] for pose in poses[k]]
            for instant in sorted(by_instant)
        ]
    )


def with_best_targets(
    seen: Observations, state: Adjustment, candidates: PoseTable, better: float = BETTER
) -> Adjustment:
    """Return the state with the candidate pose of each target that explains all its views best.

    A view of a planar target can be explained by its mirrored pose. The other views decide.

    Args:
        candidates: Poses of each target, world from target.
        better: Share of the loss of the present pose that a candidate must not exceed.
    """
    best = _losses(seen, state) * better
    rotations, translations = state.targets.rotations.copy(), state.targets.translations.copy()
    for n in range(candidates.rotations.shape[1]):
        poses = Targets(candidates.rotations[:, n].copy(), candidates.translations[:, n].copy())
        losses = _losses(seen, replace(state, targets=poses))
        use = losses < best
        best = np.where(use, losses, best)
        rotations[use], translations[use] = poses.rotations[use], poses.translations[use]
    return replace(state, targets=Targets(rotations, translations))


def _losses(seen: Observations, state: Adjustment) -> Array:
    """Return the sum of the Cauchy losses (B,) of each target."""
    squares = (residuals_of(seen, state) ** 2).sum(axis=1) / seen.variances
    losses = SCALE**2 * np.log1p(squares / SCALE**2)
    return np.bincount(seen.targets[seen.views], weights=losses, minlength=len(seen.firsts) - 1)
