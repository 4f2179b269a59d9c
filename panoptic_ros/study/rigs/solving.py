"""Run stage one from detection sets to skeletons, score the skeletons, and measure the time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.graph.build import configure, merged
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.skeletons import map_joints
from panoptic_ros.simulation.skeleton import JOINTS
from panoptic_ros.stage import StageContext
from panoptic_ros.study.rigs.score import StudyScore, score_study
from panoptic_ros.study.stage1.any_skeleton import set_in_joints

SCORED = JOINTS[:15]  # all but eyes and ears
SETTLED = 2  # frames at the start without a score, while the detector's noise level is estimated
STAGES = ("association", "voting", "assembly")
# each set is solved independently, as in the paper's first stage
ALONE = {"association": {"temporal_guidance": False}}


@dataclass(frozen=True)
class Method:
    """A configuration of stage one.

    Args:
        name: name in the table.
        settings: parameters; they override those of `ALONE`.
        skeleton: name or YAML file of a skeleton; "" = that of the recording.
    """

    name: str = "default"
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    skeleton: str = ""


@dataclass(frozen=True)
class MethodResult:
    """Result of a method on a recording.

    Args:
        skeletons: one frame per detection set.
        seconds: processor time (s) of one thread per set, by stage.
    """

    skeletons: SkeletonSequence
    seconds: Mapping[str, float]


def solve(method: Method, rig: Rig, skeleton: SkeletonModel, sets: Iterable[DetectionSet]) -> MethodResult:
    """Solve the skeletons from the views of the cameras in `rig`.

    Args:
        skeleton: skeleton of the sets.
    """
    working, change = _working(method, skeleton)
    names = set(rig.names)
    frames: list[SkeletonFrame] = []
    spent: dict[str, list[int]] = {stage: [] for stage in STAGES}

    def take(topic: str, record: Any) -> None:
        if topic == "poses":
            ids = np.arange(len(record.positions))
            frames.append(SkeletonFrame(record.stamp_ns, ids, record.positions, record.covariances))

    pipeline = Pipeline(
        configure(merged(ALONE, method.settings)),
        StageContext(rig, working),
        STAGES,
        on_record=take,
        on_step=lambda stage, ns: spent[stage].append(ns),
        clock=time.thread_time_ns,
    )
    for item in sets:
        seen = replace(item, views=tuple(view for view in item.views if view.camera in names))
        pipeline.push("detection_sets", change(seen))
    seconds = {stage: 1e-9 * float(np.mean(times[_skipped(len(times)) :])) for stage, times in spent.items()}
    return MethodResult(SkeletonSequence(working.joint_names, tuple(frames)), seconds)


def _working(
    method: Method, skeleton: SkeletonModel
) -> tuple[SkeletonModel, Callable[[DetectionSet], DetectionSet]]:
    """Return the skeleton of a method, and a function that maps detection sets to its joints."""
    if not method.skeleton:
        return skeleton, lambda item: item
    working, joint_map = map_joints(method.skeleton, skeleton.joint_names)
    return working, lambda item: set_in_joints(item, working, joint_map)


def score(truth: SkeletonSequence, result: SkeletonSequence) -> StudyScore:
    """Score the 15 joints of the paper in all frames but the first ones."""
    pairs = pair_sequences(truth, result, _skipped(len(truth.frames)))
    return score_study(pairs, [truth.joint_names.index(name) for name in SCORED])


def _skipped(frames: int) -> int:
    return SETTLED if frames > 2 * SETTLED else 0
