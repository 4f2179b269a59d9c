"""2D poses of a capture or of a run's results, with the ground truth if there is any, for studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture.imus import imu_file
from panoptic_ros.domain import DetectionSet
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.graph.build import merged
from panoptic_ros.identity.subjects import subject_word
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.params import Config, config_of
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.bag_topics import BagChoice
from panoptic_ros.running.plans.designated import subject_files
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.running.solve import read_task
from panoptic_ros.stage import StageContext

Array = np.ndarray
TRUTH, DETECTIONS, BAG = "truth.json.gz", "detections.json.gz", "bag"


@dataclass(frozen=True)
class DetectedCapture:
    """Inputs of the stages, and the ground truth."""

    context: StageContext
    configs: Mapping[str, Config]
    sets: Sequence[DetectionSet]
    subjects: tuple[Subject, ...]
    imus: Path | None
    truth: SkeletonSequence | None


class _DetectionSetSink:
    """Sink of a run that keeps its detection sets."""

    def __init__(self) -> None:
        self.sets: list[DetectionSet] = []

    def take(self, key: str, item: Any) -> None:
        """Keep a record of the run if it is a detection set."""
        if key == "detection_sets":
            self.sets.append(item)


def detected(
    folder: Path, cameras: Sequence[str], settings: Parameters, truth: Path | None
) -> DetectedCapture:
    """Read the 2D poses of a capture, or run the detector on it.

    Args:
        folder: images, detections.json.gz, or the results of a run with a bag. It may have imu.csv and
            subject*.json.
        cameras: names of the cameras to use; empty = all.
        truth: file to use instead of the folder's own truth, which is optional.

    Raises:
        UsageError: if the named truth does not exist, or the folder is not a capture.
    """
    if truth is None and (folder / TRUTH).is_file():
        truth = folder / TRUTH
    if truth is not None and not truth.is_file():
        raise UsageError(f"there is no truth at {truth}")
    chosen, paths = list(cameras) or None, subject_files(folder, ())
    offsets = str(settings.get("kinematics", {}).get("offsets", ""))
    extras = body_extras(paths, offsets=offsets)
    subjects: tuple[Subject, ...] = extras["subjects"]
    known: dict[str, dict[str, Any]] = {
        "kinematics": {"everybody": not paths, "subjects": [str(path) for path in paths]},
        "tracking": {"subjects": [subject_word(subject.id, subject.start) for subject in subjects]},
    }
    if (folder / DETECTIONS).is_file():
        task = read_task(folder / "rig.json", folder / DETECTIONS, merged(settings, known), cameras=chosen)
        context, configs, sets = task.context, task.configs, task.sets
    else:
        if (folder / BAG).is_dir():
            plan = plan_bags([folder / BAG], RunOptions(settings), choice=BagChoice(cameras=chosen))
        else:
            plan = plan_capture(folder, RunOptions(settings), cameras=chosen, depth=False)
        kept = _DetectionSetSink()
        run_in_process(plan, kept, lambda: False)
        context, sets = StageContext(plan.rig, plan.skeleton, plan.extras), kept.sets
        configs = dict(plan.configs)
        if not paths:
            configs["kinematics"] = replace(config_of(configs, KinematicsConfig), everybody=True)
    context = replace(context, extras={**context.extras, **extras})
    names = context.skeleton.joint_names
    joints = None
    if truth is not None:
        joints = _truth_of(truth, subjects, names) if subjects else read_sequence(truth)
    return DetectedCapture(context, configs, sets, subjects, imu_file(folder) if subjects else None, joints)


def _truth_of(path: Path, subjects: Sequence[Subject], names: Sequence[str]) -> SkeletonSequence:
    """Convert the ground truth of bodies to the joints of the detector."""
    _, states = read_bodies(path)
    keypoints = {subject.id: subject.body.keypoints for subject in subjects}
    at: dict[int, list[tuple[int, Array]]] = {}
    for state in states:
        joints = np.full((len(names), 3), np.nan)
        for j, name in enumerate(names):
            if name in keypoints[state.id]:
                segment, offset = keypoints[state.id][name]
                joints[j] = state.places[segment] + state.frames[segment] @ offset
        at.setdefault(state.stamp_ns, []).append((state.id, joints))
    frames = (
        SkeletonFrame(stamp, np.array([i for i, _ in found]), np.array([x for _, x in found]))
        for stamp, found in sorted(at.items())
    )
    return SkeletonSequence(tuple(names), tuple(frames))
