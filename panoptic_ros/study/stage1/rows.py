"""One row of the table per method: its times and, where it gives skeletons, how good these are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain import PoseSet, TrackedPoseSet
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, evaluate
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.stage import Stage, StageContext
from panoptic_ros.study.stopwatch import Times, timed
from panoptic_ros.study.world import World

Array = np.ndarray
Settings = dict[str, dict[str, Any]]
SETTLED = 5  # frames that accuracy leaves out: temporal guidance and noise have to be learnt


class Rows:
    """Collects the rows of one case.

    budget_s: of wall time per row.
    """

    def __init__(self, world: World, budget_s: float):
        self.world, self.budget_s = world, budget_s
        self.rows: list[dict[str, Any]] = []

    def stage(self, name: str, settings: Settings) -> Stage[Any, Any]:
        """A stage of the graph with these parameters."""
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
        """Time `call` on the items and add a row; returns what the calls gave.

        Args:
            skeletons: from what a call gives, if its accuracy is to be measured.
        """
        results, times = timed(call, items, self.budget_s, warmed)
        frames = [skeletons(result) for result in results] if skeletons else None
        self.add(step, method, times, frames, note)
        return results

    def add(
        self,
        step: str,
        method: str,
        times: Times | None,
        frames: Sequence[SkeletonFrame] | None,
        note: str = "",
    ) -> None:
        """Add a row; `frames` are those of the first sets."""
        row: dict[str, Any] = {"step": step, "method": method, "note": note}
        row |= times.to_mapping() if times else {}
        row |= self.quality(frames) if frames else {}
        self.rows.append(row)

    def quality(self, frames: Sequence[SkeletonFrame]) -> dict[str, Any]:
        """Scores of skeletons against the truth, if it is known."""
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
    """The one output of a step."""
    (output,) = result.outputs
    return output


def of_poses(poses: PoseSet) -> SkeletonFrame:
    """For scoring; people without identity are numbered."""
    ids = poses.ids if isinstance(poses, TrackedPoseSet) else np.arange(len(poses.positions))
    return SkeletonFrame(poses.stamp_ns, ids, poses.positions, poses.covariances)


def of_points(stamp_ns: int, ids: Array, positions: Array) -> SkeletonFrame:
    """For scoring, of people (P, J, 3) without covariances; those without any joint are left out."""
    there = np.isfinite(positions[..., 0]).any(axis=1)
    return SkeletonFrame(stamp_ns, np.asarray(ids)[there], positions[there])
