"""From detection sets to skeletons with stage one, how good they are and what they cost."""

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
from panoptic_ros.stage import StageContext
from panoptic_ros.study.rigs.score import StudyScore, score_study
from panoptic_ros.study.stage1.any_skeleton import set_in_joints

SCORED = (
    "Neck",
    "Nose",
    "BodyCenter",
    "lShoulder",
    "lElbow",
    "lWrist",
    "lHip",
    "lKnee",
    "lAnkle",
    "rShoulder",
    "rElbow",
    "rWrist",
    "rHip",
    "rKnee",
    "rAnkle",
)
SETTLED = 2  # frames at the start that do not count: the noise of the detector is being learnt
STAGES = ("association", "voting", "assembly")
ALONE = {"association": {"temporal_guidance": False}}  # every instant by itself, as the paper's first stage


@dataclass(frozen=True)
class Method:
    """A way to solve.

    Args:
        settings: parameters; those of `ALONE` count where these are silent.
        skeleton: its name or YAML file, "" = that of the recording.
    """

    name: str = "default"
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    skeleton: str = ""


@dataclass(frozen=True)
class Solved:
    """What a method made of a recording. seconds: of one thread, per instant, by stage."""

    skeletons: SkeletonSequence
    seconds: Mapping[str, float]


def solve(method: Method, rig: Rig, skeleton: SkeletonModel, sets: Iterable[DetectionSet]) -> Solved:
    """The skeletons of the views of `rig`; skeleton: of the sets."""
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
    return Solved(SkeletonSequence(working.joint_names, tuple(frames)), seconds)


def _working(
    method: Method, skeleton: SkeletonModel
) -> tuple[SkeletonModel, Callable[[DetectionSet], DetectionSet]]:
    """The skeleton that a method works on, and what makes sets of another one fit it."""
    if not method.skeleton:
        return skeleton, lambda item: item
    working, joint_map = map_joints(method.skeleton, skeleton.joint_names)
    return working, lambda item: set_in_joints(item, working, joint_map)


def score(truth: SkeletonSequence, result: SkeletonSequence) -> StudyScore:
    """The 15 joints of the paper, in all frames but the first ones."""
    pairs = pair_sequences(truth, result, _skipped(len(truth.frames)))
    return score_study(pairs, [truth.joint_names.index(name) for name in SCORED])


def _skipped(frames: int) -> int:
    return SETTLED if frames > 2 * SETTLED else 0
