"""The refinement stage.

Joints that few views see, from solved bodies: their bones keep their lengths and poses stay human.

A body has joints elsewhere than the detector has them, by much the same in the frame of the hips. What well
seen joints are off is learnt per person and joint, and so is how much that varies. The body rests in part on
the same 2D joints, so both are not independent: what comes out is taken to be as certain as the better of the
two. With IMUs it knows much more than two views do, whose errors last: what smoothing took off these is put
back. Where one view or none sees a joint, neither is right as a rule: skeletons hold on to what more views
saw before, bodies to lengths and to how people move. Their covariances decide. Where both are farther apart
than these say, nothing tells which is wrong, and both are as much less certain (Birge 1932).
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
from panoptic_ros.refinement.joint_states import FILLED, MEASURED, MISSING, Judged
from panoptic_ros.refinement.lag import Clock
from panoptic_ros.refinement.records import Measured, Moment, Motion, People
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

WELL_SEEN = 3  # views of a joint that is left as it is, and learnt from
REACH_NS = 100_000_000  # for which a body is carried on by its velocity
KEPT_NS = 500_000_000  # for which bodies are kept
SPREAD, BELIEF = 0.02, 3.0  # m per axis, of bodies of which nothing is learnt, and what it counts, in looks
MEMORY = 50.0  # looks
CAUCHY = 3.0  # sigma, by which a body and a skeleton are apart, beyond which both are less certain
FILLED_SCORE = 0.25  # of a joint that no view has seen
Array = np.ndarray


class Posed(NamedTuple):
    """Bodies of an instant: stamp; ids (B,); IMUs (B,) behind them; keypoints (B, J, 3) m, their covariances
    (B, J, 3, 3) m^2; hips (B, 3, 3), world from segment.
    """

    stamp_ns: int
    ids: Array
    devices: Array
    points: Array
    covariances: Array
    hips: Array


class Learnt(NamedTuple):
    """Of a person: looks (J,), offsets (J, 3) m in the frame of the hips, variances (J,) m^2 per axis."""

    looks: Array
    offsets: Array
    variances: Array


class BodyFill:
    """Bodies lately, and what is learnt of them."""

    def __init__(self) -> None:
        self._kept: list[Posed] = []
        self._learnt: dict[int, Learnt] = {}

    def take(self, item: BodyStateSet, biases: Array) -> None:
        """Bodies of one more instant; those that go back in time begin anew.

        Args:
            biases: (J, 3, 3) m^2 of the detector, which bodies state. Skeletons have the same: they do not
                count between both.
        """
        if self._kept and item.stamp_ns <= self._kept[-1].stamp_ns:
            self._kept = []
        hips = from_quaternions(np.ascontiguousarray(item.orientations[:, 0]))
        points, spreads = item.keypoints, item.keypoint_covariances - biases
        self._kept.append(Posed(item.stamp_ns, item.ids, item.devices, points, spreads, hips))
        while self._kept[0].stamp_ns < item.stamp_ns - KEPT_NS:
            self._kept.pop(0)

    def fill(
        self, stamp_ns: int, ids: Array, judged: Judged, views: Array, noises: Array, max_sigma: float
    ) -> None:
        """Learn from joints that are well seen, and mend all others, in place.

        Args:
            ids: (P,) of the people. views: (P, J) behind joints that are measured.
            noises: (P, J, 3, 3) m^2, of their latest measurements.
            max_sigma: m, of missing joints that are filled.
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
        """Keypoints (J, 3), covariances and hips of a person at an instant, by the two bodies next to it, and
        whether there were IMUs.
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


def nothing_learnt(joints: int) -> Learnt:
    """Of somebody who is new."""
    return Learnt(np.zeros(joints), np.zeros((joints, 3)), np.full(joints, SPREAD**2))


def learn(learnt: Learnt, apart: Array, own: Array, well: Array) -> Learnt:
    """With one more look at the joints (J,) that are well seen.

    Args:
        apart: (J, 3) m, by which they are off the body's. own: (J,) m^2 per axis, of that by themselves.
    """
    looks = learnt.looks + well
    far = np.where(well[:, None], apart - learnt.offsets, 0.0)
    gain = well * np.maximum(1.0 / np.maximum(looks, 1.0), 1.0 / MEMORY)
    slow = well * np.maximum(1.0 / (looks + BELIEF), 1.0 / MEMORY)
    more = np.maximum((far**2).mean(axis=-1) - np.where(well, own, 0.0), 0.0)
    variances = learnt.variances + slow * (more - learnt.variances)
    return Learnt(looks, learnt.offsets + gain[:, None] * far, variances)


def _mend(
    judged: Judged, row: int, placed: Array, noise: Array, measured: Array, asked: Array, max_sigma: float
) -> None:
    """Joints of a person with what the body says: places (J, 3) m of noise (J, 3, 3) m^2, as measurements."""
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
    """Smoothed skeletons, one set for each that comes in, late by the lag.

    The constructor compiles the kernels, or takes them from numba's cache.
    """

    LAYOUT = StateLayout(
        "refinement",
        "_waiting _last_ns _clock _patches _bodies _bank.moments _bank.people _bank.departed _bank.lasting "
        "_bank.memory _bank.shortfall".split(),
        (
            Posed,
            Learnt,
            Fields.named(BodyFill, "_kept _learnt"),
            TrackedPoseSet,
            TimeShift,
            ViewSources,
            PatchTrajectories,
            PartMotions,
            Moment,
            Motion,
            Measured,
            People,
            Fields.named(Clock, "_lag_ns _period _newest _last"),
        ),
        same={"configuration": "_config", "skeleton": "_hash"},
    )

    def __init__(self, config: RefinementConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # computed at each call
        self._floor = bias_floor(config.bias_floor, context.skeleton)
        self._biases = bias_floor(-1.0, context.skeleton)  # in bodies
        self._lasting_share = config.lasting_share if self._floor.any() else 0.0
        self.reset()
        for patches in (False, True):  # each its own sizes of states
            for example in _examples(context.skeleton):
                if patches:
                    self.step(_moved(example))
                self.step(example)
            self.flush()

    def reset(self) -> None:
        """Forget everybody."""
        self._waiting: list[TrackedPoseSet] = []
        self._last_ns: int | None = None
        self._clock = Clock(self._config.lag)
        self._patches: PatchTrajectories | None = None  # of the set that comes next
        self._bodies = BodyFill()
        self._bank = FilterBank(self._config, self._skeleton, self._lasting_share)

    def flush(self) -> StepResult[RefinedPoseSet]:
        """Hand out all sets that still wait."""
        outputs = tuple(self._emit() for _ in range(len(self._waiting)))
        self.reset()
        return StepResult(outputs)

    def step(self, item: TrackedPoseSet | PatchTrajectories | BodyStateSet) -> StepResult[RefinedPoseSet]:
        """The sets that have waited long enough; sets from the past are dropped with a notice.

        Patches of a set come before it; those of no set that follows are not used. Bodies have a rate of
        their own: between two of them joints are in between.

        Raises:
            DataError: if the poses are of another skeleton.
        """
        if item.skeleton_hash != self._hash:
            own = f"{self._skeleton.name} ({self._hash})"
            raise DataError(f"poses of skeleton {item.skeleton_hash}, but refinement works on {own}")
        if isinstance(item, PatchTrajectories):
            self._patches = item
            return StepResult()
        if isinstance(item, BodyStateSet):
            self._bodies.take(item, self._biases)
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
        """The oldest waiting set, smoothed with all that came after it."""
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
        return known_good(
            RefinedPoseSet,
            {
                "index": item.index,
                "stamp_ns": instant_ns,
                "skeleton_hash": item.skeleton_hash,
                "positions": judged.positions,
                "covariances": judged.covariances + self._floor,
                "scores": judged.scores,
                "views": measured.views[rows],
                "states": judged.states,
                "person_scores": measured.person_scores[rows],
                "newest_ns": max(item.newest_ns, instant_ns),
                "time_shift": None,
                "sources": _sources_of(item, ids[rows].tolist()),
                "side_votes": None,
                "corrections": None,
                "ids": ids[rows],
            },
        )

    def _passed_through(self, item: TrackedPoseSet) -> RefinedPoseSet:
        """The same skeletons under the other name."""
        values = {field.name: getattr(item, field.name) for field in fields(item)}
        return RefinedPoseSet(**{**values, "covariances": item.covariances + self._floor})


def _motions_since(
    patches: PatchTrajectories | None, before_ns: int | None, stamp_ns: int
) -> PartMotions | None:
    """How parts moved between two sets; None where that was not measured."""
    if patches is None or (patches.before_ns, patches.stamp_ns) != (before_ns, stamp_ns):
        return None
    return patches.motions


def without(item: TrackedPoseSet, free: Array) -> TrackedPoseSet:
    """A set whose joints in free space are missing; free: (F, 2) ids and joints."""
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
    """Covariances (J, 3, 3) m^2 of the detector's biases; asked: m, negative = the skeleton's own.

    A bias is the same in every frame: as noise of single measurements it would be smoothed away, and make the
    smoother sluggish.
    """
    own = np.array(skeleton.bias_floors) if skeleton.bias_floors else np.zeros(len(skeleton))
    floors = own if asked < 0.0 else np.full(len(skeleton), asked)
    return (floors**2)[:, None, None] * np.eye(3)


def _sources_of(item: TrackedPoseSet, numbers: list[int]) -> ViewSources | None:
    """The 2D people of these ids; none for whom the set does not hold, who was predicted or filled."""
    if item.sources is None or numbers == item.ids.tolist():
        return item.sources
    rows = {int(number): k for k, number in enumerate(item.ids)}
    return item.sources.rows([rows.get(number, -1) for number in numbers])


def _moved(item: TrackedPoseSet) -> PatchTrajectories:
    """The first part of everybody moved a little since the example before."""
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
    """A few instants of one person, then of another whose views have stamps of their own: all kernels."""
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
