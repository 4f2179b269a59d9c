"""`panoptic evaluate --study refine`: what the motion of the surface is worth on a capture with truth."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import PatchTracks, PatchTrajectories, RefinedPoseSet, Rig, TrackedPoseSet
from panoptic_ros.domain.parts import HEAD_WORDS
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import FramePair, SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.filtering import savitzky_golay
from panoptic_ros.evaluation.refinement_scores import refinement_scores
from panoptic_ros.graph.build import make_stage, merged
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.running.studies.refine_depth import depth_frames, free_space, transforms, with_sensors
from panoptic_ros.stage import Progress, StageContext

LAGS = (0.0, 0.12, 1.0)  # s
TRUTHS = ("truth.json.gz", "truth.json")


class _Kept:
    """What refinement takes, of a run."""

    def __init__(self, progress: Progress, instants: int):
        self.items: list[TrackedPoseSet | PatchTrajectories | PatchTracks] = []
        self.stamps: dict[tuple[str, int], int] = {}
        self._progress, self._instants, self._done = progress, max(instants, 1), 0

    def take(self, key: str, item: Any) -> None:
        """A record of the run."""
        if key in ("skeletons_raw", "patches", "patch_tracks"):
            self.items.append(item)
        if key == "detections":
            self.stamps[item.camera, item.frame_number] = item.stamp_ns
        if key == "skeletons_raw":
            self._done += 1
            self._progress(min(0.9, 0.9 * self._done / self._instants), "solving")


def study_refinement(
    folder: Path, cameras: Sequence[str], settings: Parameters, depth: str, seed: int, progress: Progress
) -> dict[str, Any]:
    """Figures of every method and lag, for JSON.

    Args:
        folder: a capture folder with its truth. cameras: only these; empty = all.
        settings: {stage: {parameter: value}}, for all methods.
        depth: "given": rows with the folder's depth maps, as they are; "kinect": with the noise of a sensor,
            drawn by the seed; "none". All other rows go without them.

    Raises:
        UsageError: if the folder has no truth, or is no capture.
    """
    truth_file = next((folder / name for name in TRUTHS if (folder / name).is_file()), None)
    if truth_file is None:
        raise UsageError(f"{folder} has no {TRUTHS[0]}: name a capture folder with its truth")
    truth = read_sequence(truth_file)
    options = RunOptions(merged({"patches": {"active": True}}, settings))
    plan = plan_capture(folder, options, cameras=list(cameras) or None, depth=False)
    kept = _Kept(progress, plan.instants or 1)
    run_in_process(plan, kept, lambda: False)  # type: ignore[arg-type]  # it only takes records
    # patches of a set come before it, as in the graph; a stage gives them after it
    raw = [item for item in kept.items if isinstance(item, TrackedPoseSet)]
    patches = [item for item in kept.items if isinstance(item, PatchTrajectories)]
    ways: dict[str, Sequence[TrackedPoseSet | PatchTrajectories]] = {
        "smoother": raw, "smoother, patches": _merged(raw, patches)
    }  # fmt: skip
    pairs = _pairs(raw, plan, truth)
    told = {"images": _motion_scores(patches, pairs, plan, truth)}
    rig = with_sensors(folder, plan.rig) if depth != "none" else plan.rig
    frames = list(depth_frames(folder, rig, kept.stamps, depth == "kinect", seed)) if depth != "none" else []
    if frames:
        tracks = [item for item in kept.items if isinstance(item, PatchTracks)]
        sensed = _patched([*tracks, *frames, *raw], plan, rig)
        ways["smoother, patches, depth"] = _merged(raw, sensed)
        told["depth"] = _motion_scores(sensed, pairs, plan, truth)
        face = np.array([any(word in name.lower() for word in HEAD_WORDS) for name in truth.joint_names])
        told["depth"] |= free_space(rig, frames, pairs, face)
    rows = [_row("none", 0.0, raw, plan, truth)]
    rows.append(_row("Savitzky-Golay", 0.12, savitzky_golay(raw), plan, truth))
    for lag in LAGS:
        for name, items in ways.items():
            rows.append(_row(name, lag, _refined(items, plan, lag), plan, truth))
    progress(1.0, "scoring")
    names = list(plan.rig.names)
    return {"study": "refine", "capture": str(folder), "cameras": names, "rows": rows, "motions": told}


def study_lines(result: Mapping[str, Any]) -> list[str]:
    """The figures as a table."""
    lines = [
        f"refinement of {result['capture']}, {len(result['cameras'])} cameras",
        f"{'method':24} {'lag s':>6} {'acc m/s2':>9} {'MPJPE mm':>9} {'offset-free mm':>15} {'p95':>6} "
        f"{'> 1 m/s':>8} {'PCK 10 cm':>10}",
    ]
    for row in result["rows"]:
        lines.append(
            f"{row['method']:24} {row['lag_s']:6.2f} {row['acceleration_error']:9.2f} {row['mpjpe_mm']:9.1f} "
            f"{row['offset_free_mm']:15.2f} {row['offset_free_p95_mm']:6.1f} {row['fast_mm']:8.2f} "
            f"{row['pck_10cm']:10.4f}"
        )
    for name, own in result["motions"].items():
        lines.append(
            f"parts, by {name}: joints carried over one instant err by {own['t_median_mm']:.1f} mm (median), "
            f"{own['t_p90_mm']:.1f} mm (90 %), for {own['t_available']:.1%} of them"
        )
        if "free_true" in own:
            lines.append(
                f"free space: {own['free_true']:.2%} of true and {own['free_measured']:.2%} of good measured "
                f"joints taken for outliers, {own['free_outliers']:.0%} of those that are 15 cm off found"
            )
    return lines


def _refined(
    items: Sequence[TrackedPoseSet | PatchTrajectories], plan: Plan, lag: float
) -> list[RefinedPoseSet]:
    config = plan.configs["refinement"]
    assert isinstance(config, RefinementConfig)
    stage = make_stage("refinement", replace(config, lag=lag), StageContext(plan.rig, plan.skeleton))
    given = [output for item in items for output in stage.step(item).outputs]
    return [*given, *stage.flush().outputs]


def _merged(
    raw: Sequence[TrackedPoseSet], patches: Sequence[PatchTrajectories]
) -> list[TrackedPoseSet | PatchTrajectories]:
    """In the order of the graph: patches of a set come before it; a stage gives them after it."""
    return sorted([*raw, *patches], key=lambda item: (item.stamp_ns, isinstance(item, TrackedPoseSet)))


def _patched(items: Sequence[Any], plan: Plan, rig: Rig) -> list[PatchTrajectories]:
    """Patches once more, with the maps of the depth sensors of a rig."""
    stage = make_stage("patches", plan.configs["patches"], StageContext(rig, plan.skeleton))
    ordered = sorted(items, key=lambda item: (item.stamp_ns, isinstance(item, TrackedPoseSet)))
    return [output for item in ordered for output in stage.step(item).outputs]


def _motion_scores(
    patches: Sequence[PatchTrajectories], pairs: Sequence[FramePair], plan: Plan, truth: SkeletonSequence
) -> dict[str, float]:
    order = [list(truth.joint_names).index(name) for name in plan.skeleton.joint_names]
    return transforms(patches, pairs, StageContext(plan.rig, plan.skeleton), order)


def _pairs(
    items: Sequence[TrackedPoseSet | SkeletonFrame], plan: Plan, truth: SkeletonSequence
) -> list[FramePair]:
    frames = tuple(SkeletonFrame(item.stamp_ns, item.ids, item.positions) for item in items)
    return pair_sequences(truth, SkeletonSequence(plan.skeleton.joint_names, frames))


def _row(
    method: str, lag: float, items: Sequence[TrackedPoseSet | SkeletonFrame], plan: Plan,
    truth: SkeletonSequence,
) -> dict[str, Any]:  # fmt: skip
    scores = refinement_scores(_pairs(items, plan, truth), truth.joint_names)
    return {"method": method, "lag_s": lag, **scores}
