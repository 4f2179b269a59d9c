"""The averaging of Joo et al. 2017, 6.3, over a whole recording: see `refinement.averaging`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from panoptic_ros.domain import (
    JointState,
    PartMotions,
    PatchTrajectories,
    RefinedPoseSet,
    TrackedPoseSet,
)
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import make_stage
from panoptic_ros.graph.offline_refinement import Taken
from panoptic_ros.params import Config, config_of
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.refinement.averaging import Joints, averaged
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import bias_floor, without
from panoptic_ros.stage import StageContext

Array = np.ndarray
UNKNOWN = 0.1**2  # m^2, of joints that averaging filled: it does not tell


class OfflineAveraging:
    """Takes 2D tracks, depth maps and tracked skeletons in their order; gives all skeletons at the end.

    Joints in free space are missing at first. Parts are followed on the joints of the round before. It holds
    the whole recording.

    Attributes:
        rounds: that it took.

    Raises:
        UsageError: if the motion of the surface is not measured.
    """

    def __init__(self, configs: Mapping[str, Config], context: StageContext):
        self._patches, self._context = config_of(configs, PatchesConfig), context
        if not self._patches.active:
            text = "averaging needs the motion of the surface: add --set patches.active=true, or leave"
            raise UsageError(f"refinement.method=averaging: {text} --offline out")
        self._floor = bias_floor(config_of(configs, RefinementConfig).bias_floor, context.skeleton)
        self._items: list[Taken] = []
        self._last_ns = -1
        self.rounds = 0

    def take(self, item: Taken) -> Iterator[RefinedPoseSet]:
        """Nothing yet; sets from the past are left out."""
        if isinstance(item, TrackedPoseSet):
            if item.stamp_ns <= self._last_ns:
                return iter(())
            self._last_ns = item.stamp_ns
        self._items.append(item)
        return iter(())

    def flush(self) -> Iterator[RefinedPoseSet]:
        """All skeletons."""
        raw = [item for item in self._items if isinstance(item, TrackedPoseSet)]
        free = {own.stamp_ns: own.free for own in self._followed(raw, self._patches)}
        raw = [without(item, free[item.stamp_ns]) if len(free[item.stamp_ns]) else item for item in raw]
        carried = replace(self._patches, carry_gain=1.0)  # on skeletons as they are

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
            yield RefinedPoseSet(**{**values, "covariances": shown.covariances + self._floor})
        self._items = []

    def _followed(
        self, shown: Sequence[TrackedPoseSet], config: PatchesConfig
    ) -> Iterator[PatchTrajectories]:
        """Patches of every set, put on these skeletons in place of those that came."""
        stage, instead = make_stage("patches", config, self._context), iter(shown)
        for item in self._items:
            taken: Iterable[PatchTrajectories] = stage.step(
                next(instead) if isinstance(item, TrackedPoseSet) else item
            ).outputs
            yield from taken


def _shown(item: TrackedPoseSet, own: Mapping[int, Array]) -> TrackedPoseSet:
    """The people of a set with other joints (J, 3) m, NaN = missing."""
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
