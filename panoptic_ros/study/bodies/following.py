"""Solve a simulated capture of one person step by step, with access to the tracker after each step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import InstantViews, ViewPeople
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.measured import ImuMeasurements, measured_by, resample
from panoptic_ros.kinematics.imus.t_pose import t_pose_mounts
from panoptic_ros.kinematics.people.nearest_people import assign_people, nearest_to_start
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.session import instants_of
from panoptic_ros.simulation.bodies.capture import BodyCapture
from panoptic_ros.study.bodies.cases import recording_of


class TimeStepMeasurements(NamedTuple):
    """All data of a time step: 2D poses by camera, and the measurements of the subject's devices."""

    stamp_ns: int
    views: dict[int, ViewPeople]
    measured: ImuMeasurements


def tracker_of(
    capture: BodyCapture,
    config: KinematicsConfig,
    statistics: PoseStatistics,
    kind: type[SubjectTracker] = SubjectTracker,
) -> tuple[Any, list[TimeStepMeasurements]]:
    """Return a tracker in its initial state, and all time steps of the capture.

    Each time step has the nearest image of every camera. Heading and clock are as stated.

    Args:
        kind: class of the tracker.
    """
    recording, subject = recording_of(capture), capture.subject
    weighing = EvidenceBuilder(config, subject, statistics, recording.rig, recording.joint_names)
    stamps = instants_of(recording.views, recording.devices, config.rate_hz)
    felt = {name: resample(series, stamps) for name, series in recording.devices.items()}
    measured = measured_by(subject.devices, felt, len(stamps))
    images = {
        camera: np.abs(view.stamps[None] - stamps[:, None]).argmin(1)
        for camera, view in recording.views.items()
    }
    given = [
        TimeStepMeasurements(
            stamp, {c: recording.views[c].people[rows[k]] for c, rows in images.items()}, measured[k]
        )
        for k, stamp in enumerate(stamps.tolist())
    ]
    mounts, _ = t_pose_mounts(subject, stamps, felt, 0.0)
    return kind(config, subject, weighing, mounts, 0.0), given


def follow(
    tracker: SubjectTracker, instants: Sequence[TimeStepMeasurements], gate: float
) -> Iterator[TimeStepMeasurements]:
    """Yield each time step after the tracker has processed it."""
    weighing = tracker.weighing
    for given in instants:
        instant = InstantViews(given.stamp_ns, given.views)
        if tracker.started:
            people = assign_people([tracker], instant, weighing.rotations, weighing.translations, gate)[0]
        else:
            people = nearest_to_start(tracker.subject, instant, weighing)
        tracker.step(given.stamp_ns, given.measured, people)
        yield given
