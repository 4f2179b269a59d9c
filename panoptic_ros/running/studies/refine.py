"""`panoptic evaluate --study refine`: what the motion of the surface is worth on a capture with truth."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import PatchTrajectories, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
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
from panoptic_ros.stage import Progress, StageContext

LAGS = (0.0, 0.12, 1.0)  # s
TRUTHS = ("truth.json.gz", "truth.json")


class _Kept:
    """What refinement takes, of a run."""

    def __init__(self, progress: Progress, instants: int):
        self.items: list[TrackedPoseSet | PatchTrajectories] = []
        self._progress, self._instants, self._done = progress, max(instants, 1), 0

    def take(self, key: str, item: Any) -> None:
        """A record of the run."""
        if key in ("skeletons_raw", "patches"):
            self.items.append(item)
        if key == "skeletons_raw":
            self._done += 1
            self._progress(min(0.9, 0.9 * self._done / self._instants), "solving")


def study_refinement(
    folder: Path, cameras: Sequence[str], settings: Parameters, progress: Progress
) -> dict[str, Any]:
    """Figures of every method and lag, for JSON.

    Args:
        folder: a capture folder with its truth. cameras: only these; empty = all.
        settings: {stage: {parameter: value}}, for all methods.

    Raises:
        UsageError: if the folder has no truth, or is no capture.
    """
    truth_file = next((folder / name for name in TRUTHS if (folder / name).is_file()), None)
    if truth_file is None:
        raise UsageError(f"{folder} has no {TRUTHS[0]}: name a capture folder with its truth")
    truth = read_sequence(truth_file)
    options = RunOptions(merged({"patches": {"active": True}}, settings))
    plan = plan_capture(folder, options, cameras=list(cameras) or None)
    kept = _Kept(progress, plan.instants or 1)
    run_in_process(plan, kept, lambda: False)  # type: ignore[arg-type]  # it only takes records
    # patches of a set come before it, as in the graph; a stage gives them after it
    both = sorted(kept.items, key=lambda item: (item.stamp_ns, isinstance(item, TrackedPoseSet)))
    raw = [item for item in both if isinstance(item, TrackedPoseSet)]
    rows = [_row("none", 0.0, raw, plan, truth)]
    rows.append(_row("Savitzky-Golay", 0.12, savitzky_golay(raw), plan, truth))
    for lag in LAGS:
        for name, items in (("smoother", raw), ("smoother, patches", both)):
            rows.append(_row(name, lag, _refined(items, plan, lag), plan, truth))
    progress(1.0, "scoring")
    return {"study": "refine", "capture": str(folder), "cameras": list(plan.rig.names), "rows": rows}


def study_lines(result: Mapping[str, Any]) -> list[str]:
    """The figures as a table."""
    lines = [
        f"refinement of {result['capture']}, {len(result['cameras'])} cameras",
        f"{'method':18} {'lag s':>6} {'acc m/s2':>9} {'MPJPE mm':>9} {'offset-free mm':>15} {'p95':>6} "
        f"{'> 1 m/s':>8} {'PCK 10 cm':>10}",
    ]
    for row in result["rows"]:
        lines.append(
            f"{row['method']:18} {row['lag_s']:6.2f} {row['acceleration_error']:9.2f} {row['mpjpe_mm']:9.1f} "
            f"{row['offset_free_mm']:15.2f} {row['offset_free_p95_mm']:6.1f} {row['fast_mm']:8.2f} "
            f"{row['pck_10cm']:10.4f}"
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


def _row(
    method: str, lag: float, items: Sequence[TrackedPoseSet | SkeletonFrame], plan: Plan,
    truth: SkeletonSequence,
) -> dict[str, Any]:  # fmt: skip
    frames = tuple(SkeletonFrame(item.stamp_ns, item.ids, item.positions) for item in items)
    pairs = pair_sequences(truth, SkeletonSequence(plan.skeleton.joint_names, frames))
    return {"method": method, "lag_s": lag, **refinement_scores(pairs, truth.joint_names)}
