"""One person while data come: what was seen, how the IMUs sit, and the body that is solved from both."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.bodies import BodySource
from panoptic_ros.domain.segments import Body
from panoptic_ros.domain.subjects import BodyState, Instant, Subject
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import cameras_alone
from panoptic_ros.kinematics.imus.fitting import ImuFitting
from panoptic_ros.kinematics.imus.measured import NOTHING_MEASURED, Measured
from panoptic_ros.kinematics.people.presence import Presence
from panoptic_ros.kinematics.people.seen_people import SeenPerson, SeenPoints
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.stage import Notice

Array = np.ndarray
LOST_S = 0.5  # without any data, after which a body is given up
AWAITED_S = 2.0  # for which somebody whom no camera has seen yet is waited for
SEVERAL_S = 0.5  # for which a recording of several cameras waits for a second view
COMPLETE_NS = 100_000_000  # ago: by then all views have come
AGAIN_S = 1.0  # without cameras, after which the place is taken from what they see


class Behind(NamedTuple):
    """What an instant of a body rests on: `BodySource`, numbers of cameras and devices."""

    source: int
    views: int
    devices: int


class Person:
    """A designated person, or somebody who is tracked.

    Args:
        joint_names: (K,) of the detections.
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
        self.weighing = Weighing(config, subject, statistics, rig, joint_names)
        self.seen = SeenPerson()
        self.fitting = ImuFitting(config, subject)
        self.tracker: SubjectTracker | None = None
        self.behind: dict[int, Behind] = {}  # by stamp, of instants that are not given yet
        self.of_track = False  # the newest 2D people are those of a track
        self.came = False  # was ever seen, or felt by IMUs
        self.worn = frozenset(device.name for device in subject.devices)
        self._alone: SubjectTracker | None = None  # from cameras alone, to compare IMUs with
        self._mounted: tuple[float, tuple[str, ...]] | None = None  # what the tracker's IMUs are
        self._mounted_devices = np.zeros(len(subject.devices), bool)  # which of the subject's these are
        self.presence = Presence()
        self._returns = False  # is seen again, maybe elsewhere
        self._without = 0  # instants without any data
        self._unseen = 0  # instants without cameras
        self._awaited_s, self._lost_s = AWAITED_S, LOST_S
        self._several_s = 0.0  # for which one view waits for another

    def settle(self, heading: float, mounts: dict[str, Array], cameras: int) -> None:
        """Go by what a recording has told as a whole: how the IMUs sit and lie in space, see `ImuFitting`.

        Where there are cameras they are waited for to the end, and a body begins with two views, or with one
        after a while. One camera alone does not tell whether somebody is back who was out of sight, so there
        a body goes on.
        """
        self.fitting.settle(heading, mounts)
        self._awaited_s = math.inf if cameras else 0.0
        self._lost_s = math.inf if cameras == 1 else LOST_S
        self._several_s = SEVERAL_S if cameras > 1 else 0.0

    def step(
        self,
        stamp_ns: int,
        measured: Measured,
        half_period_ns: int,
        statistics: PoseStatistics,
        stride: int = 1,
    ) -> tuple[list[BodyState], list[Notice]]:
        """Solve an instant: bodies that are final, of the instant that is the lag ago, and notices.

        Args:
            measured: by the person's devices. half_period_ns: for so long a sample alone counts.
            statistics: of poses. stride: periods since the instant before.
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
        self.behind[stamp_ns] = Behind(int(self._source(people, joints, used)), len(people), used)
        return done, notices

    def feel(self, stamp_ns: int, measured: Measured) -> list[Notice]:
        """What the person's devices measured at an instant."""
        return self.fitting.take(stamp_ns, self.subject, measured)

    @property
    def missed(self) -> bool:
        """Whether there have been no data of the person for so long that the body was given up."""
        return self._without > self._lost_s * self._config.rate_hz

    def see(self, seen: SeenPoints, camera: int, of_track: bool) -> None:
        """A camera has seen the person; of_track: in a view that its track holds."""
        self.seen.see(camera, seen)
        self.of_track = of_track

    @property
    def is_expected(self) -> bool:
        """Whether there is a body that tells where the person is expected."""
        return self.tracker is not None and self.tracker.started

    @property
    def is_new(self) -> bool:
        """Whether nothing tells where the person is: it has not been seen, or not since time began anew."""
        return not (self.is_expected or self.presence.is_away)

    def look(self, instant: Instant, is_seen: bool, expected: Array | None) -> None:
        """Views without a track of the person have been looked through, see `Presence.saw`."""
        self._returns |= is_seen and self.presence.is_away
        self.presence.saw(instant, is_seen, expected)

    def follow(self, stamp_ns: int, views: int) -> None:
        """A track holds the person in so many views."""
        self._returns |= self.presence.is_away
        self.presence.told(stamp_ns, views)

    @property
    def body(self) -> Body:
        """With the lengths by which the person is solved now, of which some may have been learnt."""
        return self.subject.body if self.tracker is None else self.tracker.body

    def take_body(self, body: Body) -> None:
        """Go on with other lengths."""
        self.subject = replace(self.subject, body=body)
        self.weighing = self.weighing.with_body(body)
        if self.tracker is not None:
            self.tracker.take_body(body)

    def restart(self) -> None:
        """Time goes on elsewhere: forget the motion, keep what is known of the person."""
        self.seen, self._alone = SeenPerson(), None
        self.tracker = None if self.tracker is None else self.tracker.begun_anew()
        self.presence, self._returns = Presence(), False
        self.behind, self._without, self._unseen = {}, 0, 0

    def at_rest(self) -> Person:
        """The same as it goes on after a pause."""
        found = copy.copy(self)
        found.fitting, found.behind, found._alone = self.fitting.at_rest(), {}, None
        found.tracker = None if self.tracker is None else self.tracker.at_rest()
        return found

    def flush(self) -> list[BodyState]:
        """Bodies of the instants that the lag still holds back."""
        return [] if self.tracker is None else self.tracker.flush()

    def _source(self, people: object, joints: object, used: object) -> int:
        if people:
            return BodySource.TRACK if self.of_track else BodySource.VIEWS
        if joints is not None:
            return BodySource.JOINTS
        return BodySource.IMUS if used else BodySource.PREDICTED

    def _begins(self, views: int, seen: bool, used: int) -> bool:
        """Whether there is something to begin with; without a camera, once nobody waits for one any more."""
        if seen and (views != 1 or self._unseen >= self._several_s * self._config.rate_hz):
            return True
        self._unseen += 1
        waited = self._unseen / self._config.rate_hz > self._awaited_s or not len(self.weighing.rotations)
        return waited and used > 0

    def _seen_at(self, stamp_ns: int, half_period_ns: int) -> tuple[People, tuple[Array, Array] | None]:
        """2D people by camera, and joints in space, which are left out of those."""
        joints = self.seen.joints_at(stamp_ns, half_period_ns)
        told = None if joints is None else np.isfinite(joints[0]).all(-1)
        return self.seen.views_at(stamp_ns, half_period_ns, told), joints

    def _look(
        self, stamp_ns: int, half_period_ns: int, statistics: PoseStatistics, stride: int
    ) -> list[Notice]:
        """Solve from cameras alone, and compare with the IMUs.

        Of an instant for which all images have come: where views are late and the image before stands for
        the instant, poses follow late, and the clock of the IMUs seems to be off by as much.
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
        """Solve with the IMUs whose mounting is known by now: bodies that the tracker before still held."""
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
