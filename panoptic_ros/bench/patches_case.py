"""One case of `bench patches` in a process of its own: what stage two costs with so many views."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from typing import Any

from panoptic_ros.bench.child import answer_request
from panoptic_ros.bench.rendered import instants_of
from panoptic_ros.domain import PatchTrajectories
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import AFTER_DETECTION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.simulation import SKELETON, simulate
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.simulation.scenes import SCENES
from panoptic_ros.stage import StageContext

SCENE = "rendered-4p6v"
WARM = 8  # instants that are not counted


def measure(request: dict[str, Any]) -> dict[str, Any]:
    """Processor time per instant of each stage of stage two, and patches.

    Args:
        request: views, seed, frames.
    """
    rig = SCENES[SCENE].rig
    assert isinstance(rig, Ring)
    take = simulate(
        replace(SCENES[SCENE], rig=replace(rig, cameras=request["views"])), request["seed"], request["frames"]
    )
    instants = list(zip(instants_of(take, take.rig.names), take.detection_sets()))
    spent, patches = _spent(take.rig, instants, True)
    without, _ = _spent(take.rig, instants, False)
    return {
        "views": request["views"],
        "people": len(take.people),
        "patches": patches,
        "flow_ms": spent["flow"],
        "patches_ms": spent["patches"],
        "refinement_ms": spent["refinement"],
        "refinement_without_ms": without["refinement"],
    }


def _spent(rig: Any, instants: list[Any], active: bool) -> tuple[dict[str, float], float]:
    """Milliseconds per instant of each stage, and the mean number of patches."""
    spent: Counter[str] = Counter()
    counts: list[int] = []

    def gave(key: str, record: Any) -> None:
        if isinstance(record, PatchTrajectories):
            counts.append(len(record.ids))

    def used(stage: str, duration_ns: int) -> None:
        spent[stage] += duration_ns

    pipeline = Pipeline(
        configure({"patches": {"active": active}}),
        StageContext(rig, SKELETON),
        ("flow", *AFTER_DETECTION),
        on_record=gave,
        on_cpu=used,
        cpu_clock=time.thread_time_ns,
    )
    for number, (frames, views) in enumerate(instants):
        if number == WARM:
            spent.clear()
            counts.clear()
        for frame in frames if active else ():
            pipeline.push("image", frame)
        for view in views.views:
            pipeline.push("detections", view)
    counted = len(instants) - WARM
    stages = {stage: 1e-6 * ns / counted for stage, ns in spent.items()}
    pipeline.flush()
    return stages, sum(counts) / max(len(counts), 1)


if __name__ == "__main__":
    answer_request(measure)
