"""The refinement stage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

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
from panoptic_ros.refinement.bodies import BodyFill, Learnt, Posed
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.filter_bank import FilterBank
from panoptic_ros.refinement.lag import Clock
from panoptic_ros.refinement.records import Measured, Moment, Motion, People
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

Array = np.ndarray


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
