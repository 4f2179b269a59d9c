"""Camera clocks of a recorded capture from the motion of people; the graph's stages are the solver."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from panoptic_ros.domain import DetectionSet, TrackedPoseSet
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.passes import MotionClocks, MotionClocksConfig
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.params import Config
from panoptic_ros.stage import Progress, StageContext, untold

TO_TRACKING = FUSION[: FUSION.index("tracking") + 1]


@dataclass(frozen=True, slots=True, eq=False)
class ClockCorrection:
    """Camera clocks, and the detection sets regrouped by these clocks."""

    clocks: CameraClocks
    sets: list[DetectionSet]


def motion_clocks(context: StageContext, configs: Mapping[str, Config], trusted: str = "") -> MotionClocks:
    """Return the pass that estimates clocks, with the stages up to tracking.

    Args:
        configs: Configurations of the stages, see `graph.build.configure`.
        trusted: See `MotionClocksConfig`.
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
) -> ClockCorrection:
    """Return the estimated clocks, and the sets regrouped by them; see `motion_clocks`."""
    recording = InMemoryRecording({"detection_sets": sets})
    clocks = motion_clocks(context, configs, trusted).run(recording, progress)
    return ClockCorrection(clocks, regroup(sets, clocks.corrections(sets)) if sets else [])
