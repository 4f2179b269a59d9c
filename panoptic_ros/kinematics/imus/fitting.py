"""Online estimation of the heading, clock offset and mountings of one person's IMUs."""

from __future__ import annotations

import copy

import numpy as np

from panoptic_ros.domain.subjects import BodyState, Subject
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import DeviceSignals, align, taken_over
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.t_pose import bent_line, heading_from_poses, t_pose_decides, t_pose_mount
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.stage import Notice

Array = np.ndarray
# time between estimates of heading and clock, and time after which there are no more
LOOK_S, LONGEST_S = 5.0, 15.0
BENT_S = 3.0  # minimum time of bending joints after the T-pose
STEP_S = 0.1  # s, maximum interval between two bodies of a person who is seen all the time in between
UNSEEN_S = 2.0  # time without a camera that sees the person, after which cameras do not determine the heading
# time for which samples are kept. A person whom cameras see once in UNSEEN_S has then been seen for
# LONGEST_S.
KEPT_S = LONGEST_S / STEP_S * UNSEEN_S


class ImuFitting:
    """Heading, clock and mounting of one person's IMUs.

    Attributes:
        heading: rad, world from the IMUs' inertial frame; None = not known yet.
        offset_ns: Offset, ns, that is added to their timestamps.
        looking: True while motion from cameras alone is still needed.
    """

    def __init__(self, config: KinematicsConfig, subject: Subject):
        self.heading = 0.0 if subject.heading_known else None
        self.offset_ns = 0
        self._clocks = config.clocks
        worn = bool(subject.devices)
        self.looking = worn and config.window and (config.clocks or not subject.heading_known)
        self._states: list[BodyState] = []
        self._stamps: list[int] = []
        self._turns: list[Array] = []  # orientations (D, 3, 3), and forces (D, 3), at all timestamps
        self._forces: list[Array] = []
        self._held: dict[str, list[Array]] = {}  # orientations in the T-pose, by device
        self._poseless: list[str] = []  # devices without samples in the T-pose
        self._settled: dict[str, Array] | None = None  # known mountings, which are not estimated
        # time in which cameras saw the person, and such time at the next estimate
        self._seen_s, self._next_s = 0.0, LOOK_S

    def settle(self, heading: float, mounts: dict[str, Array]) -> None:
        """Use known values: heading, rad, and mountings (3, 3) by device. Clocks are taken as correct."""
        self.heading, self._settled, self.looking = heading, mounts, False

    def at_rest(self) -> ImuFitting:
        """Return a copy without the motion so far.

        Motion from before a pause does not determine a clock that was stopped.
        """
        found = copy.copy(self)
        found._states, found._stamps, found._turns, found._forces = [], [], [], []
        found._seen_s, found._next_s = 0.0, LOOK_S
        return found

    def take(self, stamp_ns: int, subject: Subject, measured: ImuMeasurements) -> list[Notice]:
        """Add the measurements of the person's devices at an instant, and return notices."""
        if self._settled is not None:
            return []
        pose = subject.t_pose
        if pose is not None and pose.from_ns <= stamp_ns <= pose.to_ns:
            for d in np.flatnonzero(measured.oriented).tolist():
                self._held.setdefault(subject.devices[d].name, []).append(measured.orientations[d])
        if self.looking:
            there = measured.there[:, None]
            self._stamps.append(stamp_ns)
            self._turns.append(np.where(there[..., None], measured.orientations, np.nan))
            self._forces.append(np.where(there, measured.forces, np.nan))
        return self._missing(stamp_ns, subject)

    def mounts(self, stamp_ns: int, subject: Subject) -> dict[str, Array]:
        """Return the mountings (3, 3), segment from device, that are known by now.

        There are none before the heading is known.
        """
        if self._settled is not None:
            return self._settled
        if self.heading is None:
            return {}
        found, pose = {}, subject.t_pose
        for device in subject.devices:
            if device.mount is not None:
                found[device.name] = device.mount
            elif pose is not None and stamp_ns > pose.to_ns and device.name in self._held:
                found[device.name] = t_pose_mount(pose, self.heading, self._held[device.name])
        return found

    def learn(
        self, subject: Subject, states: list[BodyState], rate_hz: float, statistics: PoseStatistics
    ) -> list[Notice]:
        """Add motion from cameras alone, estimate heading and clock if it suffices, and return notices."""
        second = round(rate_hz)
        if len(self._stamps) >= round(KEPT_S * rate_hz) + second:  # reached while a T-pose lies ahead
            for kept in (self._stamps, self._turns, self._forces):
                del kept[:second]
        for state in states:
            since = 1e-9 * (state.stamp_ns - self._states[-1].stamp_ns) if self._states else 1.0 / rate_hz
            self._seen_s += min(since, STEP_S)
            self._states.append(state)
        seen_ns = self._states[-1].stamp_ns if self._states else self._stamps[0]
        if 1e-9 * (self._stamps[-1] - seen_ns) > UNSEEN_S:
            return self._without_cameras(subject, rate_hz, statistics)
        if self._seen_s < self._next_s - 0.5 / rate_hz:
            return []
        self._next_s += LOOK_S
        stamps, forces, turns = np.array(self._stamps), np.array(self._forces), self._turns_of(subject)
        felt = {name: DeviceSignals(stamps, own, forces[:, d]) for d, (name, own) in enumerate(turns.items())}
        found = align(subject, self._states, felt)
        if self._next_s <= LONGEST_S and (found is None or not found.enough):
            return []
        if found is None:
            return self._give_up(subject, "the person hardly moves")
        self._done()
        self.heading, self.offset_ns, lines = taken_over(subject, found, self._clocks)
        return [_notice("imu_aligned", "info", subject, line) for line in lines]

    def _without_cameras(self, subject: Subject, rate_hz: float, statistics: PoseStatistics) -> list[Notice]:
        """Estimate the heading from bending joints since the T-pose, if that determines the mountings."""
        why = "no camera sees enough of the person"
        if self.heading is not None or not t_pose_decides(subject):
            return self._give_up(subject, why)
        assert subject.t_pose is not None
        waited = 1e-9 * (self._stamps[-1] - subject.t_pose.to_ns)
        if waited < BENT_S or len(self._stamps) % round(rate_hz):
            return []
        heading = heading_from_poses(subject, statistics, self._turns_of(subject), self._held)
        if heading is None:
            return self._give_up(subject, f"{why}, and it hardly moves") if waited > LONGEST_S else []
        self._done()
        self.heading = heading
        return [_notice("imu_aligned", "info", subject, bent_line(heading))]

    def _turns_of(self, subject: Subject) -> dict[str, Array]:
        """Return the orientations (T, 3, 3) at all timestamps, by device."""
        turns = np.array(self._turns)
        return {device.name: turns[:, d].copy() for d, device in enumerate(subject.devices)}

    def _give_up(self, subject: Subject, why: str) -> list[Notice]:
        self._done()
        if self.heading is not None:
            return []
        self.heading = 0.0
        line = f"{why}, so the heading of its IMUs is assumed to be 0"
        return [_notice("imu_heading", "warning", subject, line)]

    def _done(self) -> None:
        self.looking = False
        self._states, self._stamps, self._turns, self._forces = [], [], [], []

    def _missing(self, stamp_ns: int, subject: Subject) -> list[Notice]:
        """Return notices of devices whose mounting no data determine, once per device."""
        pose, notices = subject.t_pose, []
        for device in subject.devices if len(self._held) + len(self._poseless) < len(subject.devices) else ():
            if device.mount is not None or device.name in (*self._held, *self._poseless):
                continue
            if pose is not None and stamp_ns <= pose.to_ns:
                continue
            self._poseless.append(device.name)
            why = "has no mount, and there is no t_pose" if pose is None else "has no samples in the T-pose"
            line = f"device {device.name} {why}; it is left out"
            notices.append(_notice("imu_mount", "warning", subject, line, device.name))
        return notices


def _notice(code: str, severity: str, subject: Subject, line: str, device: str = "") -> Notice:
    return Notice(
        f"kinematics.{code}",
        "warning" if severity == "warning" else "info",
        f"subject {subject.id}: {line}",
        {"device": device or f"subject {subject.id}"},
    )
