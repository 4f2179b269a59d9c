"""2D people in a file to skeletons, with the stages of the graph but without ROS."""
from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.domain import DetectionSet, TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.detector_context import bias_extras
from panoptic_ros.io.plain_formats import PlainDetections, read_detections
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import map_joints, skeleton_of
from panoptic_ros.params import Config, config_of
from panoptic_ros.running.parameters import with_occluders
from panoptic_ros.stage import Notice, StageContext

AUTO = "auto"  # skeleton: the joints of the detections, or panoptic19 for COCO's


@dataclass(frozen=True)
class SolveTask:
    """2D people of a recording, with all that the stages need.

    Args:
        sets: in the order of time.
        joint_names: of the result, in the order of the skeleton's joints.
    """

    context: StageContext
    configs: Mapping[str, Config]
    sets: Sequence[DetectionSet]
    joint_names: tuple[str, ...]


@dataclass(frozen=True)
class Solution:
    """What the stages made of it.

    Args:
        poses: of every instant.
        spent_ns: time that every stage took for each of its inputs.
        notices: of all stages, in the order in which they came.
    """

    poses: Sequence[TrackedPoseSet]
    spent_ns: Mapping[str, Sequence[int]]
    notices: Sequence[Notice]


def read_task(
    rig: Path,
    detections: Path,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    skeleton: str = AUTO,
    cameras: Sequence[str] | None = None,
    occluders: Path | None = None,
) -> SolveTask:
    """What is to be solved, from files.

    Args:
        rig: calibration file.
        detections: plain file of 2D people.
        parameters: {stage: {parameter: value}}.
        skeleton: name or YAML file, or `AUTO`.
        cameras: use only these.
        occluders: file with fixed things that hide people.

    Raises:
        UserError: on whatever the user can mend.
    """
    everything = with_occluders(read_rig(rig), occluders)
    used = everything if cameras is None else everything.subset(cameras)
    if len(used) < 2:
        raise UsageError(f"{len(used)} camera is not enough for 3D; give two or more")
    people = read_detections(detections)
    model, joint_map = map_joints(_choose(people) if skeleton == AUTO else skeleton, people.joint_names)
    configs = configure(parameters)
    table = config_of(configs, AssemblyConfig).bias_table
    context = StageContext(used, model, bias_extras(table, model))
    sets = list(people.sets(used, joint_map, model.hash, known=everything.names))
    names = _own_names(people, model.joint_names) if skeleton == AUTO else model.joint_names
    return SolveTask(context, configs, sets, names)


def solve(task: SolveTask) -> Solution:
    """Push all sets through the stages after sync."""
    poses: list[TrackedPoseSet] = []
    notices: list[Notice] = []
    spent: dict[str, list[int]] = {}
    pipeline = Pipeline(
        task.configs, task.context, FUSION,
        on_record=lambda topic, record: poses.append(record) if topic == "skeletons" else None,
        on_notice=lambda stage, notice: notices.append(notice),
        on_step=lambda stage, ns: spent.setdefault(stage, []).append(ns),
        clock=time.perf_counter_ns,
    )  # fmt: skip
    for item in task.sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    return Solution(poses, spent, notices)


def _choose(detections: PlainDetections) -> str:
    """The installed skeleton with the joints of the file; panoptic19 for COCO's and for others."""
    found = skeleton_of(detections.joint_names)
    return "panoptic19" if found in (None, "coco17") else found


def _own_names(detections: PlainDetections, joints: tuple[str, ...]) -> tuple[str, ...]:
    """The joints as the detections spell them, where the skeleton was chosen after them."""
    _, mapping = map_joints(_choose(detections), detections.joint_names)
    return tuple(
        detections.joint_names[s[0]] if len(s) == 1 and len(mapping.sources) == len(detections.joint_names)
        else joint
        for joint, s in zip(joints, mapping.sources)
    )  # fmt: skip
