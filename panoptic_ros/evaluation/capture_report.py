"""Quality measures of a result on a real capture without ground truth.

They describe people and their joints, the reprojection error against the detector's 2D poses, and the
constancy of bone lengths. All functions are pure and work on the records of a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import DetectionSet, JointState, Rig, SkeletonModel, TrackedPoseSet

Array = np.ndarray
LIMB_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # endings of joint names, both sides
# share of the image's longer side; a 2D pose with a larger mean distance belongs to another person
FARTHEST = 0.1
LEAST_JOINTS = 3  # smallest number of common joints for a match
LONGEST_STEP_S = 0.2  # s; largest frame interval from which accelerations are computed


@dataclass(frozen=True, slots=True)
class QuantileSummary:
    """Median and 90th percentile of `count` values; NaN without values."""

    count: int
    median: float
    p90: float


@dataclass(frozen=True, slots=True, eq=False)
class ReprojectionErrors:
    """N distances between the projection of a 3D joint and the detected 2D joint.

    Args:
        cameras: Index (N,) into the rig.
        ids: Person (N,).
        joints: Joint index (N,).
        px: Distance (N,) px.
    """

    cameras: Array
    ids: Array
    joints: Array
    px: Array


@dataclass(frozen=True, slots=True)
class PersonSummary:
    """Quality measures of one person.

    Args:
        identity: Person id.
        frames: Number of frames with the person.
        first_ns, last_ns: Timestamps of the first and the last of them.
        joints_found: Share of the skeleton's joints that are not missing, over these frames.
        limb_joints_found: The same for shoulders, elbows, wrists, hips, knees, ankles; NaN without such
            joints.
        measured: Share of the found joints that were measured, not predicted or filled.
        reprojection_px: Reprojection error of the measured joints.
        bone_length_cm, bone_std_cm: Mean and standard deviation over frames by bone ("parent-child"). Bones
            present in fewer than two frames are left out.
        limbs: Names of those of these bones that belong to arms and legs.
        acceleration: Median over joints and frames, m/s^2. It is mostly noise, because people seldom
            accelerate.
    """

    identity: int
    frames: int
    first_ns: int
    last_ns: int
    joints_found: float
    limb_joints_found: float
    measured: float
    reprojection_px: QuantileSummary
    bone_length_cm: dict[str, float]
    bone_std_cm: dict[str, float]
    limbs: tuple[str, ...]
    acceleration: float

    @property
    def limb_std_cm(self) -> tuple[float, float]:
        """Return the median and the largest standard deviation (cm) of limb lengths; NaN without limbs."""
        stds = [self.bone_std_cm[limb] for limb in self.limbs]
        return (float(np.median(stds)), max(stds)) if stds else (math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class CaptureSummary:
    """Summary of a run; people are sorted by decreasing number of frames.

    Args:
        frames: Number of pose sets.
        frames_with_people: Number of pose sets that are not empty.
        people: Quality measures of each person.
        reprojection_px: Reprojection error of all people and cameras.
        reprojection_by_camera: Reprojection error by camera.
    """

    frames: int
    frames_with_people: int
    people: tuple[PersonSummary, ...]
    reprojection_px: QuantileSummary
    reprojection_by_camera: dict[str, QuantileSummary]


def summarise_capture(
    rig: Rig,
    skeleton: SkeletonModel,
    poses: Sequence[TrackedPoseSet],
    detections: Iterable[DetectionSet],
) -> CaptureSummary:
    """Return the summary of a run.

    Args:
        poses: Tracked poses sorted by time.
        detections: Detection sets behind the poses, paired with them by index.
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
    """Return reprojection errors (px) of all measured joints of people who are matched to a 2D pose.

    Within a view, people and 2D poses are matched one to one with the smallest sum of mean distances over
    common joints. Joints that no detector sees (`SkeletonModel.derived`) are ignored.
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
    """Return a person's bone lengths (F, B) m in the F frames with it, NaN where an end is missing."""
    parents, children = (list(side) for side in zip(*skeleton.bones))
    rows = [
        np.linalg.norm(positions[children] - positions[parents], axis=-1)
        for positions in _frames_of(poses, identity)
    ]
    return np.array(rows).reshape(-1, len(parents))


def typical_acceleration(stamps_ns: Array, positions: Array) -> float:
    """Return the median acceleration (m/s^2) of joints over three consecutive frames; NaN if none.

    Args:
        stamps_ns: Timestamps (F,), increasing.
        positions: Joints (F, J, 3) m, NaN where missing.
    """
    steps = 1e-9 * np.diff(stamps_ns)
    speeds = np.diff(positions, axis=0) / steps[:, None, None]
    turns = np.diff(speeds, axis=0) / (0.5 * (steps[1:] + steps[:-1]))[:, None, None]
    near = np.maximum(steps[1:], steps[:-1]) <= LONGEST_STEP_S
    values = np.linalg.norm(turns[near], axis=-1)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else math.nan


def spread(values: Array) -> QuantileSummary:
    """Return count, median and 90th percentile of the finite values."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return QuantileSummary(0, math.nan, math.nan)
    median, p90 = np.percentile(finite, [50, 90])
    return QuantileSummary(int(finite.size), float(median), float(p90))


def limb_joints(skeleton: SkeletonModel) -> tuple[int, ...]:
    """Return the joints of arms and legs: shoulders, elbows, wrists, hips, knees and ankles of both sides."""
    paired = {joint for pair in skeleton.left_right for joint in pair}
    names = (name.lower() for name in skeleton.joint_names)
    return tuple(i for i, name in enumerate(names) if i in paired and name.endswith(LIMB_JOINTS))


def _matched(
    distances: Array, camera: int, ids: Array, farthest: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Return columns of `ReprojectionErrors` for one view.

    Args:
        distances: Distances (P, D, J) px between projected and detected joints, NaN = not comparable.
        camera: Index of the camera.
        ids: Ids (P,) of the people.
        farthest: Largest mean distance of a match, px.
    """
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
    """Return the positions (J, 3) m of one person in every frame with it."""
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
    """Return the bones of arms and legs."""
    ends = set(limb_joints(skeleton))
    return tuple(
        b for b, bone in enumerate(skeleton.bones) if set(bone) <= ends and not _is_across(skeleton, b)
    )


def _is_across(skeleton: SkeletonModel, bone: int) -> bool:
    """Return whether a bone belongs to the trunk: it connects shoulders, hips, or a shoulder and a hip."""
    parent, child = (skeleton.joint_names[joint].lower() for joint in skeleton.bones[bone])
    trunk = ("shoulder", "hip")
    return parent.endswith(trunk) and child.endswith(trunk)
