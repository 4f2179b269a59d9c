"""Clocks of a recorded capture's cameras, with the stages of the graph as the solver."""
from __future__ import annotations

from collections.abc import Mapping, Sequence

from panoptic_ros.domain import DetectionSet, TrackedPoseSet
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.offsets import Corrected, correct_from_motion
from panoptic_ros.params import Config
from panoptic_ros.stage import StageContext

TO_TRACKING = FUSION[: FUSION.index("tracking") + 1]


def find_clocks(
    sets: Sequence[DetectionSet], context: StageContext, configs: Mapping[str, Config], trusted: str = ""
) -> Corrected:
    """Clocks and corrected sets; see `offsets.correct_from_motion`.

    Args:
        configs: of the stages, see `graph.build.configure`.
    """

    def solve(items: Sequence[DetectionSet]) -> list[TrackedPoseSet]:
        return records_of("skeletons_raw", items, configs, context, TO_TRACKING)

    return correct_from_motion(sets, context.rig, context.skeleton, solve, trusted)
