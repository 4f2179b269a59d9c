"""IMUs of one person: their measurements at an instant, their mountings, and their faults.

`RotationComparison` finds which device is on which segment. Each of two exchanged devices rotates like the
other's segment.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SegmentedBody
from panoptic_ros.domain.subjects import Device, Subject
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import mean_rotation, rotations_of, turn_about_z, vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.balance import BalanceEstimate, masses_of, t_pose_turns
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.mounting import MountingEstimate
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_ACCELERATIONS,
    Accelerations,
    PoseEvidence,
    RotationIncrements,
    no_anchor,
)
from panoptic_ros.stage import Notice

Array = np.ndarray

COMPARED_LOOKS = 25  # maximum number of observations of the mountings that are compared
# minimum number of observations: for the test for exchanged devices that needs motion, and for the test that
# does not
FEWEST, FEWEST_LABELS = 8, 4
# rad, minimum root mean square deviation from a constant mounting that indicates an exchanged device; soft
# tissue and camera errors cause less
ODD = 0.26
BETTER = 0.6  # maximum fraction of the deviation from a constant mounting that may remain after the exchange
# rad: minimum error with the stated mounting, and maximum error with the mounting of the other device
WRONG, RIGHT = 0.7, 0.5
GRAVITY = np.array([0.0, 0.0, 9.81])
LOOK_S = 0.2  # time between two observations of the mountings
# number of phases over which the observations of different people are spread; one observation takes half
# the processing time of an instant
IN_TURN = 4
LOOK_ITERATIONS = 10
# m: minimum length of a limb, and maximum distance of a joint that is considered on the limb's axis
LEAST_BONE, ON_AXIS = 0.15, 0.07


class DeviceExchange(NamedTuple):
    """Two devices, by number, that are on each other's segment.

    `mounts` are their mountings there, (3, 3) each, segment from device.
    """

    devices: tuple[int, int]
    mounts: tuple[Array, Array]


class RotationComparison:
    """Comparison of how devices rotate with how segments rotate according to cameras alone."""

    def __init__(self, count: int):
        self._looks: deque[tuple[Array, Array]] = deque(maxlen=COMPARED_LOOKS)
        self._count = count

    def look(self, frames: Array, orientations: Array, mounts: Array, unseen: Array) -> DeviceExchange | None:
        """Add an observation and return two exchanged devices, or None. A find clears all observations.

        There are two cases. If the names are exchanged, the data of each device fit the segment and the
        mounting of the other. If the devices themselves are exchanged, their rotations reveal it once the
        body moves.

        Args:
            frames: (N, 3, 3) of the stated segments of the N devices, from cameras alone.
            orientations: (N, 3, 3) world from device, NaN = not measured.
            mounts: (N, 3, 3) segment from device, as stated.
            unseen: (N, 3) axes of these segments about which cameras do not observe rotations, 0 = none.
        """
        self._looks.append((frames, orientations))
        seen, told = (np.array([look[k] for look in self._looks]) for k in (0, 1))
        found = self._names(seen, told, mounts, unseen) if len(seen) >= FEWEST_LABELS else None
        if found is None and len(seen) >= FEWEST:
            found = self._turns(seen, told)
        if found is not None:
            self._looks.clear()
        return found

    def _names(self, seen: Array, told: Array, mounts: Array, unseen: Array) -> DeviceExchange | None:
        """Return two devices whose data fit the segment and the mounting of each other, or None."""
        # axes: observation, segment, device, 3, 3
        goals = told[-FEWEST_LABELS:, None] @ mounts.swapaxes(1, 2)[None, :, None]
        turned = np.ascontiguousarray(seen[-FEWEST_LABELS:, :, None].swapaxes(-1, -2) @ goals)
        apart = np.linalg.norm(vectors_of(turned.reshape(-1, 3, 3)), axis=-1).reshape(turned.shape[:3])
        along = np.einsum("pi,lpdij,pj->lpd", unseen, turned, unseen)  # cosine between bone directions
        points = np.linalg.norm(unseen, axis=-1)[:, None] > 0.0
        apart = np.where(points, np.arccos(np.clip(along, -1.0, 1.0)), apart)
        off = np.median(np.where(np.isfinite(apart), apart, 0.0), axis=0)
        wrong = np.flatnonzero(np.diag(off) > WRONG).tolist()
        pairs = [(max(off[i, j], off[j, i]), i, j) for i in wrong for j in wrong if i < j]
        worst, i, j = min(pairs, default=(np.inf, 0, 0))
        return DeviceExchange((i, j), (mounts[j], mounts[i])) if worst < RIGHT else None

    def _turns(self, seen: Array, told: Array) -> DeviceExchange | None:
        own, _ = _scatter(seen, told)
        odd = np.flatnonzero(own > ODD)
        pairs = [(i, j) for i in odd for j in odd if i < j]
        if not pairs:
            return None
        first, second = np.array(pairs).T
        there, mounts_i = _scatter(seen[:, second], told[:, first])
        here, mounts_j = _scatter(seen[:, first], told[:, second])
        share = (there + here) / (own[first] + own[second])
        best = int(share.argmin())
        if share[best] >= BETTER:
            return None
        i, j = pairs[best]
        return DeviceExchange((int(i), int(j)), (mounts_i[best], mounts_j[best]))


def _scatter(seen: Array, told: Array) -> tuple[Array, Array]:
    """Return the root mean square deviation (N,) rad from a constant mounting, and this mounting (N, 3, 3).

    The deviation is 0 where there are too few observations.

    Args:
        seen: (observations, N, 3, 3), frames of the segments.
        told: (observations, N, 3, 3), orientations of the devices; NaN = not measured.
    """
    turned = seen.swapaxes(-1, -2) @ told
    there = np.isfinite(turned).all((-1, -2))
    turned = np.where(there[..., None, None], turned, 0.0)  # zeros do not change the direction of a mean
    middle = mean_rotation(turned)
    apart = np.where(there[..., None, None], turned @ middle.swapaxes(-1, -2), np.eye(3))
    squares = (vectors_of(apart.reshape(-1, 3, 3)) ** 2).sum(-1).reshape(there.shape).sum(0)
    count = there.sum(0)
    return np.where(count < FEWEST, 0.0, np.sqrt(squares / np.maximum(count, 1))), middle


class WornDevices:
    """Devices of one person by number, in the order of the subject.

    Attributes:
        names, segments, mounts: (N,), (N,) and (N, 3, 3), the current assignment and mountings, uncorrected.
        accelerated, pushes: (N,) and (N, 3) m/s^2, the devices that measured an acceleration at the previous
            instant, and these accelerations in the world.

    Args:
        mounts: (3, 3) segment from device, by name, of all devices in use.
        heading: rad, rotation about the vertical from the IMUs' inertial frame to the world.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        subject: Subject,
        chain: Chain,
        mounts: dict[str, Array],
        heading: float,
    ):
        self._config, self._subject, self._chain = config, subject, chain
        used = [k for k, d in enumerate(subject.devices) if d.name in mounts]
        self._rows = np.array(used, np.int64)  # rows of the devices in use among those of the subject
        self._devices = [subject.devices[k] for k in used]
        self.names = [d.name for d in self._devices]
        self.mounts = np.array([mounts[d.name] for d in self._devices]).reshape(-1, 3, 3)
        self.segments = np.array([d.segment for d in self._devices], np.int64)
        self.positions = np.array([d.position for d in self._devices]).reshape(-1, 3)
        self._turn = turn_about_z(heading)
        self._unseen = unseen_axes(subject.body)
        self.mounting = self._fresh_mounting()
        self._balance = self._fresh_balance()
        self._wearing = RotationComparison(len(self._devices))
        self._since_look = LOOK_S * (subject.id % IN_TURN) / IN_TURN
        self._notices: list[Notice] = []
        self._told: set[tuple[str, str]] = set()
        self.forget()

    def orientations(self, measured: ImuMeasurements) -> tuple[Array, Array]:
        """Return the devices (M,) with an orientation, and their segments' orientations (M, 3, 3).

        They do not contain the corrections of `MountingEstimate`.

        Args:
            measured: Measurements of all of the subject's devices.
        """
        worn = measured.rows(self._rows)
        which = np.flatnonzero(worn.oriented)
        goals = self._turn @ worn.orientations[which] @ self.mounts[which].swapaxes(1, 2)
        return which, goals @ rotations_of(self._balance.turns[which])

    def spreads(self, which: Array) -> Array:
        """Return the standard deviations (M,) rad of their corrected orientations."""
        if self._config.mounting:
            found: Array = self.mounting.spreads[which]
            return found
        return np.full(len(which), math.radians(self._config.orientation_sd))

    def turning(self, which: Array, goals: Array, stride: int = 1) -> RotationIncrements:
        """Return the rotations of the segments since the previous instant, `stride` periods ago."""
        known = self._oriented[which]
        both = which[known]
        changes = goals[known] @ self._goals[both].swapaxes(1, 2)
        spread = math.radians(self._config.turn_sd) / math.sqrt(self._config.rate_hz / stride)
        return RotationIncrements(self.segments[both], changes, np.full(len(both), spread**-2))

    def accelerations(self, relative: bool, stride: int = 1) -> Accelerations:
        """Return the accelerations at the previous instant.

        Each stands for the mean over the neighbouring time steps of `stride` periods. Longer steps therefore
        get lower weights.

        Args:
            relative: True if the acceleration of the whole body is not to be trusted.
        """
        which = np.flatnonzero(self.accelerated)
        if not len(which) or (relative and len(which) < 2):
            return NO_ACCELERATIONS
        weight = (stride * self._config.acceleration_sd) ** -2
        return Accelerations(
            self.segments[which],
            self.positions[which],
            self.pushes[which],
            np.full(len(which), weight),
            self._config.acceleration_scale**2,
            relative,
        )

    def shaken(self) -> dict[int, float]:
        """Return the magnitudes of accelerations, m/s^2, at the previous instant, by segment."""
        which = np.flatnonzero(self.accelerated)
        sizes = np.linalg.norm(self.pushes[which], axis=-1)
        return dict(zip(self.segments[which].tolist(), sizes.tolist()))

    def remember(self, measured: ImuMeasurements, which: Array, goals: Array) -> None:
        """Keep the data of this instant that the next instant needs."""
        self._take_forces(measured.rows(self._rows))
        self._oriented = np.zeros(len(self._devices), bool)
        self._oriented[which] = True
        self._goals = np.empty((len(self._devices), 3, 3))
        self._goals[which] = goals

    def forget(self) -> None:
        """Discard the data of the previous instant."""
        count = len(self._devices)
        self.accelerated, self.pushes = np.zeros(count, bool), np.zeros((count, 3))
        self._oriented, self._goals = np.zeros(count, bool), np.zeros((count, 3, 3))

    def passed(self, seconds: float) -> None:
        """Record the time since the previous instant, s."""
        self._since_look += seconds

    def look(
        self,
        measured: ImuMeasurements,
        pose: Pose,
        seen: PoseEvidence,
        views: int,
        oriented: tuple[Array, Array],
    ) -> None:
        """Learn at intervals how devices are mounted.

        Args:
            seen: All evidence except the orientations.
            views: Number of views that see the person.
            oriented: See `orientations`.
        """
        which, goals = oriented
        if not views or not len(which) or not self._config.mounting or self._since_look < LOOK_S - 1e-9:
            return
        self._since_look = 0.0
        if views >= 2 and self._exchanged(measured.rows(self._rows), pose, seen):
            return
        self.mounting.look(pose, seen, (goals, which), views > 1)
        self._tell_corrections()

    def weigh(self, stamp_ns: int, pose: Pose, loads: Array, speed: Array) -> None:
        """Learn at intervals from the balance of a person whom no camera has seen.

        Cameras hold more information, so balance is not used once they have seen the person.

        Args:
            stamp_ns: Timestamp, ns. Nothing is learnt up to the end of the T-pose.
            loads: (G,) load of each ground segment, see `BalanceEstimate`.
            speed: (2,) m/s, of the body.
        """
        # people hold a T-pose for the mountings; it is not how they usually stand
        stand = self._subject.t_pose
        held = stand is not None and stamp_ns <= stand.to_ns
        if held or self.mounting.looks or not self._config.mounting:
            return
        if not loads.any() or self._since_look < LOOK_S - 1e-9:
            return
        places, frames = place_all(self._chain, pose.root[None], pose.turns[None])
        self._balance.look(places[0], frames[0], loads, speed, self._since_look)
        self._since_look = 0.0

    def take_chain(self, chain: Chain) -> None:
        """Continue with other segment lengths."""
        self._chain = chain
        self.mounting.take_chain(chain)
        self._balance.take_chain(chain)

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        found, self._notices = self._notices, []
        return found

    def _fresh_mounting(self) -> MountingEstimate:
        return MountingEstimate(self._config, self._chain, self.segments, self._unseen[self.segments])

    def _fresh_balance(self) -> BalanceEstimate:
        model, spread = self._subject.body.model, math.radians(self._config.mounting_sd)
        # mountings from a T-pose
        told = np.repeat(np.array([d.mount is None for d in self._devices], bool), 3)
        covariance = t_pose_turns(model.parents, self.segments, spread)
        covariance[~told] = covariance[:, ~told] = 0.0
        covariance += np.diag(np.where(told, math.radians(self._config.strap_sd), spread) ** 2)
        ground = np.array([model.index(name) for name in model.ground], np.int64)
        return BalanceEstimate(self._chain, self.segments, masses_of(model.names), ground, covariance)

    def _take_forces(self, worn: ImuMeasurements) -> None:
        """Compute the accelerations (N, 3) m/s^2 in the world, without gravity (eq. 12)."""
        turn = turn_about_z(self.mounting.heading) @ self._turn
        self.pushes = (turn @ worn.orientations @ worn.forces[..., None])[..., 0] - GRAVITY
        self.accelerated = worn.there & np.isfinite(self.pushes).all(-1)

    def _exchanged(self, worn: ImuMeasurements, pose: Pose, seen: PoseEvidence) -> bool:
        """Exchange two devices that cameras show on each other's segment; return True if there were any."""
        alone, size = pose.copy(), 3 * len(pose.turns) + 3
        nothing = no_anchor(len(pose.turns))
        solve_pose(self._chain, alone, seen, nothing, LOOK_ITERATIONS, np.empty((size, size)))
        frames = place_all(self._chain, alone.root[None], alone.turns[None])[1][0]
        told = self._turn @ np.where(worn.there[:, None, None], worn.orientations, np.nan)
        found = self._wearing.look(frames[self.segments], told, self.mounts, self._unseen[self.segments])
        if found is None:
            return False
        (i, j), names = found.devices, self._subject.body.model.names
        text = f"is on {names[self.segments[j]]}, and {self._devices[j].name} on {names[self.segments[i]]}"
        self._tell("swapped", self._devices[i], f"{text}: the two are swapped")
        for values in (self.segments, self.positions):
            values[[i, j]] = values[[j, i]]
        self.mounts[[i, j]] = found.mounts
        self.mounting = self._fresh_mounting()
        self.forget()
        return True

    def _tell_corrections(self) -> None:
        """Add notices of mistaken or slipped devices and of a wrong heading, once each."""
        names = self._subject.body.model.names
        for k in self.mounting.slipped:
            text = f"has slipped on {names[self.segments[k]]}; its mounting is estimated again"
            self._tell("strap", self._devices[k], text)
        for k in np.flatnonzero(self.mounting.mistaken).tolist():
            off = math.degrees(float(np.linalg.norm(self.mounting.mountings[k])))
            text = f"sits on {names[self.segments[k]]} about {off:.0f} deg off its mounting; corrected"
            self._tell("mounting", self._devices[k], text)
        stated = self._subject.heading_known and all(d.mount is not None for d in self._devices)
        # otherwise the heading also contains the error of the person's facing in the T-pose
        if stated and self.mounting.heading_off:
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


def unseen_axes(body: SegmentedBody) -> Array:
    """Return the axes (S, 3) about which cameras do not observe rotations of a segment; 0 = no such axis.

    Segments with a single bone, and no joint of the detector beyond or beside the bone, have such an axis.
    """
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
        ]
        further = any(parents[k] == end for k in range(len(parents)))
        if not further and all(np.linalg.norm(o) < ON_AXIS for o in beyond):
            found[s] = offsets[end] / lengths[0]
    return found
