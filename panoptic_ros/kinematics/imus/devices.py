"""The IMUs on one person: what they tell at an instant, how they are worn, and what is wrong with them."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.domain.segments import Body
from panoptic_ros.domain.subjects import Device, Instant, Subject
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import turn_about_z
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.mounting import MountingEstimate
from panoptic_ros.kinematics.imus.wearing import Wearing
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_ACCELERATIONS,
    Accelerations,
    Evidence,
    Turning,
    no_anchor,
)
from panoptic_ros.stage import Notice

Array = np.ndarray
GRAVITY = np.array([0.0, 0.0, 9.81])
LOOK_S = 0.2  # between two looks at how devices are worn
LOOK_ITERATIONS = 10
LEAST_BONE, ON_AXIS = 0.15, 0.07  # m, of a limb; of a joint that is as good as on its axis


class WornDevices:
    """Devices by number, in the order of the subject.

    Attributes:
        names, segments, mounts: (N,), (N,) and (N, 3, 3), as they are taken to be worn now, uncorrected.

    Args:
        mounts: (3, 3) segment from device, by name, of all devices that are used.
        heading: rad, world from the IMUs' inertial frame, about the vertical.
    """

    def __init__(
        self, config: KinematicsConfig, subject: Subject, chain: Chain, mounts: dict[str, Array],
        heading: float,
    ):  # fmt: skip
        self._config, self._subject, self._chain = config, subject, chain
        self._devices = [d for d in subject.devices if d.name in mounts]
        self.names = [d.name for d in self._devices]
        self.mounts = np.array([mounts[d.name] for d in self._devices]).reshape(-1, 3, 3)
        self.segments = np.array([d.segment for d in self._devices], np.int64)
        self.positions = np.array([d.position for d in self._devices]).reshape(-1, 3)
        self._turn = turn_about_z(heading)
        self._unseen = unseen_axes(subject.body)
        self.mounting = self._fresh_mounting()
        self._wearing = Wearing(len(self._devices))
        self._since_look = 0.0
        self._notices: list[Notice] = []
        self._told: set[tuple[str, str]] = set()
        self.measured: dict[int, Array] = {}
        self._oriented: dict[int, Array] = {}

    def orientations(self, instant: Instant) -> tuple[Array, Array]:
        """Devices (M,) that tell an orientation, and of their segments (M, 3, 3), uncorrected."""
        worn = [(k, instant.readings[name].orientation) for k, name in self._there(instant)]
        which = np.array([k for k, turned in worn if np.isfinite(turned[0, 0])], np.int64)
        turned = np.array([turned for _, turned in worn if np.isfinite(turned[0, 0])]).reshape(-1, 3, 3)
        return which, self._turn @ turned @ self.mounts[which].swapaxes(1, 2)

    def spreads(self, which: Array) -> Array:
        """Standard deviations (M,) rad of their corrected orientations."""
        if self._config.mounting:
            found: Array = self.mounting.spreads[which]
            return found
        return np.full(len(which), math.radians(self._config.orientation_sd))

    def turning(self, which: Array, goals: Array, stride: int = 1) -> Turning:
        """How the segments turned since the instant before, so many periods ago."""
        both = [(k, goal @ self._oriented[k].T) for k, goal in zip(which, goals) if k in self._oriented]
        spread = math.radians(self._config.turn_sd) / math.sqrt(self._config.rate_hz / stride)
        return Turning(
            self.segments[[k for k, _ in both]], np.array([change for _, change in both]).reshape(-1, 3, 3),
            np.full(len(both), spread**-2),
        )  # fmt: skip

    def accelerations(self, relative: bool, stride: int = 1) -> Accelerations:
        """Of the instant before; `relative`: that of the whole body is not to be trusted.

        They stand for the mean over the steps of time around it, of so many periods: the longer, the less
        they tell.
        """
        if not self.measured or (relative and len(self.measured) < 2):
            return NO_ACCELERATIONS
        which = np.array(sorted(self.measured))
        weight = (stride * self._config.acceleration_sd) ** -2
        return Accelerations(
            self.segments[which], self.positions[which], np.array([self.measured[k] for k in which]),
            np.full(len(which), weight), self._config.acceleration_scale**2, relative,
        )  # fmt: skip

    def shaken(self) -> dict[int, float]:
        """Accelerations, m/s^2, of the instant before by segment."""
        return {int(self.segments[k]): float(np.linalg.norm(a)) for k, a in self.measured.items()}

    def remember(self, instant: Instant, which: Array, goals: Array) -> None:
        """What the next instant needs of this one."""
        self.measured = self._world_forces(instant)
        self._oriented = dict(zip(which.tolist(), goals))

    def forget(self) -> None:
        """There was no instant before."""
        self.measured, self._oriented = {}, {}

    def passed(self, seconds: float) -> None:
        """So much time has passed since the instant before."""
        self._since_look += seconds

    def look(
        self, instant: Instant, pose: Pose, seen: Evidence, views: int, oriented: tuple[Array, Array]
    ) -> None:
        """Learn, now and then, how devices are worn.

        Args:
            seen: all but the orientations. views: that see the person. oriented: see `orientations`.
        """
        which, goals = oriented
        if not views or not len(which) or not self._config.mounting or self._since_look < LOOK_S - 1e-9:
            return
        self._since_look = 0.0
        if views >= 2 and self._exchanged(instant, pose, seen):
            return
        self.mounting.look(pose, seen, (goals, which), views > 1)
        self._tell_corrections()

    def take_chain(self, chain: Chain) -> None:
        """Go on with other lengths."""
        self._chain = chain
        self.mounting.take_chain(chain)

    def take_notices(self) -> list[Notice]:
        """What was found out since it was last asked."""
        found, self._notices = self._notices, []
        return found

    def _fresh_mounting(self) -> MountingEstimate:
        return MountingEstimate(self._config, self._chain, self.segments, self._unseen[self.segments])

    def _there(self, instant: Instant) -> list[tuple[int, str]]:
        """Number and name of the devices that tell something."""
        return [(k, d.name) for k, d in enumerate(self._devices) if d.name in instant.readings]

    def _world_forces(self, instant: Instant) -> dict[int, Array]:
        """Acceleration (3,) m/s^2 in the world by device, gravity taken off (eq. 12)."""
        worn = [(k, instant.readings[name]) for k, name in self._there(instant)]
        if not worn:
            return {}
        turn = turn_about_z(self.mounting.heading) @ self._turn
        turned = np.array([reading.orientation for _, reading in worn])
        forces = np.array([reading.force for _, reading in worn])
        values = (turn @ turned @ forces[..., None])[..., 0] - GRAVITY
        told = np.isfinite(values).all(-1)
        return {k: values[n] for n, (k, _) in enumerate(worn) if told[n]}

    def _exchanged(self, instant: Instant, pose: Pose, seen: Evidence) -> bool:
        """Take two devices for each other from now on, if that is what cameras say."""
        alone, size = pose.copy(), 3 * len(pose.turns) + 3
        nothing = no_anchor(len(pose.turns))
        solve_pose(self._chain, alone, seen, nothing, LOOK_ITERATIONS, np.empty((size, size)))
        frames = place_all(self._chain, alone.root[None], alone.turns[None])[1][0]
        told = np.full((len(self._devices), 3, 3), np.nan)
        for k, name in self._there(instant):
            told[k] = self._turn @ instant.readings[name].orientation
        found = self._wearing.look(frames[self.segments], told, self.mounts, self._unseen[self.segments])
        if found is None:
            return False
        (i, j), names = found.devices, self._subject.body.model.names
        text = f"is on {names[self.segments[j]]}, and {self._devices[j].name} on {names[self.segments[i]]}"
        self._tell("swapped", self._devices[i], f"{text}: taken for each other")
        for values in (self.segments, self.positions):
            values[[i, j]] = values[[j, i]]
        self.mounts[[i, j]] = found.mounts
        self.mounting = self._fresh_mounting()
        self.forget()
        return True

    def _tell_corrections(self) -> None:
        """Devices that are mistaken or slipped, and a heading that is off: each is told once."""
        names = self._subject.body.model.names
        for k in self.mounting.slipped:
            text = f"has slipped on {names[self.segments[k]]}; its mounting is found anew"
            self._tell("strap", self._devices[k], text)
        for k in np.flatnonzero(self.mounting.mistaken).tolist():
            off = math.degrees(float(np.linalg.norm(self.mounting.mountings[k])))
            text = f"sits on {names[self.segments[k]]} about {off:.0f} deg off its mounting; corrected"
            self._tell("mounting", self._devices[k], text)
        if self.mounting.heading_off:
            off = math.degrees(self.mounting.heading)
            self._tell("heading", None, f"the heading of the IMUs is about {off:.0f} deg off; corrected")

    def _tell(self, code: str, device: Device | None, text: str) -> None:
        name = "" if device is None else device.name
        if (code, name) in self._told:
            return
        self._told.add((code, name))
        line = f"subject {self._subject.id}: {name}{' ' if name else ''}{text}"
        values = {"subject": self._subject.id, "device": name}
        self._notices.append(Notice(f"kinematics.{code}", "warning", line, values))


def unseen_axes(body: Body) -> Array:
    """Axes (S, 3) of segments beyond whose one bone no joint of the detector lies: cameras do not see them
    turn about it. 0 for all others."""
    parents, offsets = body.model.parents, body.offsets
    found = np.zeros((len(parents), 3))
    for s in range(1, len(parents)):
        children = np.flatnonzero(parents == s)
        lengths = np.linalg.norm(offsets[children], axis=-1)
        if len(children) != 1 or lengths[0] < LEAST_BONE:
            continue
        end = int(children[0])
        beyond = [o for k, o in body.keypoints.values() if k == s] + [
            o for k, o in body.keypoints.values() if k == end and np.linalg.norm(o) > ON_AXIS
        ]  # fmt: skip
        further = any(parents[k] == end for k in range(len(parents)))
        if not further and all(np.linalg.norm(o) < ON_AXIS for o in beyond):
            found[s] = offsets[end] / lengths[0]
    return found
