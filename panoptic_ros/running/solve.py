"""Estimates 3D poses from a file of 2D poses, with the stages of the graph but without ROS."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.domain import DetectionSet, Rig, TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.free_running import free_running
from panoptic_ros.evaluation.nobody import why_nobody
from panoptic_ros.evaluation.rig_check import check_rig
from panoptic_ros.evaluation.rig_up import assumed_up
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import REPAIRED, Pipeline
from panoptic_ros.io.detector_context import bias_extras, noise_only
from panoptic_ros.io.recorded_people import AUTO, read_people
from panoptic_ros.params import Config, config_of
from panoptic_ros.running.grouping import grouped, is_ungrouped, views_in_order
from panoptic_ros.running.plans.parameters import with_occluders
from panoptic_ros.running.plans.rig_files import read_rig_at
from panoptic_ros.stage import Notice, StageContext
from panoptic_ros.sync.far_views import without_far_views


@dataclass(frozen=True)
class SolveTask:
    """Input of `solve`: the 2D poses of a recording, and everything that the stages need.

    Args:
        context: Rig, skeleton and extras of the stages.
        configs: Configuration of every stage by name.
        sets: Detection sets in time order.
        joint_names: Joint names of the result, in the order of the skeleton's joints.
        notices: Lines about input that was left out.
    """

    context: StageContext
    configs: Mapping[str, Config]
    sets: Sequence[DetectionSet]
    joint_names: tuple[str, ...]
    notices: tuple[str, ...] = ()

    def told(self) -> list[str]:
        """Return lines that state what was left out or assumed."""
        return [*self.notices, *assumed_up(self.context.rig), *noise_only(self.context.skeleton.bias_floors)]


@dataclass(frozen=True)
class SolveResult:
    """Output of `solve`.

    Args:
        poses: 3D poses of every instant.
        spent_ns: For every stage, the processing time of each of its inputs, ns.
        notices: Notices of all stages, in the order of their arrival.
        rig: The rig with corrected cameras; None = no camera was corrected.
    """

    poses: Sequence[TrackedPoseSet]
    spent_ns: Mapping[str, Sequence[int]]
    notices: Sequence[Notice]
    rig: Rig | None = None


def read_task(
    rig: Path,
    detections: Path,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    skeleton: str = AUTO,
    cameras: Sequence[str] | None = None,
    occluders: Path | None = None,
) -> SolveTask:
    """Read the input of `solve` from files.

    Args:
        rig: Calibration file, or a folder that contains one.
        detections: Plain file of 2D poses.
        parameters: {stage: {parameter: value}}.
        skeleton: Name or YAML file, or `AUTO`.
        cameras: Names of the cameras to use; None = all.
        occluders: File of static objects that occlude people.

    Raises:
        UserError: on any input fault that the user can fix.
    """
    return task_of(
        with_occluders(read_rig_at(rig, cameras=cameras), occluders), detections, parameters, skeleton
    )


def task_of(
    rig: Rig, detections: Path, parameters: Mapping[str, Mapping[str, Any]], skeleton: str = AUTO
) -> SolveTask:
    """Return the input of `solve` for the cameras of a rig; for the arguments see `read_task`.

    Raises:
        UserError: on any input fault that the user can fix.
    """
    if len(rig) < 2:
        raise UsageError(f"{len(rig)} camera is not enough for 3D; give two or more")
    people = read_people(detections, rig, skeleton)
    configs = configure(parameters)
    table = config_of(configs, AssemblyConfig).bias_table
    context = StageContext(rig, people.skeleton, bias_extras(table, people.skeleton))
    sets, told = people.sets, people.told()
    if is_ungrouped(sets):
        sets, notices = grouped(configs, context, views_in_order(sets))
        told.append(f"views come one per frame in {detections}; they are grouped into {len(sets)} sets")
        told += [notice.text for notice in notices if notice.severity != "info"]
    return SolveTask(context, configs, sets, people.joint_names, tuple(told))


def check(task: SolveTask) -> tuple[Notice, ...]:
    """Return the warnings of `panoptic rig check` for the rig of a task."""
    sets, _ = without_far_views(task.sets)
    return check_rig(task.context.rig, sets, task.context.skeleton).warnings


def solve(task: SolveTask, warnings: Sequence[Notice] = ()) -> SolveResult:
    """Run all detection sets through the stages that follow sync.

    Views whose timestamps disagree with the majority of their set are left out.

    Args:
        warnings: result of `check`. These warnings may explain why no person is found.
    """
    poses: list[TrackedPoseSet] = []
    sets, notices = without_far_views(task.sets)
    spent: dict[str, list[int]] = {}
    kept: dict[str, list[Any]] = {"skeletons": poses, REPAIRED: []}
    pipeline = Pipeline(
        task.configs,
        task.context,
        (*FUSION, "health"),
        on_record=lambda topic, record: kept[topic].append(record) if topic in kept else None,
        on_notice=lambda stage, notice: notices.append(notice),
        on_step=lambda stage, ns: spent.setdefault(stage, []).append(ns),
        clock=time.perf_counter_ns,
    )
    for item in sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    notices += why_nobody(sets, sum(len(item.ids) for item in poses), warnings)
    if (found := free_running(sets)) is not None:
        text = f"{found}; use `panoptic continuous` with the same --rig and --detections"
        notices.append(Notice("result.free_running", "warning", text))
    return SolveResult(poses, spent, notices, kept[REPAIRED][-1] if kept[REPAIRED] else None)
