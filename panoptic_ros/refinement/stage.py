"""The refinement stage."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import (
    JointState,
    RefinedPoseSet,
    SkeletonModel,
    TimeShift,
    TrackedPoseSet,
    ViewSources,
)
from panoptic_ros.errors import DataError
from panoptic_ros.refinement.bias_floor import bias_floor, with_floor
from panoptic_ros.refinement.bones import BoneLengths
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.lag import Clock
from panoptic_ros.refinement.person import Moment, PersonMotion, Smoothed
from panoptic_ros.refinement.tuning import LastingErrors, Tuning
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

Array = np.ndarray


class RefinementStage(Stateful):
    """Smoothed skeletons, one set for each that comes in, late by the lag.

    The constructor compiles the kernels, or takes them from numba's cache.
    """

    LAYOUT = StateLayout(
        "refinement", ("_waiting", "_people", "_lengths", "_last_ns", "_clock", "_lasting"),
        (
            TrackedPoseSet, TimeShift, ViewSources, Moment,
            Fields.named(PersonMotion, "_config _joints _share _moments _tuning _still _speeds"),
            Fields.named(Tuning, "_joints _lasting factor _level _weight _seen _before"),
            Fields.named(LastingErrors, "_weight _correlation"),
            Fields.named(BoneLengths, "_bones means counts"),
            Fields.named(Clock, "_lag_ns _period _newest _last"),
        ),
        shared=("_config", "_bones"),
        same={"configuration": "_config", "skeleton": "_hash"},
    )  # fmt: skip

    def __init__(self, config: RefinementConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # computed at each call
        self._bones = np.array(context.skeleton.bones, np.int64).reshape(-1, 2)
        self._floor = bias_floor(config.bias_floor, context.skeleton)
        self._lasting_share = config.lasting_share if self._floor.any() else 0.0
        self.reset()
        for example in _examples(context.skeleton):
            self.step(example)
        self.flush()

    def reset(self) -> None:
        """Forget everybody."""
        self._waiting: list[TrackedPoseSet] = []
        self._people: dict[int, PersonMotion] = {}
        self._lengths: dict[int, BoneLengths] = {}
        self._last_ns: int | None = None
        self._clock = Clock(self._config.lag)
        self._lasting = LastingErrors()

    def flush(self) -> StepResult[RefinedPoseSet]:
        """Hand out all sets that still wait."""
        outputs = tuple(self._emit() for _ in range(len(self._waiting)))
        self.reset()
        return StepResult(with_floor(outputs, self._floor))

    def step(self, item: TrackedPoseSet) -> StepResult[RefinedPoseSet]:
        """The sets that have waited long enough; sets from the past are dropped with a notice.

        Raises:
            DataError: if the poses are of another skeleton.
        """
        if item.skeleton_hash != self._hash:
            raise DataError(
                f"poses of skeleton {item.skeleton_hash}, but refinement works on "
                f"{self._skeleton.name} ({self._hash})"
            )
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("refinement.old_stamp", "warning", text),))
        self._last_ns = item.stamp_ns
        if not self._config.enabled:
            return StepResult(with_floor([_passed_through(item)], self._floor))
        self._take(item)
        outputs = []
        while self._waiting and self._clock.is_due(self._waiting[0]):
            outputs.append(self._emit())
        return StepResult(with_floor(outputs, self._floor))

    def _take(self, item: TrackedPoseSet) -> None:
        """Filter everybody up to this set."""
        self._waiting.append(item)
        self._clock.take(item)
        for number in item.ids.tolist():
            if number not in self._people:
                self._people[number] = PersonMotion(
                    self._config, len(self._skeleton), self._lasting, self._lasting_share
                )
                self._lengths.setdefault(number, BoneLengths(self._bones))
        rows = {int(number): k for k, number in enumerate(item.ids)}
        for number, motion in self._people.items():
            motion.predict(item.stamp_ns)
            if number in rows:
                k = rows[number]
                motion.update(
                    item.positions[k], item.covariances[k], item.scores[k], item.views[k],
                    float(item.person_scores[k]),
                    None if item.time_shift is None else item.time_shift.rows([k]),
                )  # fmt: skip

    def _emit(self) -> RefinedPoseSet:
        """The oldest waiting set, smoothed with all that came after it."""
        item = self._waiting.pop(0)
        instant_ns = self._clock.instant_ns(item)
        numbers, people = [], []
        for number in sorted(self._people):
            person = self._people[number].smoothed(item.stamp_ns, instant_ns)
            if person is not None and (person.states != JointState.MISSING).any():
                numbers.append(number)
                people.append(_as_stated(self._with_bones(number, person)))
        horizon = self._config.max_gap + self._config.lag
        for number in [n for n, motion in self._people.items() if motion.unseen > horizon]:
            if not self._people[number].seen_after(item.stamp_ns):
                del self._people[number]
        for motion in self._people.values():
            motion.forget_before(item.stamp_ns)
        return _refined(item, instant_ns, numbers, people)

    def _with_bones(self, number: int, person: Smoothed) -> Smoothed:
        """The person with its bone lengths learnt and used."""
        if self._config.bone_sigma <= 0.0:
            return person
        lengths = self._lengths[number]
        lengths.learn(person.positions, person.covariances, person.states == JointState.MEASURED)
        positions, covariances = lengths.apply(
            person.positions, person.covariances, person.states != JointState.MISSING,
            self._config.bone_sigma, self._config.bone_frames,
        )  # fmt: skip
        return replace(person, positions=positions, covariances=covariances)


def _as_stated(person: Smoothed) -> Smoothed:
    """The person with the errors that last in its covariances: bones are pulled as they were smoothed."""
    return replace(person, covariances=person.covariances + person.lasting)


def _passed_through(item: TrackedPoseSet) -> RefinedPoseSet:
    """The same skeletons under the other name."""
    return RefinedPoseSet(
        item.index, item.stamp_ns, item.skeleton_hash, item.positions, item.covariances, item.scores,
        item.views, item.states, item.person_scores, item.newest_ns, item.time_shift, item.sources,
        ids=item.ids,
    )  # fmt: skip


def _refined(
    item: TrackedPoseSet, instant_ns: int, numbers: list[int], people: list[Smoothed]
) -> RefinedPoseSet:
    """The record of one instant."""
    joints = item.positions.shape[1]

    def stacked(name: str, shape: tuple[int, ...]) -> Array:
        rows = [getattr(person, name) for person in people]
        return np.stack(rows) if rows else np.empty((0, *shape))

    return RefinedPoseSet(
        item.index, instant_ns, item.skeleton_hash, stacked("positions", (joints, 3)),
        stacked("covariances", (joints, 3, 3)), stacked("scores", (joints,)), stacked("views", (joints,)),
        stacked("states", (joints,)), stacked("person_score", ()),
        max(item.newest_ns, instant_ns), sources=_sources_of(item, numbers), ids=np.array(numbers, np.int64),
    )  # fmt: skip


def _sources_of(item: TrackedPoseSet, numbers: list[int]) -> ViewSources | None:
    """The 2D people of these ids; none for whom the set does not hold, who was predicted or filled."""
    if item.sources is None:
        return None
    rows = {int(number): k for k, number in enumerate(item.ids)}
    return item.sources.rows([rows.get(number, -1) for number in numbers])


def _examples(skeleton: SkeletonModel) -> Iterator[TrackedPoseSet]:
    """A few instants of one person, then of another whose views have stamps of their own: all kernels."""
    count = len(skeleton)
    positions = np.random.default_rng(0).uniform(0.0, 1.0, (1, count, 3))
    ones, still, eyes = np.ones((1, count)), np.zeros((1, count, 3)), np.tile(np.eye(3), (1, count, 1, 1))
    moving = TimeShift(1e-3 * eyes, still, still, eyes)
    for index in range(6):
        yield TrackedPoseSet(
            index, index * 33_000_000, skeleton.hash, positions + 0.01 * index, 1e-4 * eyes, ones, 2 * ones,
            ones, np.ones(1), time_shift=moving if index > 3 else None, ids=np.array([int(index > 3)]),
        )  # fmt: skip
