"""Solver for one designated person, one instant at a time.

`RecentInstants` holds the instants that were solved recently, and finds those that are older than the lag. A
late stage leaves out instants, so their spacing varies. `acceleration_goals` is the acceleration term of
Malleson et al. 2020, eq. 13. It returns the positions of sites that the accelerations of their IMUs imply.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.segments import SegmentedBody
from panoptic_ros.domain.subjects import BodyState, Subject
from panoptic_ros.geometry.chain import Pose, place_all, place_segments
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.between import IncrementEvidenceBuilder
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder, NoiseLevel
from panoptic_ros.kinematics.body.lengths import LengthEstimate, LengthTransition
from panoptic_ros.kinematics.body.sight import ExpectedJoints, People
from panoptic_ros.kinematics.body.start import first_pose, middle_of
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.devices import WornDevices
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.mounting import MountingEstimate
from panoptic_ros.kinematics.pose.covariance import segment_covariances
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import NO_TURNS, PointTargets, PoseEvidence, no_anchor
from panoptic_ros.kinematics.pose.window import AccelerationModel, PoseWindow

Array = np.ndarray

KEPT_INSTANTS = 64
# s between observations of lengths; number of observations before the first change
LENGTH_LOOK_S, LENGTH_LOOKS = 0.2, 10
KEPT = 2  # instants, about 0.05 s, for which backward information is reused before it is computed again
SAME_LENGTHS = 0.002  # m, change of lengths below which learning ends


class RecentInstants:
    """Timestamps of recent instants, and the number of periods since the instant before each."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=KEPT_INSTANTS)
        self._strides: deque[int] = deque(maxlen=KEPT_INSTANTS)
        self._held = 0  # number of instants whose bodies were not returned yet

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, stride: int) -> None:
        """Append an instant."""
        self._stamps.append(stamp_ns)
        self._strides.append(stride)
        self._held += 1

    def stamp(self, back: int) -> int:
        """Return the timestamp, ns, of the instant `back` instants ago."""
        return self._stamps[-1 - back]

    def around(self, back: int) -> int:
        """Return the periods between the neighbours of the instant `back` instants ago.

        The newest instant has no later neighbour, so the interval then ends at the instant.
        """
        return self._strides[-1 - back] + (self._strides[-back] if back else 0)

    def due(self, lag: int) -> list[int]:
        """Return the pending instants that are at least `lag` periods ago, the oldest first.

        They are given as numbers of instants back, and are no longer pending afterwards.
        """
        found = []
        # age in periods of the oldest pending instant
        ago = sum(list(self._strides)[1 - self._held :]) if self._held > 1 else 0
        while self._held and ago >= lag:
            self._held -= 1
            found.append(self._held)
            ago -= self._strides[-self._held] if self._held else 0
        return found

    def left(self, lag: int) -> list[int]:
        """Return the pending instants that are newer than the lag, the oldest first.

        They are given as numbers of instants back.
        """
        return list(range(min(lag, self._held, len(self._stamps)) - 1, -1, -1))


def acceleration_goals(
    chain: Chain, poses: tuple[Pose, Pose], devices: WornDevices, weight: float, period: float
) -> PointTargets:
    """Return the positions of sites that give the measured accelerations, as targets.

    Args:
        poses: The two previous poses, the older one first.
        weight: Weight of the acceleration term, 1/(m/s^2)^2.
        period: s, between instants.
    """
    which = np.flatnonzero(devices.accelerated)
    segments, offsets = devices.segments[which], devices.positions[which]
    places, frames = place_all(
        chain, np.stack([pose.root for pose in poses]), np.stack([pose.turns for pose in poses])
    )
    sites = places[:, segments] + (frames[:, segments] @ offsets[..., None])[..., 0]
    information = weight / period**4 * np.tile(np.eye(3), (len(which), 1, 1))
    goals = 2.0 * sites[1] - sites[0] + period**2 * devices.pushes[which]
    return PointTargets(segments, offsets, goals, information, 1.0)


class SubjectTracker:
    """Solver for one person. `step` takes instants of the configured rate.

    Args:
        mounts: (3, 3) segment from device, by name, of all devices in use.
        heading: rad, rotation about the vertical from the IMUs' inertial frame to the world.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        subject: Subject,
        weighing: EvidenceBuilder,
        mounts: dict[str, Array],
        heading: float = 0.0,
    ):
        self.subject, self.weighing, self._config = subject, weighing, config
        self.body = subject.body  # with the lengths learnt so far
        self._chain = self.body.chain
        self.lengths: LengthEstimate | None = None
        if config.lengths and not subject.measured and not config.paper_weights:
            self.lengths = LengthEstimate(subject.body.model, subject.body.offsets, config.looks)
        self._lengthening: LengthTransition | None = None
        # (S, 3, 3) m^2 from uncertain lengths, frame of the first segment
        self._length_spreads: Array | None = None
        self._next_look, self._next_update = LENGTH_LOOK_S, LENGTH_LOOKS
        self._noise = NoiseLevel()
        self._count = len(self._chain.parents)
        self.devices = WornDevices(config, subject, self._chain, mounts, heading)
        self._between = self._fresh_between()
        self._window: PoseWindow | None = None
        self._pose: Pose | None = None
        self._before: Pose | None = None
        self._past = RecentInstants()
        self.iterations: deque[int] = deque(maxlen=1000)

    @property
    def mounting(self) -> MountingEstimate:
        """Return the estimate of the mountings of the devices."""
        return self.devices.mounting

    @property
    def started(self) -> bool:
        """Return whether there is a pose."""
        return self._pose is not None

    @property
    def offsets(self) -> Array:
        """Return the current joint offsets (S, 3) m, in the frames of the parents."""
        return self._chain.offsets

    def begun_anew(self) -> SubjectTracker:
        """Return a copy without pose and motion, which keeps lengths, errors of joints and mountings."""
        found = self.at_rest()
        found._pose = None
        found._between = self._fresh_between()
        found.devices.forget()
        return found

    def worn_otherwise(self, mounts: dict[str, Array], heading: float) -> SubjectTracker:
        """Return a copy without pose and motion, with other mountings and heading.

        The arguments are those of the class.
        """
        found = self.begun_anew()
        found.devices = WornDevices(self._config, self.subject, self._chain, mounts, heading)
        return found

    def begin_at(self, pose: Pose) -> None:
        """Start from this pose instead of an initial pose from the data."""
        self._pose = pose.copy()

    def at_rest(self) -> SubjectTracker:
        """Return a copy without motion, which continues after a pause from the last pose."""
        found = copy.copy(self)
        found._window, found._before, found._past = None, None, RecentInstants()
        return found

    def move_to(self, people: People, joints: tuple[Array, Array] | None) -> None:
        """Move the body to where cameras see it, after it was out of sight.

        One camera alone does not determine the position, so it does not move the body.
        """
        pose, sites = self.expected(), self.expected_sites()
        place = middle_of(self.weighing, people, joints)
        if pose is None or sites is None or place is None:
            return
        moved = pose.copy()
        moved.root[:] += place - (sites.middle if joints is not None else sites.middle_seen(people))
        self._pose, self._window, self._before = moved, None, None
        self.devices.forget()
        self._past = RecentInstants()

    def take_body(self, body: SegmentedBody) -> None:
        """Change to other lengths: gradually during motion, else at once."""
        if self._window is None:
            self._lengthening = None
            self._put_on(body)
        else:
            self._lengthening = LengthTransition(self._chain.offsets, body)

    def _put_on(self, body: SegmentedBody) -> None:
        self.body, self._chain, self.weighing = body, body.chain, self.weighing.with_body(body)
        self.devices.take_chain(self._chain)
        if self._window is not None:
            self._window.take_chain(self._chain)

    def expected(self, stride: int = 1) -> Pose | None:
        """Return the predicted pose `stride` periods after the last instant, or None without a pose."""
        if self._window is not None:
            return self._window.predicted(stride)
        return self._pose

    def expected_sites(self) -> ExpectedJoints | None:
        """Return the predicted positions of joints, or None without a pose."""
        pose = self.expected()
        if pose is None:
            return None
        frames, places = np.empty((self._count, 3, 3)), np.empty((self._count, 3))
        place_segments(self._chain, pose, frames, places)
        columns, segments, offsets = self.weighing.sites
        return ExpectedJoints(columns, places[segments] + (frames[segments] @ offsets[..., None])[..., 0])

    def step(
        self,
        stamp_ns: int,
        measured: ImuMeasurements,
        people: People,
        joints: tuple[Array, Array] | None = None,
        stride: int = 1,
    ) -> list[BodyState]:
        """Solve an instant.

        Args:
            measured: Measurements of the subject's devices, in their order.
            people: Points (K, 2) and scores (K,) of this person by camera.
            joints: 3D joints, where there are no 2D joints: positions (K, 3) m and covariances (K, 3, 3) m^2.
            stride: Number of periods since the previous instant.

        Returns:
            Final bodies: Those of the instants that are older than the lag and were not returned yet.
        """
        period = stride / self._config.rate_hz
        which, goals = self.devices.orientations(measured)
        if self._pose is None:
            if not people and joints is None and not len(which):
                return []
            goals_now = self.mounting.corrected(goals, which)
            oriented = self.devices.segments[which], goals_now
            self._pose = first_pose(self.weighing, self.subject, people, oriented, joints)
        self._between.passed(period, bool(people) or joints is not None)
        if self._lengthening is not None:
            self._put_on(self._lengthening.after(period))
            self._lengthening = None if self._lengthening.is_over else self._lengthening
        guess = self.expected(stride)
        assert guess is not None
        views = self.weighing.views(people, guess.root, self._noise.level)
        turns = self.weighing.turns(
            self.devices.segments[which], self.mounting.corrected(goals, which), self.devices.spreads(which)
        )
        points = self.weighing.points(joints)
        evidence = self.weighing.evidence(views, turns, points)
        root = self._pose.root.copy()
        if self._config.window:
            self._step_window(guess, evidence, (which, goals), stride)
        else:
            self._step_alone(evidence, period)
        assert self._pose is not None
        seen = self.weighing.evidence(views, NO_TURNS, points)
        self.devices.passed(period)
        self.devices.look(measured, self._pose, seen, len(people), (which, goals))
        if not people and joints is None:
            speed = (self._pose.root - root)[:2] / period
            self.devices.weigh(stamp_ns, self._pose, self._between.loads, speed)
        self.devices.remember(measured, which, goals)
        self._learn_lengths(evidence, len(people), period)
        if self._config.noise_level:
            self._noise.learn(views, self._chain, self._pose, period)
        self._past.add(stamp_ns, stride)
        return self._final()

    def flush(self) -> list[BodyState]:
        """Return the bodies of the instants that are still within the lag."""
        if self._window is None:
            return []
        poses = self._window.smoothed()
        return [self._smoothed_state(poses, back) for back in self._past.left(self._lag)]

    @property
    def _lag(self) -> int:
        return round(self._config.lag * self._config.rate_hz) if self._config.window else 0

    def _fresh_between(self) -> IncrementEvidenceBuilder:
        return IncrementEvidenceBuilder(self._chain, self.weighing, self._config.rate_hz)

    def _learn_lengths(self, evidence: PoseEvidence, views: int, period: float) -> None:
        """Observe lengths at intervals, and apply the result whenever the number of observations has doubled.

        Learning ends once lengths no longer change.
        """
        self._next_look -= period
        if self.lengths is None or views < 2 or self._next_look > 1e-9:
            return
        assert self._pose is not None
        self._next_look = LENGTH_LOOK_S
        self.lengths.look(self._chain, self._pose, evidence)
        self._length_spreads = self.lengths.spreads()
        if self.lengths.looks >= self._next_update:
            self._next_update *= 2
            change = self.lengths.update()
            body = self.subject.body
            self.take_body(body.with_offsets(dict(zip(body.model.names, self.lengths.offsets()))))
            if change < SAME_LENGTHS and self.lengths.looks > LENGTH_LOOKS:
                self.lengths = None

    def _step_window(
        self, guess: Pose, evidence: PoseEvidence, oriented: tuple[Array, Array], stride: int
    ) -> None:
        assert self._pose is not None
        period = 1.0 / self._config.rate_hz
        if self._window is None:
            motion = AccelerationModel(
                self._config.root_acceleration, self._config.joint_acceleration, period
            )
            self._window = PoseWindow(self._chain, self._pose, motion, self._lag)
            guess = self._window.predicted(stride)
        body, begun = (self._chain, self._pose), len(self._past) >= 2
        between = self._between.told(self.devices, oriented, body, begun, stride)
        evidence = evidence._replace(weight=min(stride * period / self._config.error_time, 1.0))
        self._pose = self._window.step(guess, evidence, between, self._config.iterations)
        self.iterations.append(self._window.iterations)

    def _step_alone(self, evidence: PoseEvidence, period: float) -> None:
        assert self._pose is not None
        accelerated = self.devices.accelerated.any()
        if self._config.paper_acceleration > 0.0 and self._before is not None and accelerated:
            poses, weight = (self._before, self._pose), self._config.paper_acceleration
            goals = acceleration_goals(self._chain, poses, self.devices, weight, period)
            evidence = evidence._replace(points=goals)
        before = self._pose.copy()
        size = 3 + 3 * self._count
        _, done = solve_pose(
            self._chain,
            self._pose,
            evidence,
            no_anchor(self._count),
            self._config.iterations,
            np.empty((size, size)),
        )
        self._before = before
        self.iterations.append(done)

    def _final(self) -> list[BodyState]:
        assert self._pose is not None
        if self._window is None:
            places, frames = place_all(self._chain, self._pose.root[None], self._pose.turns[None])
            return [BodyState(self._past.stamp(0), self.subject.id, places[0], frames[0])]
        due = self._past.due(self._lag)
        poses = self._window.smoothed() if due else []
        return [self._smoothed_state(poses, back) for back in due]

    def _smoothed_state(self, poses: Sequence[Pose], back: int) -> BodyState:
        """Return the body `back` instants ago.

        Args:
            poses: Smoothed poses, the newest first.
        """
        assert self._window is not None
        around = [poses[max(back - 1, 0)], poses[back], poses[back + 1]]
        places, frames = place_all(
            self._chain, np.array([pose.root for pose in around]), np.array([pose.turns for pose in around])
        )
        rate = self._config.rate_hz / self._past.around(back)
        spins = rate * vectors_of(np.ascontiguousarray(frames[0] @ frames[2].swapaxes(1, 2)))
        kept = KEPT if back == self._lag else 0
        covariance = self._window.covariance(back, self._config.lasting_share, kept)
        spreads = segment_covariances(self._chain, poses[back], covariance)
        if self._length_spreads is not None:
            hips = frames[1, 0]
            spreads[:, :3, :3] += hips @ self._length_spreads @ hips.T
        return BodyState(
            self._past.stamp(back),
            self.subject.id,
            places[1],
            frames[1],
            rate * (places[0] - places[2]),
            spins,
            spreads,
        )
