"""What can be said about the result on a real capture, where there is no truth.

People and their joints, the reprojection error against the detector's 2D people, and how steady
the lengths of bones are. Pure functions on the records of a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import DetectionSet, JointState, Rig, SkeletonModel, TrackedPoseSet

Array = np.ndarray
LIMB_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # ends of joint names, both sides
FARTHEST = 0.1  # of the image's longer side: mean distance beyond which a 2D person is another one
LEAST_JOINTS = 3  # common joints that a match needs
LONGEST_STEP_S = 0.2  # between frames from which accelerations are told


@dataclass(frozen=True, slots=True)
class Spread:
    """Median and 90th percentile of `count` values; NaN without any."""

    count: int
    median: float
    p90: float


@dataclass(frozen=True, slots=True, eq=False)
class ReprojectionErrors:
    """N distances between a solved joint's projection and the 2D joint that the detector saw.

    cameras: (N,) index into the rig; ids: (N,) person; joints: (N,); px: (N,).
    """

    cameras: Array
    ids: Array
    joints: Array
    px: Array


@dataclass(frozen=True, slots=True)
class PersonSummary:
    """One identity.

    Args:
        identity: the id.
        frames: in how many frames it is there; first_ns, last_ns: the first and the last of them.
        joints_found: share of the skeleton's joints that are not missing, over these frames.
        limb_joints_found: the same for shoulders, elbows, wrists, hips, knees, ankles; NaN without.
        measured: share of the joints found that were measured, not predicted or filled.
        reprojection_px: of the measured joints.
        bone_length_cm, bone_std_cm: by bone ("parent-child"), mean and standard deviation over
            frames; bones that were there in fewer than two frames are left out.
        limbs: names of the bones of arms and legs among them.
        acceleration: m/s^2, median over joints and frames; mostly noise, as people accelerate seldom.
    """

    identity: int
    frames: int
    first_ns: int
    last_ns: int
    joints_found: float
    limb_joints_found: float
    measured: float
    reprojection_px: Spread
    bone_length_cm: dict[str, float]
    bone_std_cm: dict[str, float]
    limbs: tuple[str, ...]
    acceleration: float

    @property
    def limb_std_cm(self) -> tuple[float, float]:
        """Median and largest standard deviation of the lengths of limbs; NaN without limbs."""
        stds = [self.bone_std_cm[limb] for limb in self.limbs]
        return (float(np.median(stds)), max(stds)) if stds else (math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class CaptureSummary:
    """All that is measured; people in the order of their number of frames.

    frames: sets of poses; frames_with_people: those that are not empty.
    """

    frames: int
    frames_with_people: int
    people: tuple[PersonSummary, ...]
    reprojection_px: Spread
    reprojection_by_camera: dict[str, Spread]


def summarise_capture(
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Sequence[TrackedPoseSet],
    detections: Iterable[DetectionSet],
) -> CaptureSummary:
    """Summary of a run.

    Args:
        poses: in the order of time.
        detections: what they were made from; sets are paired with poses of the same index.
    """
    errors = reprojection_errors(rig, skeleton, poses, detections)
    identities = sorted({int(i) for pose in poses for i in pose.ids})
    people = [_person(skeleton, poses, errors, identity) for identity in identities]
    return CaptureSummary(
        frames=len(poses),
        frames_with_people=sum(1 for pose in poses if len(pose.ids)),
        people=tuple(sorted(people, key=lambda person: (-person.frames, person.identity))),
        reprojection_px=spread(errors.px),
        reprojection_by_camera={
            name: spread(errors.px[errors.cameras == i]) for i, name in enumerate(rig.names)
        },
    )


def reprojection_errors(
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Iterable[TrackedPoseSet],
    detections: Iterable[DetectionSet],
) -> ReprojectionErrors:
    """Distances in px for all measured joints of people who are matched to a 2D person.

    Within a view people and 2D people are matched one to one, so that the sum of mean distances over
    common joints is least. Joints that no detector sees (`SkeletonModel.derived`) do not count.
    """
    by_index = {found.index: found for found in detections}
    counts = np.ones(len(skeleton), bool)
    counts[[joint for joint, _ in skeleton.derived]] = False
    parts: list[tuple[Array, Array, Array, Array]] = []
    for pose in poses:
        found = by_index.get(pose.index)
        if found is None or not len(pose.ids):
            continue
        measured = (pose.states == JointState.MEASURED) & counts
        for view in found.views:
            if len(view.points) and view.camera in rig.names:
                camera = rig.index(view.camera)
                pixels = np.where(measured[..., None], rig.cameras[camera].project(pose.positions)[0], np.nan)
                seen = np.where(view.scores[..., None] > 0.0, view.points, np.nan)
                distances = np.linalg.norm(pixels[:, None] - seen[None], axis=-1)
                parts.extend(_matched(distances, camera, pose.ids, FARTHEST * max(view.image_size)))
    if not parts:
        empty = np.zeros(0, np.int64)
        return ReprojectionErrors(empty, empty, empty, np.zeros(0))
    return ReprojectionErrors(*(np.concatenate(column) for column in zip(*parts)))


def bone_lengths(skeleton: SkeletonModel, poses: Iterable[TrackedPoseSet], identity: int) -> Array:
    """Lengths (F, B) m of a person's bones in the F frames where it is there, NaN where an end is missing."""
    parents, children = (list(side) for side in zip(*skeleton.bones))
    rows = [
        np.linalg.norm(positions[children] - positions[parents], axis=-1)
        for positions in _frames_of(poses, identity)
    ]
    return np.array(rows).reshape(-1, len(parents))


def typical_acceleration(stamps_ns: Array, positions: Array) -> float:
    """Median acceleration, m/s^2, of joints (F, J, 3) m over three frames in a row; NaN where there are none.

    Args:
        stamps_ns: (F,), growing. positions: NaN where a joint is missing.
    """
    steps = 1e-9 * np.diff(stamps_ns)
    speeds = np.diff(positions, axis=0) / steps[:, None, None]
    turns = np.diff(speeds, axis=0) / (0.5 * (steps[1:] + steps[:-1]))[:, None, None]
    near = np.maximum(steps[1:], steps[:-1]) <= LONGEST_STEP_S
    values = np.linalg.norm(turns[near], axis=-1)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else math.nan


def spread(values: Array) -> Spread:
    """Median and p90 of the values that are finite."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return Spread(0, math.nan, math.nan)
    median, p90 = np.percentile(finite, [50, 90])
    return Spread(int(finite.size), float(median), float(p90))


def limb_joints(skeleton: SkeletonModel) -> tuple[int, ...]:
    """The joints of arms and legs: shoulders, elbows, wrists, hips, knees and ankles of both sides."""
    paired = {joint for pair in skeleton.left_right for joint in pair}
    names = (name.lower() for name in skeleton.joint_names)
    return tuple(i for i, name in enumerate(names) if i in paired and name.endswith(LIMB_JOINTS))


def _matched(
    distances: Array, camera: int, ids: Array, farthest: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Columns of `ReprojectionErrors` for one view, from distances (P, D, J) px, NaN = not comparable."""
    common = np.isfinite(distances)
    count = common.sum(-1)
    mean = np.where(common, distances, 0.0).sum(-1) / np.maximum(count, 1)
    cost = np.where((count >= LEAST_JOINTS) & (mean <= farthest), mean, farthest)
    columns = []
    for person, other in zip(*linear_sum_assignment(cost)):
        if cost[person, other] < farthest:
            joints = np.flatnonzero(common[person, other])
            columns.append(
                (
                    np.full(len(joints), camera),
                    np.full(len(joints), ids[person]),
                    joints,
                    distances[person, other, joints],
                )
            )
    return columns


def _frames_of(poses: Iterable[TrackedPoseSet], identity: int) -> list[Array]:
    """Positions (J, 3) of one person in every frame where it is."""
    return [pose.positions[i] for pose in poses for i in np.flatnonzero(pose.ids == identity)]


def _person(
    skeleton: SkeletonModel, poses: Sequence[TrackedPoseSet], errors: ReprojectionErrors, identity: int
) -> PersonSummary:
    there = [(pose, int(i)) for pose in poses for i in np.flatnonzero(pose.ids == identity)]
    states = np.array([pose.states[i] for pose, i in there])
    found = states != JointState.MISSING
    limbs, among = list(limb_joints(skeleton)), limb_bones(skeleton)
    lengths = 100.0 * bone_lengths(skeleton, poses, identity)
    names = [f"{skeleton.joint_names[a]}-{skeleton.joint_names[b]}" for a, b in skeleton.bones]
    kept = np.flatnonzero(np.isfinite(lengths).sum(0) >= 2).tolist()
    of_limbs = [b for b in kept if b in among]
    return PersonSummary(
        identity=identity,
        frames=len(there),
        first_ns=there[0][0].stamp_ns,
        last_ns=there[-1][0].stamp_ns,
        joints_found=float(found.mean()),
        limb_joints_found=float(found[:, limbs].mean()) if limbs else math.nan,
        measured=float((states[found] == JointState.MEASURED).mean()) if found.any() else math.nan,
        reprojection_px=spread(errors.px[errors.ids == identity]),
        bone_length_cm={names[b]: float(np.nanmean(lengths[:, b])) for b in kept},
        bone_std_cm={names[b]: float(np.nanstd(lengths[:, b])) for b in kept},
        limbs=tuple(names[b] for b in of_limbs),
        acceleration=typical_acceleration(
            np.array([pose.stamp_ns for pose, _ in there]), np.array([pose.positions[i] for pose, i in there])
        ),
    )


def limb_bones(skeleton: SkeletonModel) -> tuple[int, ...]:
    """The bones of arms and legs."""
    ends = set(limb_joints(skeleton))
    return tuple(
        b for b, bone in enumerate(skeleton.bones) if set(bone) <= ends and not _is_across(skeleton, b)
    )


def _is_across(skeleton: SkeletonModel, bone: int) -> bool:
    """Whether a bone is part of the trunk: between the sides, or from shoulder to hip."""
    parent, child = (skeleton.joint_names[joint].lower() for joint in skeleton.bones[bone])
    trunk = ("shoulder", "hip")
    return parent.endswith(trunk) and child.endswith(trunk)
