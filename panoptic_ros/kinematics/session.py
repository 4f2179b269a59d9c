"""A whole recording, solved for its subjects in the order of time; and whose its 2D people are, instant by
instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import BodyState, ImuSeries, Instant, Subject, ViewSeries
from panoptic_ros.errors import DataError
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import align, cameras_alone, felt_of, taken_over
from panoptic_ros.kinematics.imus.measured import measured_of
from panoptic_ros.kinematics.imus.recorded import looked_through
from panoptic_ros.kinematics.imus.t_pose import bent_line, heading_from_poses, t_pose_decides, t_pose_mounts
from panoptic_ros.kinematics.people.nearest_people import nearest_to_start
from panoptic_ros.kinematics.people.pairwise_sorting import PairwiseSorter
from panoptic_ros.kinematics.people.presence import Looked, Presence, middle_expected, people_of
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.recorded_instants import instants_of

ALIGNED_S = 15.0  # of the recording, from which heading and clock of the IMUs are found
LOST_S = 0.5  # out of sight and without IMUs, after which a body is given up
ALONE_S = 0.5  # for which a view waits for others that say the same of who stands where a subject starts


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
    instants = instants_of(recording.views, recording.devices, config.rate_hz)
    trackers = []
    for subject in wearers if not recording.views else ():
        if not subject.heading_known and t_pose_decides(subject):
            headings[subject.id] = _bent_heading(subject, instants, statistics, notices)
    for subject in subjects:
        weighing = Weighing(config, subject, statistics, recording.rig, recording.joint_names)
        worn = {d.name for d in subject.devices if d.name in recording.devices}
        heading = headings.get(subject.id, 0.0)
        mounts, lines = t_pose_mounts(subject, instants, worn, heading)
        notices += lines
        trackers.append(SubjectTracker(config, subject, weighing, mounts, heading))
    states: list[BodyState] = []
    finder = RecordedPeople(config, recording.rig, subjects, trackers[0].weighing, len(recording.views))
    for instant in instants:
        people, back = finder.find(instant, trackers)
        for k, tracker in enumerate(trackers):
            if back[k]:
                states += tracker.flush()
                tracker.move_to(people[k], None)
            if not tracker.started and instant.views and not people[k]:
                continue
            expected = middle_expected(tracker)
            measured = measured_of(tracker.subject.devices, instant.readings)
            states += tracker.step(instant.stamp_ns, measured, people[k])
            notices += [notice.text for notice in tracker.devices.take_notices()]
            unseen = 1e-9 * finder.presences[k].saw(instant, bool(people[k]), expected)
            if unseen > LOST_S and not instant.readings.keys() & set(tracker.devices.names):
                states += tracker.flush()
                trackers[k] = tracker.begun_anew()
    for tracker, presence in zip(trackers, finder.presences):
        states += tracker.flush()
        if not tracker.started and not presence.last_ns:
            notices.append(
                f"subject {tracker.subject.id} has not come: no camera sees anybody near where it starts, "
                "and no IMU that is mounted tells of it; look at `start` and the devices of its file"
            )
    return Solved(states, trackers, notices)


def _without_odd_devices(recording: Recording, subjects: Sequence[Subject]) -> tuple[Recording, list[str]]:
    """The recording with what can be used of the devices that are worn, and a line for all that is odd."""
    worn = [device.name for subject in subjects for device in subject.devices]
    seen = [view.stamps for view in recording.views.values() if len(view.stamps)]
    time = (min(int(s[0]) for s in seen), max(int(s[-1]) for s in seen)) if seen else None
    used = {name: series for name, series in recording.devices.items() if name in worn}
    devices, notices = looked_through(used, time)
    return replace(recording, devices=devices), notices


def _aligned(
    recording: Recording,
    wearers: Sequence[Subject],
    subjects: Sequence[Subject],
    config: KinematicsConfig,
    statistics: PoseStatistics,
    notices: list[str],
) -> tuple[Recording, dict[int, float]]:
    """The recording with the IMUs of the wearers on the clock of the cameras; headings of theirs, rad."""
    first = min(int(view.stamps[0]) for view in recording.views.values() if len(view.stamps))
    until = first + round(ALIGNED_S * 1e9)
    views = {
        camera: ViewSeries(view.stamps[view.stamps < until], view.people[: int((view.stamps < until).sum())])
        for camera, view in recording.views.items()
    }
    alone = [replace(other, devices=()) for other in subjects]
    cameras = Recording(recording.rig, recording.joint_names, views, {})
    seen = solve_recording(cameras, alone, cameras_alone(config), statistics)
    headings, devices = {}, dict(recording.devices)
    for subject in wearers:
        states = [state for state in seen.states if state.id == subject.id]
        worn = {d.name: devices[d.name] for d in subject.devices if d.name in devices}
        felt = {name: felt_of(series, config.rate_hz) for name, series in worn.items()}
        found = align(subject, states, felt)
        if found is None:
            if not subject.heading_known:
                text = "hardly moves, so the heading of its IMUs is taken as 0"
                notices.append(f"subject {subject.id}: {text}")
            continue
        headings[subject.id], shift, lines = taken_over(subject, found, config.clocks)
        notices += [f"subject {subject.id}: {line}" for line in lines]
        if shift:
            devices |= {name: series.shifted(shift) for name, series in worn.items()}
    return replace(recording, devices=devices), headings


def _bent_heading(
    subject: Subject, instants: Sequence[Instant], statistics: PoseStatistics, notices: list[str]
) -> float:
    """The heading of the IMUs as joints bend, rad, where no camera tells it."""
    gone, turns, held = np.full((3, 3), np.nan), {}, {}
    assert subject.t_pose is not None
    begin, end = subject.t_pose.from_ns, subject.t_pose.to_ns
    within = np.array([begin <= instant.stamp_ns <= end for instant in instants])
    for name in (device.name for device in subject.devices):
        own = [i.readings[name].orientation if name in i.readings else gone for i in instants]
        turns[name] = np.array(own)
        during = within & np.isfinite(turns[name]).all((1, 2))
        if during.any():
            held[name] = turns[name][during]
    found = heading_from_poses(subject, statistics, turns, held)
    if found is None:
        text = "hardly moves and no camera sees it, so the heading of its IMUs is taken as 0"
        notices.append(f"subject {subject.id}: {text}")
        return 0.0
    notices.append(f"subject {subject.id}: {bent_line(found)}")
    return found


class RecordedPeople:
    """Where subjects start, where they are expected, and whether they are in sight.

    Attributes:
        presences: whether each subject is in sight.

    Args:
        weighing: of any of them. cameras: that have images.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        rig: Rig | None,
        subjects: Sequence[Subject],
        weighing: Weighing,
        cameras: int,
    ):
        self._gate, self._subjects, self._weighing, self._cameras = config.gate, subjects, weighing, cameras
        self.presences = [Presence() for _ in subjects]
        self._sorter: PairwiseSorter | None = None
        if config.paper_sorting and rig is not None and cameras > 1:
            self._sorter = PairwiseSorter(rig, [subject.start for subject in subjects])
        self._first_ns: int | None = None

    def find(self, instant: Instant, trackers: Sequence[SubjectTracker]) -> tuple[list[People], list[bool]]:
        """2D people of each subject, and whether it is back that was out of sight.

        Raises:
            DataError: if nothing tells who of several people a subject is.
        """
        self._first_ns = instant.stamp_ns if self._first_ns is None else self._first_ns
        if self._sorter is None:
            looked = [Looked(tracker, presence) for tracker, presence in zip(trackers, self.presences)]
            people = people_of(looked, instant, self._weighing, self._gate)
        else:
            people = self._sorter.sort(instant, [middle_expected(tracker) for tracker in trackers])
        for k, (tracker, subject) in enumerate(zip(trackers, self._subjects)):
            is_sorted = self._sorter is not None and subject.start is not None
            if not tracker.started and not self.presences[k].is_away and not is_sorted:
                people[k] = self._first(subject, instant)
        back = [
            bool(own) and presence.is_away and tracker.started
            for own, presence, tracker in zip(people, self.presences, trackers)
        ]
        return people, back

    def _first(self, subject: Subject, instant: Instant) -> People:
        """Who stands where a subject starts; the only ones, if nothing says where."""
        if subject.start is None:
            crowd = max((len(people.points) for people in instant.views.values()), default=0)
            if crowd and (len(self._subjects) > 1 or crowd > 1):
                raise DataError(
                    f"subject {subject.id}: {crowd} people are seen and nothing says who it is; state "
                    "`start`, where the pelvis is at the first instant"
                )
        assert self._first_ns is not None
        alone = self._cameras < 2 or instant.stamp_ns > self._first_ns + 1e9 * ALONE_S
        return nearest_to_start(subject, instant, self._weighing, alone)
