"""One person online: observations, mountings of the IMUs, and the body that is solved from both."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.bodies import BodySource
from panoptic_ros.domain.segments import SegmentedBody
from panoptic_ros.domain.subjects import BodyState, InstantViews, Subject
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import cameras_alone
from panoptic_ros.kinematics.imus.fitting import ImuFitting
from panoptic_ros.kinematics.imus.measured import NOTHING_MEASURED, ImuMeasurements
from panoptic_ros.kinematics.people.presence import SubjectPresence
from panoptic_ros.kinematics.people.seen_people import PersonSamples, ViewJoints
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.stage import Notice

Array = np.ndarray
LOST_S = 0.5  # time without any data after which a body is dropped
AWAITED_S = 2.0  # waiting time for a person whom no camera has seen yet
SEVERAL_S = 0.5  # waiting time of a recording with several cameras for a second view
COMPLETE_NS = 100_000_000  # age of an instant at which all its views have arrived
AGAIN_S = 1.0  # s without cameras, after which the next camera sets the position instead of correcting it


class SolveSources(NamedTuple):
    """Data from which a body was solved: `BodySource`, number of cameras, number of devices."""

    source: int
    views: int
    devices: int


class PersonState:
    """A designated or tracked person.

    Args:
        joint_names: Names (K) of the joints in the detections.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        subject: Subject,
        statistics: PoseStatistics,
        rig: Rig | None,
        joint_names: Sequence[str],
    ):
        self._config, self.subject = config, subject
        self.weighing = EvidenceBuilder(config, subject, statistics, rig, joint_names)
        self.seen = PersonSamples()
        self.fitting = ImuFitting(config, subject)
        self.tracker: SubjectTracker | None = None
        self.behind: dict[int, SolveSources] = {}  # by timestamp, for instants that were not returned yet
        self.of_track = False  # the newest 2D poses are those of a track
        self.came = False  # cameras or IMUs have measured the person at least once
        self.worn = frozenset(device.name for device in subject.devices)
        self._alone: SubjectTracker | None = None  # from cameras alone, for the comparison with IMUs
        # heading, and names of the devices, in the tracker
        self._mounted: tuple[float, tuple[str, ...]] | None = None
        # mask of these devices among the subject's
        self._mounted_devices = np.zeros(len(subject.devices), bool)
        self.presence = SubjectPresence()
        self._returns = False  # seen again after an absence, maybe elsewhere
        self._without = 0  # number of instants without any data
        self._unseen = 0  # number of instants without cameras
        self._awaited_s, self._lost_s = AWAITED_S, LOST_S
        self._several_s = 0.0  # waiting time, s, of one view for another

    def settle(self, heading: float, mounts: dict[str, Array], cameras: int) -> None:
        """Use what a whole recording determines: heading and mountings of the IMUs, see `ImuFitting`.

        With cameras, the person is waited for to the end of the recording. A body then begins with two views,
        or with one after some time. A single camera does not show whether a new person is one who was out of
        sight, so a body is then never dropped.
        """
        self.fitting.settle(heading, mounts)
        self._awaited_s = math.inf if cameras else 0.0
        self._lost_s = math.inf if cameras == 1 else LOST_S
        self._several_s = SEVERAL_S if cameras > 1 else 0.0

    def step(
        self,
        stamp_ns: int,
        measured: ImuMeasurements,
        half_period_ns: int,
        statistics: PoseStatistics,
        stride: int = 1,
    ) -> tuple[list[BodyState], list[Notice]]:
        """Solve an instant. Return final bodies, of the instant before the lag, and notices.

        Args:
            measured: Measurements of the person's devices.
            half_period_ns: Maximum distance, ns, at which a single sample counts.
            statistics: Statistics of poses.
            stride: Number of periods since the previous instant.
        """
        people, joints = self._seen_at(stamp_ns, half_period_ns)
        notices = self.feel(stamp_ns, measured)
        seen = bool(people) or joints is not None
        if self.fitting.looking:
            notices += self._look(stamp_ns - COMPLETE_NS, half_period_ns, statistics, stride)
        done = self._remount(stamp_ns)
        there = measured.there & self._mounted_devices
        used = int(there.sum())
        self._without = 0 if seen or used else self._without + stride
        if self.missed:
            return done + self._give_up(), notices
        if not self.is_expected and not self._begins(len(people), seen, used):
            return done, notices
        tracker = self.tracker = self.tracker or self._new_tracker(stamp_ns)
        self.came = True
        if seen and (self._returns or self._unseen > AGAIN_S * self._config.rate_hz):
            done += tracker.flush()
            tracker.move_to(people, joints)
            self._returns = False
        self._unseen = 0 if seen else self._unseen + stride
        done += tracker.step(stamp_ns, measured._replace(there=there), people, joints, stride)
        notices += tracker.devices.take_notices()
        self.behind[stamp_ns] = SolveSources(int(self._source(people, joints, used)), len(people), used)
        return done, notices

    def feel(self, stamp_ns: int, measured: ImuMeasurements) -> list[Notice]:
        """Add the measurements of the person's devices at an instant, and return notices."""
        return self.fitting.take(stamp_ns, self.subject, measured)

    @property
    def missed(self) -> bool:
        """Return whether the body was dropped because the person had no data for too long."""
        return self._without > self._lost_s * self._config.rate_hz

    def see(self, seen: ViewJoints, camera: int, of_track: bool) -> None:
        """Add the 2D joints from a camera.

        Args:
            of_track: True if the person's track holds this view.
        """
        self.seen.see(camera, seen)
        self.of_track = of_track

    @property
    def is_expected(self) -> bool:
        """Return whether there is a body that predicts the position of the person."""
        return self.tracker is not None and self.tracker.started

    @property
    def is_new(self) -> bool:
        """Return whether the position of the person is unknown.

        The person has then not been seen at all, or not since timestamps restarted.
        """
        return not (self.is_expected or self.presence.is_away)

    def look(self, instant: InstantViews, is_seen: bool, expected: Array | None) -> None:
        """Record the result of searching views without a track for the person, see `SubjectPresence.saw`."""
        self._returns |= is_seen and self.presence.is_away
        self.presence.saw(instant, is_seen, expected)

    def follow(self, stamp_ns: int, views: int) -> None:
        """Record that a track holds the person in `views` views."""
        self._returns |= self.presence.is_away
        self.presence.told(stamp_ns, views)

    @property
    def body(self) -> SegmentedBody:
        """Return the body with its current lengths, some of which may have been learnt."""
        return self.subject.body if self.tracker is None else self.tracker.body

    def take_body(self, body: SegmentedBody) -> None:
        """Continue with other segment lengths."""
        self.subject = replace(self.subject, body=body)
        self.weighing = self.weighing.with_body(body)
        if self.tracker is not None:
            self.tracker.take_body(body)

    def restart(self) -> None:
        """Forget the motion after a jump of timestamps. Keep what is known about the person."""
        self.seen, self._alone = PersonSamples(), None
        self.tracker = None if self.tracker is None else self.tracker.begun_anew()
        self.presence, self._returns = SubjectPresence(), False
        self.behind, self._without, self._unseen = {}, 0, 0

    def at_rest(self) -> PersonState:
        """Return a copy without the motion so far, to continue after a pause."""
        found = copy.copy(self)
        found.fitting, found.behind, found._alone = self.fitting.at_rest(), {}, None
        found.tracker = None if self.tracker is None else self.tracker.at_rest()
        return found

    def flush(self) -> list[BodyState]:
        """Return the bodies of the instants that are still within the lag."""
        return [] if self.tracker is None else self.tracker.flush()

    def _source(self, people: object, joints: object, used: object) -> int:
        if people:
            return BodySource.TRACK if self.of_track else BodySource.VIEWS
        if joints is not None:
            return BodySource.JOINTS
        return BodySource.IMUS if used else BodySource.PREDICTED

    def _begins(self, views: int, seen: bool, used: int) -> bool:
        """Return whether there are data with which a body can begin.

        IMUs alone suffice once cameras are no longer waited for.
        """
        if seen and (views != 1 or self._unseen >= self._several_s * self._config.rate_hz):
            return True
        self._unseen += 1
        waited = self._unseen / self._config.rate_hz > self._awaited_s or not len(self.weighing.rotations)
        return waited and used > 0

    def _seen_at(self, stamp_ns: int, half_period_ns: int) -> tuple[People, tuple[Array, Array] | None]:
        """Return the 2D poses by camera, and the 3D joints.

        The 2D poses do not contain joints that are known in 3D.
        """
        joints = self.seen.joints_at(stamp_ns, half_period_ns)
        told = None if joints is None else np.isfinite(joints[0]).all(-1)
        return self.seen.views_at(stamp_ns, half_period_ns, told), joints

    def _look(
        self, stamp_ns: int, half_period_ns: int, statistics: PoseStatistics, stride: int
    ) -> list[Notice]:
        """Solve from cameras alone, and compare the result with the IMUs. Return notices.

        The instant is so old that all its images have arrived. Otherwise earlier images would stand in for
        late ones. Poses would then be late, and the clock of the IMUs would seem to be off by the same time.
        """
        people, joints = self._seen_at(stamp_ns, half_period_ns)
        if self._alone is None and people:
            bare = replace(self.subject, devices=())
            self._alone = SubjectTracker(cameras_alone(self._config), bare, self.weighing, {})
        states = (
            self._alone.step(stamp_ns, NOTHING_MEASURED, people, joints, stride)
            if self._alone is not None and people
            else []
        )
        notices = self.fitting.learn(self.subject, states, self._config.rate_hz, statistics)
        if not self.fitting.looking:
            self._alone = None
        return notices

    def _remount(self, stamp_ns: int) -> list[BodyState]:
        """Continue with the IMUs whose mountings are known by now.

        Return the bodies that the previous tracker still held.
        """
        mounts = self.fitting.mounts(stamp_ns, self.subject)
        now = (self.fitting.heading or 0.0, tuple(sorted(mounts)))
        if now == (self._mounted or (now[0], ())):
            return []
        self._mounted = now
        self._mounted_devices = np.array([device.name in mounts for device in self.subject.devices], bool)
        if self.tracker is None:
            return []
        held, pose = self.tracker.flush(), self.tracker.expected()
        self.tracker = self.tracker.worn_otherwise(mounts, now[0])
        if pose is not None:
            self.tracker.begin_at(pose)
        return held

    def _new_tracker(self, stamp_ns: int) -> SubjectTracker:
        mounts = self.fitting.mounts(stamp_ns, self.subject)
        return SubjectTracker(self._config, self.subject, self.weighing, mounts, self.fitting.heading or 0.0)

    def _give_up(self) -> list[BodyState]:
        held = self.flush()
        if self.is_expected and self.tracker is not None:
            self.tracker = self.tracker.begun_anew()
        return held
