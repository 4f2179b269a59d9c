"""Refinement stage, with a correction by solved bodies for joints that few views see.

Solved bodies keep their bone lengths, and their poses stay human. The joints of a body differ from those of
the detector by an offset that is nearly constant in the frame of the hips. Offset and variance are learnt per
person and joint from joints that many views see.

The body depends in part on the same 2D joints, so body and skeleton are not independent. The fused joint
therefore keeps the better of both covariances. With IMUs, a body knows much more than two views, whose errors
persist. Then the measurement noise that smoothing removed is added back to the skeleton's covariance.

If one view or none sees a joint, both estimates are usually wrong. The skeleton keeps the position that more
views measured before; the body follows bone lengths and the usual motion of people. Their covariances
determine the weights. If both differ by more than their covariances explain, it is unknown which one is
wrong, and both covariances grow (Birge 1932).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import (
    JointState,
    PartMotions,
    PatchTrajectories,
    RefinedPoseSet,
    SkeletonModel,
    TimeShift,
    TrackedPoseSet,
    ViewSources,
)
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.domain.checks import known_good
from panoptic_ros.domain.of_all import selected
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.filter_bank import FilterBank
from panoptic_ros.refinement.joint_states import FILLED, MEASURED, MISSING, SmoothedJoints
from panoptic_ros.refinement.lag import LagSchedule
from panoptic_ros.refinement.records import FilterState, JointMeasurements, MotionStates, PeopleStatistics
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

WELL_SEEN = 3  # views; a joint of at least this number of views stays unchanged, and its offset is learnt
REACH_NS = 100_000_000  # ns, largest distance in time of a used body, and of two interpolated bodies
KEPT_NS = 500_000_000  # ns, time for which bodies are kept
# m per axis, prior standard deviation of a joint from the offset; weight of this prior, in observations
SPREAD, BELIEF = 0.02, 3.0
MEMORY = 50.0  # observations, memory of offsets and variances
CAUCHY = 3.0  # standard deviations, difference of body and skeleton that doubles both covariances
FILLED_SCORE = 0.25  # score of a filled joint that no view sees
Array = np.ndarray


class InstantBodies(NamedTuple):
    """Bodies of one instant.

    Args:
        stamp_ns: Timestamp.
        ids: (B,) ids of the people.
        devices: (B,) number of IMUs that each body used.
        points: (B, J, 3) m, world, keypoints.
        covariances: (B, J, 3, 3) m^2, of the keypoints.
        hips: (B, 3, 3) orientations of the hips, world from segment.
    """

    stamp_ns: int
    ids: Array
    devices: Array
    points: Array
    covariances: Array
    hips: Array


class BodyJointOffsets(NamedTuple):
    """Learnt offsets of the skeleton joints of one person from the joints of the body.

    Args:
        looks: (J,) number of observations.
        offsets: (J, 3) m, skeleton minus body, in the frame of the hips.
        variances: (J,) m^2 per axis, of single observations about the offset.
    """

    looks: Array
    offsets: Array
    variances: Array


class BodyFill:
    """Recent bodies, and the learnt offsets of skeleton joints from these bodies."""

    def __init__(self) -> None:
        self._kept: list[InstantBodies] = []
        self._learnt: dict[int, BodyJointOffsets] = {}

    def take(self, item: BodyStateSet, biases: Array, calibration: CalibrationErrors | None) -> None:
        """Add the bodies of one more instant; a timestamp that is not newer discards all earlier bodies.

        Covariances of bodies contain persistent errors. Skeletons have the same ones, so they are subtracted
        before the comparison.

        Args:
            biases: (J, 3, 3) m^2, covariances of the detector's biases.
            calibration: Errors of the rig's calibration; None = unknown.
        """
        if self._kept and item.stamp_ns <= self._kept[-1].stamp_ns:
            self._kept = []
        hips = from_quaternions(np.ascontiguousarray(item.orientations[:, 0]))
        points, spreads = item.keypoints, item.keypoint_covariances - biases
        if calibration is not None:
            spreads -= calibration.of_people(points, (), None)
        self._kept.append(InstantBodies(item.stamp_ns, item.ids, item.devices, points, spreads, hips))
        while self._kept[0].stamp_ns < item.stamp_ns - KEPT_NS:
            self._kept.pop(0)

    def fill(
        self, stamp_ns: int, ids: Array, judged: SmoothedJoints, views: Array, noises: Array, max_sigma: float
    ) -> None:
        """Learn offsets from joints that many views see, and correct all other joints in `judged`.

        Args:
            stamp_ns: Instant of the joints.
            ids: (P,) ids of the people.
            judged: Joints of the people, updated.
            views: (P, J) number of views behind measured joints.
            noises: (P, J, 3, 3) m^2, covariances of their latest measurements.
            max_sigma: m, largest standard deviation with which a body fills a missing joint.
        """
        for row, number in enumerate(ids.tolist()):
            body = self._at(stamp_ns, number)
            if body is None:
                continue
            points, spreads, hips, worn = body
            learnt = self._learnt.get(number) or nothing_learnt(len(points))
            well = (judged.states[row] == MEASURED) & (views[row] >= WELL_SEEN)
            apart = (judged.positions[row] - points) @ hips
            own = np.trace(judged.covariances[row] + noises[row], axis1=-2, axis2=-1) / 3.0
            self._learnt[number] = learnt = learn(learnt, apart, own, well & np.isfinite(apart).all(-1))
            placed = points + learnt.offsets @ hips.T
            noise = spreads + learnt.variances[:, None, None] * np.eye(3)
            _mend(judged, row, placed, noise, worn * noises[row], ~well, max_sigma)

    def _at(self, stamp_ns: int, number: int) -> tuple[Array, Array, Array, bool] | None:
        """Return the body of a person at an instant, or None if no body is within `REACH_NS`.

        The keypoints are interpolated or extrapolated from two bodies. Other values are those of the nearer
        body.

        Returns:
            keypoints: (J, 3) m.
            covariances: (J, 3, 3) m^2.
            hips: (3, 3), world from segment.
            worn: Whether the body used IMUs.
        """
        own = [(posed, rows[0]) for posed in self._kept if len(rows := np.flatnonzero(posed.ids == number))]
        if not own:
            return None
        after = next((k for k, (posed, _) in enumerate(own) if posed.stamp_ns >= stamp_ns), len(own) - 1)
        (begin, b), (end, e) = own[max(after - 1, 0)], own[after]
        near, n = (end, e) if abs(end.stamp_ns - stamp_ns) <= abs(begin.stamp_ns - stamp_ns) else (begin, b)
        if abs(near.stamp_ns - stamp_ns) > REACH_NS:
            return None
        points = near.points[n]
        if 0 < end.stamp_ns - begin.stamp_ns <= REACH_NS:
            share = (stamp_ns - begin.stamp_ns) / (end.stamp_ns - begin.stamp_ns)
            points = begin.points[b] + share * (end.points[e] - begin.points[b])
        return points, near.covariances[n], near.hips[n], bool(near.devices[n])


def nothing_learnt(joints: int) -> BodyJointOffsets:
    """Return the initial record of a person with this number of joints."""
    return BodyJointOffsets(np.zeros(joints), np.zeros((joints, 3)), np.full(joints, SPREAD**2))


def learn(learnt: BodyJointOffsets, apart: Array, own: Array, well: Array) -> BodyJointOffsets:
    """Return the record with one more observation of the joints that many views see.

    Args:
        apart: (J, 3) m, skeleton minus body in the frame of the hips.
        own: (J,) m^2 per axis, variance of the skeleton's joints, which is subtracted from that of `apart`.
        well: (J,) whether many views see the joint.
    """
    looks = learnt.looks + well
    far = np.where(well[:, None], apart - learnt.offsets, 0.0)
    gain = well * np.maximum(1.0 / np.maximum(looks, 1.0), 1.0 / MEMORY)
    slow = well * np.maximum(1.0 / (looks + BELIEF), 1.0 / MEMORY)
    more = np.maximum((far**2).mean(axis=-1) - np.where(well, own, 0.0), 0.0)
    variances = learnt.variances + slow * (more - learnt.variances)
    return BodyJointOffsets(looks, learnt.offsets + gain[:, None] * far, variances)


def _mend(
    judged: SmoothedJoints,
    row: int,
    placed: Array,
    noise: Array,
    measured: Array,
    asked: Array,
    max_sigma: float,
) -> None:
    """Fuse the joints of one person in `judged` with joints of the body, and fill missing joints from it.

    Args:
        row: Row of the person.
        placed: (J, 3) m, joints according to the body.
        noise: (J, 3, 3) m^2, covariances of `placed`.
        measured: (J, 3, 3) m^2, added to the covariances of the skeleton.
        asked: (J,) whether to correct the joint.
        max_sigma: m, largest standard deviation with which a body fills a missing joint.
    """
    told = asked & np.isfinite(placed).all(-1) & np.isfinite(noise).all((-2, -1))
    gone = judged.states[row] == MISSING
    sure = np.sqrt(np.trace(np.where(told[:, None, None], noise, 0.0), axis1=-2, axis2=-1) / 3.0) < max_sigma
    for j in np.flatnonzero(told & gone & sure).tolist():
        judged.positions[row, j], judged.covariances[row, j] = placed[j], noise[j]
        judged.states[row, j], judged.scores[row, j] = FILLED, FILLED_SCORE
    both = np.flatnonzero(told & ~gone)
    own, other = judged.covariances[row, both] + measured[both], noise[both]
    far = (placed[both] - judged.positions[row, both])[..., None]
    odd = (far.swapaxes(1, 2) @ np.linalg.solve(own + other, far))[:, 0, 0]
    less = growth(odd, CAUCHY)[:, None, None]
    own, other = own * less, other * less
    judged.positions[row, both] += (own @ np.linalg.solve(own + other, far))[..., 0]
    better = np.trace(other, axis1=-2, axis2=-1) < np.trace(own, axis1=-2, axis2=-1)
    judged.covariances[row, both] = np.where(better[:, None, None], other, own)


class RefinementStage(Stateful):
    """Stage that smooths skeletons: one set out for each set in, delayed by the lag.

    The constructor compiles the kernels, or loads them from numba's cache.
    """

    LAYOUT = StateLayout(
        "refinement",
        "_waiting _last_ns _clock _patches _bodies _bank.moments _bank.people _bank.departed _bank.lasting "
        "_bank.memory _bank.shortfall".split(),
        (
            InstantBodies,
            BodyJointOffsets,
            Fields.named(BodyFill, "_kept _learnt"),
            TrackedPoseSet,
            TimeShift,
            ViewSources,
            PatchTrajectories,
            PartMotions,
            FilterState,
            MotionStates,
            JointMeasurements,
            PeopleStatistics,
            Fields.named(LagSchedule, "_lag_ns _period _newest _last"),
        ),
        same={"configuration": "_config", "skeleton": "_hash"},
    )

    def __init__(self, config: RefinementConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # kept, as the property computes it at each call
        self._floor = bias_floor(config.bias_floor, context.skeleton)
        self._calibration = CalibrationErrors.of(context.rig.cameras)
        self._biases = bias_floor(-1.0, context.skeleton)  # biases that the covariances of bodies contain
        self._lasting_share = config.lasting_share if self._floor.any() else 0.0
        self.reset()
        for patches in (False, True):  # states have different sizes with and without patches
            for example in _examples(context.skeleton):
                if patches:
                    self.step(_moved(example))
                self.step(example)
            self.flush()

    def reset(self) -> None:
        """Discard all people, waiting sets and learnt values."""
        self._waiting: list[TrackedPoseSet] = []
        self._last_ns: int | None = None
        self._clock = LagSchedule(self._config.lag)
        self._patches: PatchTrajectories | None = None  # patches of the next set
        self._bodies = BodyFill()
        self._bank = FilterBank(self._config, self._skeleton, self._lasting_share)

    def flush(self) -> StepResult[RefinedPoseSet]:
        """Return the results of all waiting sets, then reset."""
        outputs = tuple(self._emit() for _ in range(len(self._waiting)))
        self.reset()
        return StepResult(outputs)

    def step(self, item: TrackedPoseSet | PatchTrajectories | BodyStateSet) -> StepResult[RefinedPoseSet]:
        """Return the results of all sets that have waited long enough.

        A set that is not newer than the previous one is dropped with a notice. Patches of a set come before
        the set, and are ignored if no set with their timestamp follows. Bodies have a rate of their own, and
        joints are interpolated between two of them.

        Raises:
            DataError: if the poses have another skeleton.
        """
        if item.skeleton_hash != self._hash:
            own = f"{self._skeleton.name} ({self._hash})"
            raise DataError(f"poses of skeleton {item.skeleton_hash}, but refinement works on {own}")
        if isinstance(item, PatchTrajectories):
            self._patches = item
            return StepResult()
        if isinstance(item, BodyStateSet):
            self._bodies.take(item, self._biases, self._calibration)
            return StepResult()
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("refinement.old_stamp", "warning", text),))
        patches, self._patches = self._patches, None
        if patches is not None and patches.stamp_ns == item.stamp_ns and len(patches.free):
            item = without(item, patches.free)
        motions = _motions_since(patches, self._last_ns, item.stamp_ns)
        self._last_ns = item.stamp_ns
        if not self._config.enabled or self._config.method == "averaging":
            return StepResult((self._passed_through(item),))
        self._waiting.append(item)
        self._clock.take(item)
        self._bank.take(item, motions)
        outputs = []
        while self._waiting and self._clock.is_due(self._waiting[0]):
            outputs.append(self._emit())
        return StepResult(tuple(outputs))

    def _emit(self) -> RefinedPoseSet:
        """Return the result of the oldest waiting set, smoothed with all later sets."""
        item, bank = self._waiting.pop(0), self._bank
        instant_ns = self._clock.instant_ns(item)
        index = next(k for k, moment in enumerate(bank.moments) if moment.stamp_ns == item.stamp_ns)
        ids, measured = bank.people.ids, bank.moments[index].measured
        judged = bank.smoothed(index, 1e-9 * (instant_ns - item.stamp_ns))
        there = np.flatnonzero(judged.states.any(axis=1))
        rows = there[np.argsort(ids[there])]
        bank.forget(item.stamp_ns)
        judged = selected(judged, rows)
        if self._config.bodies:
            views, noises = measured.views[rows], measured.noises[rows]
            self._bodies.fill(instant_ns, ids[rows], judged, views, noises, self._config.max_sigma)
        sources = _sources_of(item, ids[rows].tolist())
        return known_good(
            RefinedPoseSet,
            {
                "index": item.index,
                "stamp_ns": instant_ns,
                "skeleton_hash": item.skeleton_hash,
                "positions": judged.positions,
                "covariances": with_persistent(
                    judged.positions, judged.covariances, sources, self._floor, self._calibration
                ),
                "scores": judged.scores,
                "views": measured.views[rows],
                "states": judged.states,
                "person_scores": measured.person_scores[rows],
                "newest_ns": max(item.newest_ns, instant_ns),
                "time_shift": None,
                "sources": sources,
                "side_votes": None,
                "corrections": None,
                "ids": ids[rows],
            },
        )

    def _passed_through(self, item: TrackedPoseSet) -> RefinedPoseSet:
        """Return the unchanged skeletons as a `RefinedPoseSet`, with persistent errors in the covariances."""
        values = {field.name: getattr(item, field.name) for field in fields(item)}
        whole = with_persistent(
            item.positions, item.covariances, item.sources, self._floor, self._calibration
        )
        return RefinedPoseSet(**{**values, "covariances": whole})


def _motions_since(
    patches: PatchTrajectories | None, before_ns: int | None, stamp_ns: int
) -> PartMotions | None:
    """Return the motions of parts between two sets, or None if they were not measured."""
    if patches is None or (patches.before_ns, patches.stamp_ns) != (before_ns, stamp_ns):
        return None
    return patches.motions


def without(item: TrackedPoseSet, free: Array) -> TrackedPoseSet:
    """Return a set in which joints in free space are missing.

    Args:
        free: (F, 2) id of the person and joint.
    """
    row_of = {number: row for row, number in enumerate(item.ids.tolist())}
    pairs = [(row_of[person], joint) for person, joint in free.tolist() if person in row_of]
    gone = np.zeros(item.states.shape, bool)
    gone[tuple(np.array(pairs, np.int64).reshape(-1, 2).T)] = True
    return replace(
        item,
        positions=np.where(gone[..., None], np.nan, item.positions),
        covariances=np.where(gone[..., None, None], np.nan, item.covariances),
        scores=np.where(gone, 0.0, item.scores),
        views=np.where(gone, 0, item.views),
        states=np.where(gone, np.uint8(JointState.MISSING), item.states),
    )


def bias_floor(asked: float, skeleton: SkeletonModel) -> Array:
    """Return the covariances (J, 3, 3) m^2 of the detector's biases.

    A bias is equal in every frame. As noise of single measurements it would be smoothed away, and would make
    the smoother sluggish.

    Args:
        asked: m, standard deviation of every joint; negative = the values of the skeleton.
    """
    own = np.array(skeleton.bias_floors) if skeleton.bias_floors else np.zeros(len(skeleton))
    floors = own if asked < 0.0 else np.full(len(skeleton), asked)
    return (floors**2)[:, None, None] * np.eye(3)


def with_persistent(
    positions: Array,
    covariances: Array,
    sources: ViewSources | None,
    floor: Array,
    calibration: CalibrationErrors | None,
) -> Array:
    """Return the covariances (P, J, 3, 3) m^2 with errors that do not change over time.

    Args:
        positions: (P, J, 3) m, NaN = missing.
        covariances: (P, J, 3, 3) m^2, of noise.
        sources: Views behind the people; None = unknown.
        floor: (J, 3, 3) m^2, of the detector's biases.
        calibration: Errors of the rig's calibration; None = unknown.
    """
    whole: Array = covariances + floor
    if calibration is None or not len(positions):
        return whole
    views = ((), None) if sources is None else (sources.cameras, sources.persons)
    whole += calibration.of_people(positions, *views)
    return whole


def _sources_of(item: TrackedPoseSet, numbers: list[int]) -> ViewSources | None:
    """Return the 2D poses of people with these ids.

    People who are predicted or filled are not in the set, and have none.
    """
    if item.sources is None or numbers == item.ids.tolist():
        return item.sources
    rows = {int(number): k for k, number in enumerate(item.ids)}
    return item.sources.rows([rows.get(number, -1) for number in numbers])


def _moved(item: TrackedPoseSet) -> PatchTrajectories:
    """Return example patches: the first part of every person moved a little since the previous example."""
    people, nothing, none = len(item.ids), np.zeros((0, 3)), np.zeros(0)
    still = np.zeros((people, 3))
    motions = PartMotions(
        item.ids,
        np.zeros(people),
        still,
        still,
        still + 0.01,
        np.tile(1e-6 * np.eye(6), (people, 1, 1)),
        np.full(people, 9),
        np.ones(people),
    )
    return PatchTrajectories(
        item.index,
        item.stamp_ns,
        max(item.stamp_ns - 33_000_000, 0),
        item.skeleton_hash,
        none,
        none,
        none,
        none,
        nothing,
        nothing,
        none,
        (),
        np.zeros((0, 0)),
        motions,
        np.zeros((0, 2)),
    )


def _examples(skeleton: SkeletonModel) -> Iterator[TrackedPoseSet]:
    """Yield sets that compile all kernels.

    The first sets contain one person; the later sets contain another, whose views have different timestamps.
    """
    count = len(skeleton)
    positions = np.random.default_rng(0).uniform(0.0, 1.0, (1, count, 3))
    ones, still, eyes = np.ones((1, count)), np.zeros((1, count, 3)), np.tile(np.eye(3), (1, count, 1, 1))
    moving = TimeShift(1e-3 * eyes, still, still, eyes)
    for index in range(6):
        yield TrackedPoseSet(
            index,
            index * 33_000_000,
            skeleton.hash,
            positions + 0.01 * index,
            1e-4 * eyes,
            ones,
            2 * ones,
            ones,
            np.ones(1),
            time_shift=moving if index > 3 else None,
            ids=np.array([int(index > 3)]),
        )
