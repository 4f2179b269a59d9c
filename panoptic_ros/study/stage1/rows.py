"""Table rows of one case: times of a method and, if it yields skeletons, their accuracy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain import PoseSet, TrackedPoseSet
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, evaluate
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.stage import Stage, StageContext
from panoptic_ros.study.stopwatch import CallTimes, timed
from panoptic_ros.study.world import World

Array = np.ndarray
Settings = dict[str, dict[str, Any]]
SETTLED = 5  # frames without a score, while temporal guidance and noise level settle


class Rows:
    """Collector of the rows of one case.

    Args:
        world: detection sets and ground truth.
        budget_s: processor time (s) per row.
    """

    def __init__(self, world: World, budget_s: float):
        self.world, self.budget_s = world, budget_s
        self.rows: list[dict[str, Any]] = []

    def stage(self, name: str, settings: Settings) -> Stage[Any, Any]:
        """Return a stage of the graph with these parameters."""
        context = StageContext(self.world.rig, self.world.skeleton)
        return make_stage(name, configure(settings)[name], context)

    def run(
        self,
        step: str,
        method: str,
        call: Callable[[Any], Any],
        items: Iterable[Any],
        skeletons: Callable[[Any], SkeletonFrame] | None = None,
        note: str = "",
        warmed: bool = False,
    ) -> list[Any]:
        """Time `call` on the items, add a row, and return the results of the calls.

        Args:
            skeletons: converts a result to a skeleton frame; None = do not measure accuracy.
        """
        results, times = timed(call, items, self.budget_s, warmed)
        frames = [skeletons(result) for result in results] if skeletons else None
        self.add(step, method, times, frames, note)
        return results

    def add(
        self,
        step: str,
        method: str,
        times: CallTimes | None,
        frames: Sequence[SkeletonFrame] | None,
        note: str = "",
    ) -> None:
        """Add a row; `frames` belong to the first sets."""
        row: dict[str, Any] = {"step": step, "method": method, "note": note}
        row |= times.to_mapping() if times else {}
        row |= self.quality(frames) if frames else {}
        self.rows.append(row)

    def quality(self, frames: Sequence[SkeletonFrame]) -> dict[str, Any]:
        """Return the scores of skeletons against the ground truth; empty if it is unknown."""
        truth = self.world.truth
        if truth is None:
            return {}
        stamps = {frame.stamp_ns for frame in frames}
        wanted = [frame for frame in truth.frames if frame.stamp_ns in stamps] or list(truth.frames)
        skip = SETTLED if len(wanted) > 2 * SETTLED else 0
        if not wanted:
            return {}
        result = SkeletonSequence(self.world.skeleton.joint_names, tuple(frames))
        scores = evaluate(SkeletonSequence(truth.joint_names, tuple(wanted)), result, skip).to_mapping()
        names = ("mpjpe_mm", "median_mm", "joint_recall", "person_recall", "person_precision")
        return {name: scores[name] for name in names} | {"scored_frames": scores["frames"]}


def only(result: Any) -> Any:
    """Return the single output of a step."""
    (output,) = result.outputs
    return output


def of_poses(poses: PoseSet) -> SkeletonFrame:
    """Convert a pose set to a skeleton frame for scoring; persons without identity get numbers."""
    ids = poses.ids if isinstance(poses, TrackedPoseSet) else np.arange(len(poses.positions))
    return SkeletonFrame(poses.stamp_ns, ids, poses.positions, poses.covariances)


def of_points(stamp_ns: int, ids: Array, positions: Array) -> SkeletonFrame:
    """Convert joints (P, J, 3) without covariances to a skeleton frame for scoring.

    Persons without any joint are left out.
    """
    there = np.isfinite(positions[..., 0]).any(axis=1)
    return SkeletonFrame(stamp_ns, np.asarray(ids)[there], positions[there])
