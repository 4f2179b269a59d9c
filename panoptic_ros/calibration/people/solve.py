"""Calibration of cameras with known intrinsics from people who walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.bundle import (
    PLAIN,
    Adjustment,
    CameraStates,
    adjust,
    covariance_of,
    residuals_of,
)
from panoptic_ros.calibration.essential import essential_of
from panoptic_ros.calibration.free_points import with_gauge
from panoptic_ros.calibration.people.excerpts import excerpt_of
from panoptic_ros.calibration.people.free_joints import (
    FreeJoints,
    Sides,
    adjusted,
    free_joints,
    kept_joints,
    repetition,
)
from panoptic_ros.calibration.people.identities import identities_of
from panoptic_ros.calibration.people.pairs import (
    GATE_PX,
    CameraLink,
    TrackletMatch,
    common_joints,
    link_cameras,
    matches_of,
)
from panoptic_ros.calibration.people.sightings import JointSightings, sightings_at
from panoptic_ros.calibration.people.tracklets import Tracklet, link_camera
from panoptic_ros.calibration.projection import CAMERA, OFFSET, POSE
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import OUTLIER, CalibratedRig
from panoptic_ros.calibration.target_poses import intrinsics_of, spanning_tree
from panoptic_ros.domain import SkeletonModel, ViewDetections
from panoptic_ros.domain.bone_shares import Bones, bones_of
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.stage import Progress

Array = np.ndarray
# joints of panoptic19 without a side, and with one; a face is seen from one side only
JOINTS = ("Neck", "BodyCenter")
LIMB_JOINTS = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
_ARM = len(LIMB_JOINTS) // 2
SIDES = Sides(
    np.array([*range(len(JOINTS)), *range(2 + 2 * _ARM, 2 + 4 * _ARM), *range(2, 2 + 2 * _ARM)]),
    np.array([-1, -1, *([0] * _ARM + [1] * _ARM) * 2]),
)
ROUNDS = 3  # rounds of the adjustment, each with noise and motion from the residuals of the last
PASSES = (
    2  # passes of people, instants and adjustment: offsets and identities of one are the start of the next
)


class CalibratedPeople(NamedTuple):
    """Calibration from people.

    Args:
        rig: Solution in the frame of the first camera, with lengths for people of mean stature.
        joints: Free joints, without outliers. people: (B,) person of each.
        bones: Bones of the skeleton.
    """

    rig: CalibratedRig
    joints: FreeJoints
    instants: Array
    bones: Bones


def used_joints(skeleton: SkeletonModel) -> Array:
    """Return the joints of panoptic19 that a calibration uses."""
    names = [*JOINTS, *(side + name for side in "lr" for name in LIMB_JOINTS)]
    return np.array([skeleton.joint(name) for name in names])


def calibrate_people(
    cameras: Sequence[CameraInput],
    views: Sequence[ViewDetections],
    skeleton: SkeletonModel,
    progress: Progress,
    clocks: bool = True,
) -> CalibratedPeople:
    """Return the calibration of cameras from the 2D poses of people.

    Args:
        cameras: Cameras with known lenses.
        views: 2D poses of all cameras, in the joints of panoptic19.
        clocks: Estimate a clock offset per camera.

    Raises:
        CalibrationError: if the people do not determine the cameras.
    """
    joints = used_joints(skeleton)
    bones = bones_of(skeleton, joints)
    start_ns = min(view.stamp_ns for view in views)
    tracklets: list[Tracklet] = []
    for c, camera in enumerate(cameras):
        progress(0.3 * c / len(cameras), f"people of camera {camera.name}")
        own = [view for view in views if view.camera == camera.name]
        lens = intrinsics_of(_lens_of(camera), camera.model.fisheye)
        tracklets += link_camera(c, own, start_ns, joints, lens)
    blind = [camera.name for c, camera in enumerate(cameras) if not any(own.camera == c for own in tracklets)]
    if blind:
        more = len(blind) > 1
        raise CalibrationError(
            f"camera{'s' * more} {', '.join(blind)}: nobody is seen for long enough; let people walk in "
            f"{'their' if more else 'its'} view, or leave the camera{'s' * more} out"
        )
    excerpt = excerpt_of(tracklets, len(cameras))
    states = _states(cameras)
    sparse = sightings_at(excerpt.tracklets, excerpt.sparse, states.offsets)
    links = _links(cameras, sparse, bones, progress)
    supported = {pair: (link.pose, 1 + int(1e3 * link.support)) for pair, link in links.items()}
    poses, missing = spanning_tree(len(cameras), supported)
    if missing:
        raise CalibrationError(_unlinked(cameras, missing))
    states = _placed(states, [pose for pose in poses if pose is not None])
    people = identities_of(sparse, [match for link in links.values() for match in link.matches])
    joints_found, state = free_joints(sparse, people, states)
    joints_found, state = adjusted(joints_found, state, ROUNDS, SIDES)
    if clocks:
        state = replace(state, cameras=_with_clocks(state.cameras))
    for k in range(PASSES):
        progress(0.8 + 0.2 * k / PASSES, "adjustment")
        sparse = sightings_at(excerpt.tracklets, excerpt.sparse, state.cameras.offsets)
        people = identities_of(sparse, _matches(cameras, sparse, state.cameras))
        if (people < 0).all():
            raise CalibrationError(
                "no two cameras agree on a person; check that the intrinsics are those of these cameras"
            )
        dense = sightings_at(excerpt.tracklets, excerpt.dense, state.cameras.offsets)
        joints_found, state = free_joints(dense, people, state.cameras)
        joints_found, state = adjusted(joints_found, state, ROUNDS, SIDES)
    supports = {pair: round(sum(m.score for m in link.matches)) for pair, link in links.items()}
    rig, joints_found = _finished(cameras, joints_found, state, supports)
    return CalibratedPeople(rig, joints_found, excerpt.dense, bones)


def _lens_of(camera: CameraInput) -> Array:
    assert camera.known is not None
    return camera.known[0]


def _states(cameras: Sequence[CameraInput]) -> CameraStates:
    """Return the cameras at the origin with fixed lenses and free poses, but for the first."""
    count = len(cameras)
    lenses = np.stack([_lens_of(camera) for camera in cameras])
    free = np.zeros((count, CAMERA), bool)
    free[1:, :POSE] = True
    return CameraStates(
        lenses,
        np.array([camera.model.fisheye for camera in cameras]),
        np.tile(np.eye(3), (count, 1, 1)),
        np.zeros((count, 3)),
        np.zeros(count),
        free,
        lenses.copy(),
        np.zeros((count, OFFSET - POSE, OFFSET - POSE)),
        np.zeros(count),
    )


def _links(
    cameras: Sequence[CameraInput], seen: JointSightings, bones: Bones, progress: Progress
) -> dict[tuple[int, int], CameraLink]:
    """Return the relative poses of all pairs of cameras that see the same people."""
    pairs = [(a, b) for b in range(len(cameras)) for a in range(b)]
    found = {}
    for k, (a, b) in enumerate(pairs):
        progress(0.3 + 0.5 * k / len(pairs), f"cameras {cameras[a].name} and {cameras[b].name}")
        focal = float(np.mean([_lens_of(cameras[c])[:2].mean() for c in (a, b)]))
        link = link_cameras(seen, a, b, focal, bones)
        if link is not None:
            found[a, b] = link
    return found


def _placed(states: CameraStates, poses: Sequence[Rigid]) -> CameraStates:
    """Return the cameras at their poses, with one free length fixed."""
    translations = np.stack([pose.translation for pose in poses])
    rotations = np.stack([pose.rotation for pose in poses])
    return with_gauge(replace(states, rotations=rotations, translations=translations))


def _with_clocks(states: CameraStates) -> CameraStates:
    """Return the cameras with free clock offsets, but for the first."""
    free = states.free.copy()
    free[1:, OFFSET] = True
    return replace(states, free=free)


def _matches(
    cameras: Sequence[CameraInput], seen: JointSightings, states: CameraStates
) -> list[TrackletMatch]:
    """Return the tracklets of all pairs of cameras that the poses of the cameras explain."""
    poses = [Rigid(turn, move) for turn, move in zip(states.rotations, states.translations)]
    found: list[TrackletMatch] = []
    for b in range(len(cameras)):
        for a in range(b):
            common = common_joints(seen, a, b)
            if common is not None:
                essential = essential_of(poses[b].compose(poses[a].inverse()))
                gate = GATE_PX / float(states.lenses[[a, b], :2].mean())
                found += matches_of(common, essential, gate, seen)
    return found


def _finished(
    cameras: Sequence[CameraInput], joints: FreeJoints, state: Adjustment, links: dict[tuple[int, int], int]
) -> tuple[CalibratedRig, FreeJoints]:
    """Return the result with its covariance, after outliers are left out."""
    seen = joints.seen
    normal = (residuals_of(seen, state) ** 2).sum(axis=1) / seen.variances
    good = normal < 2.0 * OUTLIER**2
    outliers = np.bincount(seen.cameras[~good], minlength=len(cameras))
    joints, state = kept_joints(joints, state, good)
    seen = joints.seen
    state = adjust(seen, state, PLAIN)
    seen = seen._replace(variances=seen.variances * repetition(joints, state))
    try:
        covariance, index = covariance_of(seen, state)
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the people do not determine the cameras; let them walk through all views"
        ) from None
    own = seen.cameras[seen.views]
    squares = (residuals_of(seen, state) ** 2).sum(axis=1)
    noise = np.array([np.sqrt(0.5 * np.median(squares[own == c])) for c in range(len(cameras))])
    rig = CalibratedRig(tuple(cameras), (), seen, state, covariance, index, noise, links, outliers)
    return rig, joints._replace(seen=seen)


def _unlinked(cameras: Sequence[CameraInput], missing: Sequence[int]) -> str:
    names, more = ", ".join(cameras[k].name for k in missing), len(missing) > 1
    return (
        f"camera{'s' * more} {names} never see{'s' * (not more)} the same people for long enough as "
        f"{cameras[0].name} or a camera linked to it; let people walk for 5 s where both see them whole, or "
        f"leave the camera{'s' * more} out"
    )
