"""A whole recording, solved for its subjects in the order of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import BodyState, ImuSeries, Instant, Subject, ViewSeries
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import mean_rotation, turn_about_z
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.evidence import Weighing
from panoptic_ros.kinematics.prior import PoseStatistics
from panoptic_ros.kinematics.resampling import instants_of
from panoptic_ros.kinematics.tracker import SubjectTracker, assign_people

Array = np.ndarray
FIRST_GATE = 0.8  # m, from where a subject is said to start


@dataclass(frozen=True, eq=False)
class Recording:
    """2D people by the index of the camera in the rig, in `joint_names`, and IMU samples by device."""

    rig: Rig | None
    joint_names: tuple[str, ...]
    views: Mapping[int, ViewSeries]
    devices: Mapping[str, ImuSeries]


@dataclass(frozen=True, eq=False)
class Solved:
    """Bodies of all instants, the trackers as they are at the end, and what the user should know, a line
    each."""

    states: list[BodyState]
    trackers: list[SubjectTracker]
    notices: list[str]


def solve_recording(
    recording: Recording, subjects: Sequence[Subject], config: KinematicsConfig, statistics: PoseStatistics
) -> Solved:
    """Bodies of the subjects at the configured rate.

    Raises:
        DataError: if nothing tells how a subject's IMUs are mounted, or where one of several people starts.
    """
    instants = instants_of(recording.views, recording.devices, config.rate_hz)
    trackers = []
    for subject in subjects:
        weighing = Weighing(config, subject, statistics, recording.rig, recording.joint_names)
        worn = {d.name for d in subject.devices if d.name in recording.devices}
        mounts = t_pose_mounts(subject, instants, worn)
        trackers.append(SubjectTracker(config, subject, weighing, mounts))
    weighing = trackers[0].weighing
    states: list[BodyState] = []
    for instant in instants:
        people = assign_people(trackers, instant, weighing.rotations, weighing.translations, config.gate)
        for k, tracker in enumerate(trackers):
            if not tracker.started:
                people[k] = _first_people(tracker.subject, instant, weighing, len(subjects) > 1)
                if instant.views and not people[k]:
                    continue
            states += tracker.step(instant, people[k])
    for tracker in trackers:
        states += tracker.flush()
    return Solved(states, trackers, [])


def t_pose_mounts(subject: Subject, instants: Sequence[Instant], worn: set[str]) -> dict[str, Array]:
    """Mounting (3, 3), segment from device, of every device worn: as stated, or as the T-pose tells it.

    Raises:
        DataError: if neither is there.
    """
    mounts = {}
    for device in subject.devices:
        if device.name not in worn:
            continue
        if device.mount is not None:
            mounts[device.name] = device.mount
            continue
        pose = subject.t_pose
        if pose is None:
            raise DataError(
                f"subject {subject.id}: device {device.name} has no mount, and there is no t_pose to "
                "tell it; state one of them"
            )
        held = [
            instant.readings[device.name].orientation
            for instant in instants
            if pose.from_ns <= instant.stamp_ns <= pose.to_ns and device.name in instant.readings
        ]
        held = [r for r in held if np.isfinite(r).all()]
        if not held:
            raise DataError(f"subject {subject.id}: device {device.name} has no samples in the T-pose")
        facing = pose.facing if pose.facing is not None else np.array([1.0, 0.0, 0.0])
        body = turn_about_z(float(np.arctan2(facing[1], facing[0])))
        mounts[device.name] = body.T @ mean_rotation(np.array(held))
    return mounts


def _first_people(
    subject: Subject, instant: Instant, weighing: Weighing, several: bool
) -> dict[int, tuple[Array, Array]]:
    """2D people of the views who stand where the subject starts; the only ones, if nothing says where."""
    found = {}
    for camera, people in instant.views.items():
        if not len(people.points):
            continue
        if subject.start is None:
            if several or len(people.points) > 1:
                raise DataError(
                    f"subject {subject.id}: {len(people.points)} people are seen and nothing says who it is; "
                    "state `start`, where the pelvis is at the first instant"
                )
            found[camera] = (people.points[0], people.scores[0])
            continue
        local = weighing.rotations[camera] @ subject.start + weighing.translations[camera]
        if local[2] < 0.1:
            continue
        middles = np.nanmedian(people.points, axis=1)
        far = np.linalg.norm(middles - local[:2] / local[2], axis=-1) * local[2]
        best = int(np.nanargmin(far))
        if far[best] < FIRST_GATE:
            found[camera] = (people.points[best], people.scores[best])
    return found
