"""Clocks of a recorded capture's cameras, with the stages of the graph as the solver."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from panoptic_ros.domain import DetectionSet, TrackedPoseSet
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.offsets import CameraClocks, MotionClocks, MotionClocksConfig, regroup
from panoptic_ros.params import Config
from panoptic_ros.stage import Progress, StageContext, untold

TO_TRACKING = FUSION[: FUSION.index("tracking") + 1]


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """The clocks, and the sets that they give."""

    clocks: CameraClocks
    sets: list[DetectionSet]


def motion_clocks(context: StageContext, configs: Mapping[str, Config], trusted: str = "") -> MotionClocks:
    """The pass that finds clocks, with the stages up to tracking.

    Args:
        configs: of the stages, see `graph.build.configure`. trusted: see `MotionClocksConfig`.
    """

    def solve(items: Iterable[DetectionSet]) -> list[TrackedPoseSet]:
        return records_of("skeletons_raw", items, configs, context, TO_TRACKING)

    return MotionClocks(MotionClocksConfig(solve, trusted), context)


def find_clocks(
    sets: Sequence[DetectionSet],
    context: StageContext,
    configs: Mapping[str, Config],
    trusted: str = "",
    progress: Progress = untold,
) -> Corrected:
    """Clocks, and the sets grouped anew by them; see `motion_clocks`."""
    recording = HeldRecording({"detection_sets": sets})
    clocks = motion_clocks(context, configs, trusted).run(recording, progress)
    return Corrected(clocks, regroup(sets, clocks.corrections(sets)) if sets else [])
