"""Solver for a whole recording.

It solves the bodies of its subjects in order of time, and assigns 2D poses to them at each instant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import BodyState, ImuSeries, InstantViews, Subject, ViewSeries
from panoptic_ros.errors import DataError
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import align, cameras_alone, felt_of, taken_over
from panoptic_ros.kinematics.imus.measured import ImuMeasurements, measured_by, resample
from panoptic_ros.kinematics.imus.recorded import looked_through
from panoptic_ros.kinematics.imus.t_pose import (
    bent_line,
    heading_from_poses,
    held_in,
    t_pose_decides,
    t_pose_mounts,
)
from panoptic_ros.kinematics.people.allotment import find_people, give_people
from panoptic_ros.kinematics.people.nearest_people import nearest_to_start
from panoptic_ros.kinematics.people.pairwise_sorting import PairwiseSorter
from panoptic_ros.kinematics.people.person import SEVERAL_S, PersonState
from panoptic_ros.kinematics.people.presence import middle_expected
from panoptic_ros.kinematics.people.seen_people import LONGEST_GAP_NS, NEAR_NS
from panoptic_ros.kinematics.pose.prior import PoseStatistics

Array = np.ndarray
ALIGNED_S = 15.0  # time from the start of the recording that is used for heading and clock of the IMUs
SAME_SET = 0.75  # fraction of the fastest camera's period: images within it form one set


@dataclass(frozen=True, eq=False)
class BodyRecording:
    """Data of a recording.

    Attributes:
        rig, joint_names: Cameras, and joint names of the 2D poses.
        views: 2D poses by the index of the camera in the rig.
        devices: IMU samples by device.
    """

    rig: Rig | None
    joint_names: tuple[str, ...]
    views: Mapping[int, ViewSeries]
    devices: Mapping[str, ImuSeries]


@dataclass(frozen=True, eq=False)
class BodySolution:
    """Result for a recording.

    Attributes:
        states: Bodies of all instants.
        people: The people in their final state.
        notices: Lines for the user.
    """

    states: list[BodyState]
    people: list[PersonState]
    notices: list[str]


def solve_recording(
    recording: BodyRecording,
    subjects: Sequence[Subject],
    config: KinematicsConfig,
    statistics: PoseStatistics,
) -> BodySolution:
    """Return the bodies of the subjects at the configured rate.

    The class `PersonState` solves for them, as in the live stage. Heading, clock and mountings of IMUs are
    determined from the recording first, and so are the instants.

    Raises:
        DataError: If no data determine a subject's mountings, or which of several people a subject is.
    """
    recording, notices = _without_odd_devices(recording, subjects)
    headings: dict[int, float] = {}
    wearers = [
        subject
        for subject in subjects
        if any(device.name in recording.devices for device in subject.devices)
        and ((config.window and config.clocks) or not subject.heading_known)
    ]
    if wearers and recording.views:
        recording, headings = _aligned(recording, wearers, subjects, config, statistics, notices)
    stamps = instants_of(recording.views, recording.devices, config.rate_hz)
    felt = {name: resample(series, stamps) for name, series in recording.devices.items()}
    for subject in wearers if not recording.views else ():
        if not subject.heading_known and t_pose_decides(subject):
            headings[subject.id] = _bent_heading(subject, stamps, felt, statistics, notices)
    people: list[PersonState] = []
    for subject in subjects:
        heading = headings.get(subject.id, 0.0)
        mounts, lines = t_pose_mounts(subject, stamps, felt, heading)
        notices += lines
        person = PersonState(config, subject, statistics, recording.rig, recording.joint_names)
        person.settle(heading, mounts, len(recording.views))
        people.append(person)
    measured = [measured_by(subject.devices, felt, len(stamps)) for subject in subjects]
    seen, states = RecordedPoseSource(config, recording, people, stamps), list[BodyState]()
    for k, stamp in enumerate(stamps.tolist()):
        seen.take(k)
        for person, rows in zip(people, measured):
            done, told = person.step(stamp, rows[k], round(0.5e9 / config.rate_hz), statistics)
            states += done
            notices += [notice.text for notice in told]
            person.behind.clear()
    for person in people:
        states += person.flush()
        if not person.came:
            notices.append(
                f"subject {person.subject.id} was not found: no camera sees a person near its start, and "
                "no mounted IMU measures it; check `start` and the devices of its file"
            )
    return BodySolution(states, people, notices)


def instants_of(views: Mapping[int, ViewSeries], devices: Mapping[str, ImuSeries], rate_hz: float) -> Array:
    """Return the instants (T,) ns of a fixed rate.

    They begin with the first image, or without cameras with the first IMU sample.
    """
    series = [v.stamps for v in views.values() if len(v.stamps)] or [
        d.stamps for d in devices.values() if len(d.stamps)
    ]
    if not series:
        return np.zeros(0, np.int64)
    first, last = min(int(s[0]) for s in series), max(int(s[-1]) for s in series)
    count = int(np.floor((last - first) * 1e-9 * rate_hz + 0.5)) + 1
    found: Array = first + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    return found


def _without_odd_devices(
    recording: BodyRecording, subjects: Sequence[Subject]
) -> tuple[BodyRecording, list[str]]:
    """Return the recording with the usable data of worn devices, and lines about their faults."""
    worn = [device.name for subject in subjects for device in subject.devices]
    seen = [view.stamps for view in recording.views.values() if len(view.stamps)]
    time = (min(int(s[0]) for s in seen), max(int(s[-1]) for s in seen)) if seen else None
    used = {name: series for name, series in recording.devices.items() if name in worn}
    devices, notices = looked_through(used, time)
    return replace(recording, devices=devices), notices


def _aligned(
    recording: BodyRecording,
    wearers: Sequence[Subject],
    subjects: Sequence[Subject],
    config: KinematicsConfig,
    statistics: PoseStatistics,
    notices: list[str],
) -> tuple[BodyRecording, dict[int, float]]:
    """Return the recording with the wearers' IMUs on the clock of the cameras, and their headings, rad."""
    first = min(int(view.stamps[0]) for view in recording.views.values() if len(view.stamps))
    until = first + round(ALIGNED_S * 1e9)
    views = {
        camera: ViewSeries(view.stamps[view.stamps < until], view.people[: int((view.stamps < until).sum())])
        for camera, view in recording.views.items()
    }
    alone = [replace(other, devices=()) for other in subjects]
    cameras = BodyRecording(recording.rig, recording.joint_names, views, {})
    seen = solve_recording(cameras, alone, cameras_alone(config), statistics)
    headings, devices = {}, dict(recording.devices)
    for subject in wearers:
        states = [state for state in seen.states if state.id == subject.id]
        worn = {d.name: devices[d.name] for d in subject.devices if d.name in devices}
        felt = {name: felt_of(series, config.rate_hz) for name, series in worn.items()}
        found = align(subject, states, felt)
        if found is None:
            if not subject.heading_known:
                text = "hardly moves, so the heading of its IMUs is assumed to be 0"
                notices.append(f"subject {subject.id}: {text}")
            continue
        headings[subject.id], shift, lines = taken_over(subject, found, config.clocks)
        notices += [f"subject {subject.id}: {line}" for line in lines]
        if shift:
            devices |= {name: series.shifted(shift) for name, series in worn.items()}
    return replace(recording, devices=devices), headings


def _bent_heading(
    subject: Subject,
    stamps: Array,
    felt: Mapping[str, ImuMeasurements],
    statistics: PoseStatistics,
    notices: list[str],
) -> float:
    """Return the heading of the IMUs, rad, from bending joints, for a subject that no camera sees."""
    assert subject.t_pose is not None
    turns = {d.name: felt[d.name].orientations for d in subject.devices if d.name in felt}
    held = {name: during for name in turns if len(during := held_in(subject.t_pose, stamps, felt[name]))}
    found = heading_from_poses(subject, statistics, turns, held)
    if found is None:
        text = "hardly moves and no camera sees it, so the heading of its IMUs is assumed to be 0"
        notices.append(f"subject {subject.id}: {text}")
        return 0.0
    notices.append(f"subject {subject.id}: {bent_line(found)}")
    return found


class RecordedPoseSource:
    """Source of recorded 2D poses. It assigns 2D poses to people before the instants that need the poses.

    Args:
        stamps: (T,) ns, timestamps of the instants.
    """

    def __init__(
        self, config: KinematicsConfig, recording: BodyRecording, people: Sequence[PersonState], stamps: Array
    ):
        self._people, self._cameras, self._gate = people, len(recording.views), config.gate
        self._sets, self._needed = _sets_of(recording.views, stamps)
        self._next = 0  # index of the next set
        self._sorter: PairwiseSorter | None = None
        if config.paper_sorting and recording.rig is not None and self._cameras > 1:
            self._sorter = PairwiseSorter(recording.rig, [person.subject.start for person in people])

    def take(self, number: int) -> None:
        """Assign to people the 2D poses that an instant needs: of each camera's images around the instant.

        Args:
            number: Index of the instant.

        Raises:
            DataError: If no data determine which of several people a subject is.
        """
        while self._next <= self._needed[number]:
            instant, stamps = self._sets[self._next]
            self._next += 1
            if self._sorter is None:
                found = find_people(self._people, instant, self._gate, self._first)
            else:
                found = self._sorter.sort(instant, [middle_expected(p.tracker) for p in self._people])
                for k, person in enumerate(self._people):
                    if person.is_new and person.subject.start is None:
                        found[k] = self._first(person, instant)
            give_people(self._people, found, instant, stamps)

    def _first(self, person: PersonState, instant: InstantViews) -> People:
        """Return the 2D poses at the subject's start position.

        If no position is stated, return the 2D poses of the only person.
        """
        subject = person.subject
        if subject.start is None:
            crowd = max((len(people.points) for people in instant.views.values()), default=0)
            if crowd and (len(self._people) > 1 or crowd > 1):
                raise DataError(
                    f"subject {subject.id}: {crowd} people are seen and it cannot be identified; state "
                    "`start`, the position of the pelvis at the first instant"
                )
        alone = self._cameras < 2 or instant.stamp_ns > self._sets[0][0].stamp_ns + 1e9 * SEVERAL_S
        return nearest_to_start(subject, instant, person.weighing, alone)


def _sets_of(
    views: Mapping[int, ViewSeries], stamps: Array
) -> tuple[list[tuple[InstantViews, dict[int, int]]], Array]:
    """Return sets of images of about the same time, and the last set (T,) that each instant needs.

    A set comes with the timestamps of its images, by camera. An instant needs the sets up to the first images
    after it over which joints are interpolated; -1 = none.

    Args:
        stamps: (T,) ns, timestamps of the instants.
    """
    series = {camera: view for camera, view in views.items() if len(view.stamps)}
    periods = [float(np.median(np.diff(v.stamps))) for v in series.values() if len(v.stamps) > 1]
    longest = SAME_SET * min(periods, default=0.0)
    images = sorted((at, c, row) for c, v in series.items() for row, at in enumerate(v.stamps.tolist()))
    rows, begin = list[dict[int, int]](), 0  # row of the image by camera, of each set
    # by camera: number of the set of each image
    numbers: dict[int, list[int]] = {camera: [] for camera in series}
    for at, camera, row in images:
        if not rows or camera in rows[-1] or at - begin > longest:
            rows.append({})
            begin = at
        rows[-1][camera] = row
        numbers[camera].append(len(rows) - 1)
    sets = []
    for own in rows:
        there = {camera: int(series[camera].stamps[row]) for camera, row in own.items()}
        people = {camera: series[camera].people[row] for camera, row in own.items()}
        sets.append((InstantViews(max(there.values()), people), there))
    needed = np.full(len(stamps), -1)
    for camera, view in series.items():
        after = np.searchsorted(view.stamps, stamps - NEAR_NS)
        first = np.minimum(after, len(view.stamps) - 1)
        near = (after < len(view.stamps)) & (view.stamps[first] - stamps <= LONGEST_GAP_NS)
        needed = np.maximum(needed, np.where(near, np.array(numbers[camera])[first], -1))
    return sets, np.maximum.accumulate(needed)
