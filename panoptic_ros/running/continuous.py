"""Turns a file of 2D poses into motion as a function of time, without ROS."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.errors import DataError
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.io.loading import parsing, read_bytes
from panoptic_ros.io.recorded_people import AUTO, read_people
from panoptic_ros.running.plans.rig_files import read_rig_at
from panoptic_ros.stage import Progress, StageContext

Array = np.ndarray
COLUMN = "stamp_ns"


@dataclass(frozen=True)
class ContinuousTask:
    """Input of the pass.

    Args:
        context: rig and skeleton.
        recording: the 2D people.
        config: options.
        joint_names: joint names of the result.
        notices: lines about input that was left out.
    """

    context: StageContext
    recording: InMemoryRecording
    config: ContinuousConfig
    joint_names: tuple[str, ...]
    notices: tuple[str, ...] = ()


def read_continuous_task(
    rig: Path, detections: Path, config: ContinuousConfig, skeleton: str = AUTO
) -> ContinuousTask:
    """Read the input of the pass from files.

    Raises:
        UserError: on any input fault that the user can fix.
    """
    cameras = read_rig_at(rig)
    people = read_people(detections, cameras, skeleton)
    recording = InMemoryRecording({"detection_sets": people.sets})
    told = (*cameras.notices, *people.told())
    return ContinuousTask(StageContext(cameras, people.skeleton), recording, config, people.joint_names, told)


def solve_continuous(task: ContinuousTask, progress: Progress) -> ContinuousMotion:
    """Return the motion of all people.

    Raises:
        UserError: if the rig or the recording cannot be used.
    """
    return ContinuousPass(task.config, task.context).run(task.recording, progress)


def read_instants(path: Path) -> Array:
    """Return the instants (T,) ns of a CSV file with a column `stamp_ns`, in increasing order.

    Raises:
        DataError: naming the file and the fault.
    """
    rows = csv.DictReader(read_bytes(path).decode("utf-8", "replace").splitlines())
    if COLUMN not in (rows.fieldnames or ()):
        raise DataError(f"{path} has no column {COLUMN}; the first line names the columns")
    with parsing(path):
        stamps = np.array([int(row[COLUMN]) for row in rows], np.int64)
    if not len(stamps):
        raise DataError(f"{path} has no row; give one instant per row")
    return np.unique(stamps)
