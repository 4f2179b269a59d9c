"""Refinement of a recording: both directions of time, and patches put once more on skeletons without gaps.

Joo et al. 2017, 6.3, propagate parts forward and backward and associate patches anew on the filled skeleton,
until nothing more is filled. Here a displacement ties two states in both directions, and smoothing over two
seconds to come is as good as over all of the recording. What it fills is what patches are put on next, in a
second round; so a recording of any length is refined as it passes by.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from panoptic_ros.domain import DepthFrame, PatchTracks, PatchTrajectories, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import make_stage
from panoptic_ros.params import Config, config_of
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.stage import StageContext

AHEAD = 2.0  # s that smoothing looks ahead; motion is forgotten in a fraction of that
BRIDGED = 1.0  # s, longest gap that is filled although nothing was followed
ROUNDS = 2  # of putting patches on people
Taken = PatchTracks | DepthFrame | TrackedPoseSet


class Instant(NamedTuple):
    """A set of skeletons, and what came since the one before."""

    before: tuple[PatchTracks | DepthFrame, ...]
    poses: TrackedPoseSet
    free: Any  # (F, 2) ids and joints of the set that depth sensors see through; None = not known


class Round:
    """Patches on the skeletons that are given, and the measured joints smoothed with their motions."""

    def __init__(self, patches: PatchesConfig, refinement: RefinementConfig, context: StageContext):
        self._patches = make_stage("patches", patches, context) if patches.active else None
        self._refinement = make_stage("refinement", refinement, context)
        self._waiting: deque[Instant] = deque()

    def take(self, instant: Instant, shown: TrackedPoseSet) -> Iterator[tuple[Instant, RefinedPoseSet]]:
        """What is smoothed by now; shown: the same people, on whom patches are put."""
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

    def flush(self) -> Iterator[tuple[Instant, RefinedPoseSet]]:
        """The rest."""
        yield from self._matched(self._refinement.flush().outputs)
        self._waiting.clear()

    def _matched(self, outputs: Iterable[RefinedPoseSet]) -> Iterator[tuple[Instant, RefinedPoseSet]]:
        for output in outputs:
            while self._waiting[0].poses.index != output.index:
                self._waiting.popleft()  # it came too late, and was dropped
            yield self._waiting.popleft(), output


class OfflineRefinement:
    """Takes 2D tracks, depth maps and tracked skeletons in their order; gives smoothed skeletons late.

    Args:
        configs: of the stages. Without patches it only smooths.

    Raises:
        UsageError: if bodies are to fill joints, which is done with a lag only.
    """

    def __init__(self, configs: Mapping[str, Config], context: StageContext):
        patches, refinement = config_of(configs, PatchesConfig), config_of(configs, RefinementConfig)
        if refinement.bodies:
            raise UsageError("refinement.bodies has no meaning offline, where no bodies come: leave it out")
        refinement = replace(
            refinement, lag=max(AHEAD, refinement.lag), max_gap=max(BRIDGED, refinement.max_gap)
        )
        kept = replace(patches, carry_gain=1.0)  # skeletons without noise and gaps are followed as they are
        rounds = ROUNDS if patches.active else 1
        self._rounds = [Round(patches if k == 0 else kept, refinement, context) for k in range(rounds)]
        self._before: list[PatchTracks | DepthFrame] = []

    def take(self, item: Taken) -> Iterator[RefinedPoseSet]:
        """What is through all rounds by now."""
        if not isinstance(item, TrackedPoseSet):
            self._before.append(item)
            return
        instant = Instant(tuple(self._before), item, None)
        self._before = []
        yield from self._next(0, self._rounds[0].take(instant, item))

    def flush(self) -> Iterator[RefinedPoseSet]:
        """The rest."""
        for k, one in enumerate(self._rounds):
            yield from self._next(k, one.flush())

    def _next(self, k: int, found: Iterable[tuple[Instant, RefinedPoseSet]]) -> Iterator[RefinedPoseSet]:
        """What round k gave, through the rounds after it."""
        for instant, output in found:
            if k + 1 == len(self._rounds):
                yield output
            else:
                yield from self._next(k + 1, self._rounds[k + 1].take(instant, output))
