"""A simulated capture of one person, solved instant by instant while somebody looks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from panoptic_ros.domain.subjects import Instant
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.measured import measured_of
from panoptic_ros.kinematics.imus.t_pose import t_pose_mounts
from panoptic_ros.kinematics.people.nearest_people import assign_people, nearest_to_start
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.recorded_instants import instants_of
from panoptic_ros.running.studies.bodies.cases import recording_of
from panoptic_ros.simulation.bodies.capture import BodyCapture


def tracker_of(
    capture: BodyCapture,
    config: KinematicsConfig,
    statistics: PoseStatistics,
    kind: type[SubjectTracker] = SubjectTracker,
) -> tuple[Any, list[Instant]]:
    """A tracker of this kind that has seen nothing yet, and all instants; heading and clock as stated."""
    recording = recording_of(capture)
    weighing = Weighing(config, capture.subject, statistics, recording.rig, recording.joint_names)
    instants = instants_of(recording.views, recording.devices, config.rate_hz)
    mounts, _ = t_pose_mounts(capture.subject, instants, set(recording.devices), 0.0)
    return kind(config, capture.subject, weighing, mounts, 0.0), instants


def follow(tracker: SubjectTracker, instants: list[Instant], gate: float) -> Iterator[Instant]:
    """Each instant after the tracker has taken it in."""
    weighing = tracker.weighing
    for instant in instants:
        if tracker.started:
            people = assign_people([tracker], instant, weighing.rotations, weighing.translations, gate)[0]
        else:
            people = nearest_to_start(tracker.subject, instant, weighing)
        measured = measured_of(tracker.subject.devices, instant.readings)
        tracker.step(instant.stamp_ns, measured, people)
        yield instant
