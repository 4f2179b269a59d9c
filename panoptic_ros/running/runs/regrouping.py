"""Detection sets of a run, made once more from its views: by the last clocks that it found."""

from __future__ import annotations

from collections.abc import Iterable

from panoptic_ros.domain import ClockModel, DetectionSet, ViewDetections
from panoptic_ros.graph.build import make_stage
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import StageContext


def regrouped(
    plan: Plan, clocks: Iterable[ClockModel], views: Iterable[ViewDetections]
) -> list[DetectionSet]:
    """The views put together as the graph does.

    Args:
        clocks: at most one model of each clock.
    """
    stage = make_stage("sync", plan.configs["sync"], StageContext(plan.rig, plan.skeleton))
    side_by_side = sorted(views, key=lambda view: plan.at(view.camera, view.stamp_ns))
    steps = [stage.step(item) for item in (*clocks, *side_by_side)]
    return [item for result in (*steps, stage.flush()) for item in result.outputs]
