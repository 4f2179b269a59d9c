"""Refinement of a recording in both directions of time, with patches placed again on skeletons without gaps.

Joo et al. 2017, 6.3, propagate parts forward and backward and associate patches with the filled skeleton
again, until nothing more is filled. Here a displacement links two states in both directions. Smoothing with a
look-ahead of two seconds is as good as smoothing over the whole recording. A second round places patches on
the joints that the first round filled. So a recording of any length is refined as a stream.

`OfflineAveraging` does the averaging of Joo et al. 2017, 6.3, over a whole recording; see
`refinement.averaging`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.domain import (
    DepthFrame,
    JointState,
    PartMotions,
    PatchTracks,
    PatchTrajectories,
    RefinedPoseSet,
    TrackedPoseSet,
)
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import make_stage
from panoptic_ros.params import Config, config_of
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.refinement.averaging import Joints, averaged
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import bias_floor, with_persistent, without
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import StageContext

AHEAD = 2.0  # s, look-ahead of smoothing; the motion model's memory is a fraction of that
BRIDGED = 1.0  # s; longest gap that is filled although no motion was measured
ROUNDS = 2  # rounds of placing patches on people
Taken = PatchTracks | DepthFrame | TrackedPoseSet


class PoseInstant(NamedTuple):
    """Set of tracked 3D poses, and the records that came since the previous set."""

    before: tuple[PatchTracks | DepthFrame, ...]
    poses: TrackedPoseSet
    free: Any  # (F, 2) ids and joints in space that depth sensors measured as free; None = unknown


class RefinementRound:
    """One round: patches on given skeletons, and smoothing of the measured joints with the patch motions."""

    def __init__(self, patches: PatchesConfig, refinement: RefinementConfig, context: StageContext):
        self._patches = make_stage("patches", patches, context) if patches.active else None
        self._refinement = make_stage("refinement", refinement, context)
        self._waiting: deque[PoseInstant] = deque()

    def take(
        self, instant: PoseInstant, shown: TrackedPoseSet
    ) -> Iterator[tuple[PoseInstant, RefinedPoseSet]]:
        """Yield the sets that are smoothed by now.

        Args:
            instant: New set.
            shown: The same people, with the joints on which patches are placed.
        """
        if self._patches is not None:
            found: list[Any] = []
            for item in (*instant.before, shown):
                found += self._patches.step(item).outputs
            for own in found:
                assert isinstance(own, PatchTrajectories)
                instant = instant._replace(free=own.free if instant.free is None else instant.free)
                self._refinement.step(replace(own, free=instant.free))
        self._waiting.append(instant)
        yield from self._matched(self._refinement.step(instant.poses).outputs)

    def flush(self) -> Iterator[tuple[PoseInstant, RefinedPoseSet]]:
        """Yield the remaining sets."""
        yield from self._matched(self._refinement.flush().outputs)
        self._waiting.clear()

    def _matched(self, outputs: Iterable[RefinedPoseSet]) -> Iterator[tuple[PoseInstant, RefinedPoseSet]]:
        for output in outputs:
            while self._waiting[0].poses.index != output.index:
                self._waiting.popleft()  # refinement dropped this set, because it came too late
            yield self._waiting.popleft(), output


class OfflineRefinement:
    """Smoother of a recording: takes records in order, gives smoothed 3D poses with a delay.

    It takes 2D tracks, depth maps and tracked 3D poses.

    Args:
        configs: Configurations of the stages. Without patches it only smooths.
        context: Context of the stages.

    Raises:
        UsageError: if bodies should fill joints, which is only possible with a lag.
    """

    def __init__(self, configs: Mapping[str, Config], context: StageContext):
        patches, refinement = config_of(configs, PatchesConfig), config_of(configs, RefinementConfig)
        if refinement.bodies:
            raise UsageError("refinement.bodies has no meaning offline, where no bodies come: leave it out")
        refinement = replace(
            refinement, lag=max(AHEAD, refinement.lag), max_gap=max(BRIDGED, refinement.max_gap)
        )
        kept = replace(patches, carry_gain=1.0)  # follow skeletons without noise and gaps exactly
        rounds = ROUNDS if patches.active else 1
        self._rounds = [
            RefinementRound(patches if k == 0 else kept, refinement, context) for k in range(rounds)
        ]
        self._before: list[PatchTracks | DepthFrame] = []

    def take(self, item: Taken) -> Iterator[RefinedPoseSet]:
        """Yield the sets that have passed all rounds by now."""
        if not isinstance(item, TrackedPoseSet):
            self._before.append(item)
            return
        instant = PoseInstant(tuple(self._before), item, None)
        self._before = []
        yield from self._next(0, self._rounds[0].take(instant, item))

    def flush(self) -> Iterator[RefinedPoseSet]:
        """Yield the remaining sets."""
        for k, one in enumerate(self._rounds):
            yield from self._next(k, one.flush())

    def _next(self, k: int, found: Iterable[tuple[PoseInstant, RefinedPoseSet]]) -> Iterator[RefinedPoseSet]:
        """Pass the output of round k through the later rounds."""
        for instant, output in found:
            if k + 1 == len(self._rounds):
                yield output
            else:
                yield from self._next(k + 1, self._rounds[k + 1].take(instant, output))


Array = np.ndarray
UNKNOWN = 0.1**2  # m^2, variance of joints that averaging filled, as the method gives none


class OfflineAveraging:
    """Averaging of a recording: takes records in order, gives all 3D poses at the end.

    It takes 2D tracks, depth maps and tracked 3D poses, and keeps the whole recording in memory. Joints in
    free space are missing at first. Parts are followed on the joints of the previous round.

    Attributes:
        rounds: Number of rounds that were needed.

    Raises:
        UsageError: if the motion of the surface is not measured.
    """

    def __init__(self, configs: Mapping[str, Config], context: StageContext):
        self._patches, self._context = config_of(configs, PatchesConfig), context
        if not self._patches.active:
            text = "averaging needs the motion of the surface: add --set patches.active=true, or leave"
            raise UsageError(f"refinement.method=averaging: {text} --offline out")
        self._floor = bias_floor(config_of(configs, RefinementConfig).bias_floor, context.skeleton)
        self._calibration = CalibrationErrors.of(context.rig.cameras)
        self._items: list[Taken] = []
        self._last_ns = -1
        self.rounds = 0

    def take(self, item: Taken) -> Iterator[RefinedPoseSet]:
        """Keep a record and yield nothing; sets with a timestamp from the past are discarded."""
        if isinstance(item, TrackedPoseSet):
            if item.stamp_ns <= self._last_ns:
                return iter(())
            self._last_ns = item.stamp_ns
        self._items.append(item)
        return iter(())

    def flush(self) -> Iterator[RefinedPoseSet]:
        """Yield all skeletons."""
        raw = [item for item in self._items if isinstance(item, TrackedPoseSet)]
        free = {own.stamp_ns: own.free for own in self._followed(raw, self._patches)}
        raw = [without(item, free[item.stamp_ns]) if len(free[item.stamp_ns]) else item for item in raw]
        carried = replace(self._patches, carry_gain=1.0)  # follow these skeletons exactly

        def motions_on(joints: Sequence[Joints]) -> list[PartMotions | None]:
            shown = [_shown(item, own) for item, own in zip(raw, joints)]
            before = [-1, *(item.stamp_ns for item in raw)]
            return [
                own.motions if own.before_ns == last else None
                for own, last in zip(self._followed(shown, carried), before)
            ]

        begun = [dict(zip(item.ids.tolist(), item.positions)) for item in raw]
        joints, self.rounds = averaged(begun, motions_on, self._context.skeleton)
        for item, own in zip(raw, joints):
            shown = _shown(item, own)
            values = {field.name: getattr(shown, field.name) for field in fields(shown)}
            whole = with_persistent(
                shown.positions, shown.covariances, shown.sources, self._floor, self._calibration
            )
            yield RefinedPoseSet(**{**values, "covariances": whole})
        self._items = []

    def _followed(
        self, shown: Sequence[TrackedPoseSet], config: PatchesConfig
    ) -> Iterator[PatchTrajectories]:
        """Yield the patches of every set, placed on the given skeletons instead of the recorded ones."""
        stage, instead = make_stage("patches", config, self._context), iter(shown)
        for item in self._items:
            taken: Iterable[PatchTrajectories] = stage.step(
                next(instead) if isinstance(item, TrackedPoseSet) else item
            ).outputs
            yield from taken


def _shown(item: TrackedPoseSet, own: Mapping[int, Array]) -> TrackedPoseSet:
    """Return the people of a set with other joints (J, 3) m, NaN = missing."""
    positions = item.positions.copy()
    for row, number in enumerate(item.ids.tolist()):
        positions[row] = own[number]
    filled = np.isfinite(positions[..., 0]) & (item.states == JointState.MISSING)
    return replace(
        item,
        positions=positions,
        states=np.where(filled, np.uint8(JointState.FILLED), item.states),
        scores=np.where(filled, item.person_scores[:, None], item.scores),
        covariances=np.where(filled[..., None, None], UNKNOWN * np.eye(3), item.covariances),
    )


def refinement_of(
    configs: Mapping[str, Config], context: StageContext
) -> OfflineRefinement | OfflineAveraging:
    """Return the refinement of a whole recording.

    Raises:
        UsageError: if the configuration requires something that is not possible offline.
    """
    averages = config_of(configs, RefinementConfig).method == "averaging"
    return OfflineAveraging(configs, context) if averages else OfflineRefinement(configs, context)
