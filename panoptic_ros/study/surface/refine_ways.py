"""Methods to smooth a capture that was run once, for the studies of refinement."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import (
    DepthFrame,
    PatchTracks,
    PatchTrajectories,
    RefinedPoseSet,
    Rig,
    SkeletonModel,
    TrackedPoseSet,
)
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import FramePair, SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.filtering import one_euro, savitzky_golay
from panoptic_ros.graph.build import make_stage, merged
from panoptic_ros.graph.offline_refinement import OfflineAveraging, OfflineRefinement
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.params import Config, config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.surface.refine_depth import depth_frames, with_sensors

TRUTHS = ("truth.json.gz", "truth.json")
UNKNOWN = 0.1**2  # m^2, variance of joints that averaging filled in, because averaging states none
Array = np.ndarray
PoseSequence = Sequence[TrackedPoseSet | SkeletonFrame]


@dataclass
class RefinementInputs:
    """Inputs of refinement from a run, and its ground truth.

    Args:
        rig: rig, with depth sensors if their maps are used.
        raw, tracks, maps: unrefined skeletons, 2D patch tracks and depth maps, each in order of timestamps.
    """

    plan: Plan
    rig: Rig
    truth: SkeletonSequence
    raw: list[TrackedPoseSet] = field(default_factory=list)
    tracks: list[PatchTracks] = field(default_factory=list)
    maps: list[DepthFrame] = field(default_factory=list)

    @property
    def skeleton(self) -> SkeletonModel:
        """Return the skeleton of all persons."""
        return self.plan.skeleton

    @property
    def truth_order(self) -> list[int]:
        """Return the truth's index of each joint of the skeleton."""
        return [list(self.truth.joint_names).index(name) for name in self.skeleton.joint_names]

    def without_maps(self) -> RefinementInputs:
        """Return the run without depth maps."""
        return replace(self, rig=self.plan.rig, maps=[])

    def pairs(self, items: PoseSequence) -> list[FramePair]:
        """Match skeletons with those of the truth."""
        frames = tuple(SkeletonFrame(item.stamp_ns, item.ids, item.positions) for item in items)
        return pair_sequences(self.truth, SkeletonSequence(self.skeleton.joint_names, frames))

    def ordered(self, shown: Sequence[TrackedPoseSet]) -> list[Any]:
        """Return all items by timestamp; at equal timestamps, skeletons come last."""
        items = [*self.tracks, *self.maps, *shown]
        return sorted(items, key=lambda item: (item.stamp_ns, isinstance(item, TrackedPoseSet)))

    def patches(
        self, shown: Sequence[TrackedPoseSet] | None = None, **parameters: Any
    ) -> list[PatchTrajectories]:
        """Reconstruct patches on the skeletons `shown`; default: the unrefined skeletons.

        Args:
            parameters: overrides of the parameters of the stage.
        """
        config = replace(self.plan.configs["patches"], **parameters)
        stage = make_stage("patches", config, StageContext(self.rig, self.skeleton))
        return [
            found
            for item in self.ordered(self.raw if shown is None else shown)
            for found in stage.step(item).outputs
        ]


def play(
    folder: Path, cameras: Sequence[str], settings: Parameters, depth: str, seed: int, progress: Progress
) -> RefinementInputs:
    """Run a capture and keep the inputs of refinement.

    Args:
        depth: "given": use the folder's depth maps unchanged; "kinect": add the noise of a sensor; "none".
        seed: seed of the sensor noise.

    Raises:
        UsageError: if the folder has no truth, or is not a capture.
    """
    truth_file = next((folder / name for name in TRUTHS if (folder / name).is_file()), None)
    if truth_file is None:
        raise UsageError(f"{folder} has no {TRUTHS[0]}: name a capture folder with its truth")
    options = RunOptions(merged({"patches": {"active": True}}, settings))
    plan = plan_capture(folder, options, cameras=list(cameras) or None, depth=False)
    rig = with_sensors(folder, plan.rig) if depth != "none" else plan.rig
    played, stamps = played_on(plan, rig, read_sequence(truth_file), progress)
    if depth != "none":
        maps = depth_frames(folder, rig, stamps, depth == "kinect", seed)
        played.maps = sorted(maps, key=lambda item: item.stamp_ns)
    return played


def played_on(
    plan: Plan, rig: Rig, truth: SkeletonSequence, progress: Progress
) -> tuple[RefinementInputs, dict[tuple[str, int], int]]:
    """Run a plan.

    Returns:
        the inputs of refinement, and the timestamps (ns) of the images by camera and frame number.
    """
    kept = _RefinementInputSink(RefinementInputs(plan, rig, truth), progress, plan.instants or 1)
    run_in_process(plan, kept, lambda: False)
    return kept.played, kept.stamps


class _RefinementInputSink:
    """Sink of a run that keeps the inputs of refinement and the timestamps of images."""

    def __init__(self, played: RefinementInputs, progress: Progress, instants: int):
        self.played, self.stamps = played, dict[tuple[str, int], int]()
        self._progress, self._instants = progress, instants

    def take(self, key: str, item: Any) -> None:
        """Keep a record of the run."""
        if key == "patch_tracks":
            self.played.tracks.append(item)
        elif key == "detections":
            self.stamps[item.camera, item.frame_number] = item.stamp_ns
        elif key == "skeletons_raw":
            self.played.raw.append(item)
            self._progress(min(0.8, 0.8 * len(self.played.raw) / self._instants), "solving")


def smoothed(
    played: RefinementInputs, lag: float, patches: Sequence[PatchTrajectories]
) -> list[RefinedPoseSet]:
    """Run the online smoother with this lag (s)."""
    config = replace(config_of(played.plan.configs, RefinementConfig), lag=lag)
    stage = make_stage("refinement", config, StageContext(played.rig, played.skeleton))
    # The graph delivers the patches of a set before the set. The patches stage emits them after it.
    items: list[TrackedPoseSet | PatchTrajectories] = [*played.raw, *patches]
    items.sort(key=lambda item: (item.stamp_ns, isinstance(item, TrackedPoseSet)))
    given = [output for item in items for output in stage.step(item).outputs]
    return [*given, *stage.flush().outputs]


def offline(played: RefinementInputs) -> list[RefinedPoseSet]:
    """Refine the whole recording at once; patches are associated again."""
    configs: Mapping[str, Config] = played.plan.configs
    refinement = OfflineRefinement(configs, StageContext(played.rig, played.skeleton))
    found = [output for item in played.ordered(played.raw) for output in refinement.take(item)]
    return [*found, *refinement.flush()]


def paper(played: RefinementInputs) -> tuple[list[RefinedPoseSet], int]:
    """Run the paper's averaging after its free-space test.

    Returns:
        refined skeletons, and the number of rounds.
    """
    averaging = OfflineAveraging(played.plan.configs, StageContext(played.rig, played.skeleton))
    for item in played.ordered(played.raw):
        averaging.take(item)
    return list(averaging.flush()), averaging.rounds


FILTERS: dict[str, tuple[float, Callable[[Sequence[TrackedPoseSet]], list[SkeletonFrame]]]] = {
    "one-euro": (0.0, one_euro),
    "Savitzky-Golay": (0.12, savitzky_golay),
}
