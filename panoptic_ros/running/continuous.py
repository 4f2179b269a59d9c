"""Turns 2D poses of a file, bag or capture folder into motion as a function of time, without ROS."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.subjects.passes import SubjectPass
from panoptic_ros.domain import Rig, ViewDetections
from panoptic_ros.errors import DataError, UsageError, shown
from panoptic_ros.evaluation.nobody import why_nobody
from panoptic_ros.evaluation.rig_check import check_rig
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.io.bags import bag_in
from panoptic_ros.io.body_models import read_body_model, read_body_shape
from panoptic_ros.io.detector_context import noise_only
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.io.loading import parsing, read_bytes
from panoptic_ros.io.recorded_people import AUTO, read_people
from panoptic_ros.running.grouping import grouped, views_in_order
from panoptic_ros.running.plans.rig_files import read_rig_at
from panoptic_ros.solving.capture_space import CAPTURE_VIEWS
from panoptic_ros.stage import Notice, Pass, Progress, StageContext, untold
from panoptic_ros.sync.far_views import without_far_views

Array = np.ndarray
COLUMN = "stamp_ns"
LEAST_PERIOD_NS = 20_000  # ns, between two images of the fastest cameras, at 50 kHz
DETECTION_FILES = ("detections.json.gz", "detections.json")  # files of 2D people in a capture folder


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
    rig: Path | Rig | None,
    detections: Path | None,
    options: tuple[bool, bool, str, int | None] = (False, False, "", None),
    skeleton: str = AUTO,
    *,
    capture: Path | None = None,
    bags: Sequence[Path] = (),
    maps: bool = False,
    progress: Progress = untold,
) -> ContinuousTask:
    """Read the input of the pass: a file of 2D people, a capture folder, or bags.

    Args:
        rig: calibration, or its file; None = that of the capture or bag.
        maps: keep the score maps of the views.
        options: values of `ContinuousConfig`; None = usual number of `capture_views`.
        capture: folder with 2D people or images, or results of `panoptic run`. Images go through detection.

    Raises:
        UserError: on any input fault that the user can fix.
    """
    config = ContinuousConfig(*options[:3], options[3] or CAPTURE_VIEWS)
    task = _read_task(rig, detections, config, skeleton, capture, bags, maps, progress)
    _check_unit(views_in_order(task.recording.records("detection_sets")))
    return task


def _read_task(
    rig: Path | Rig | None,
    detections: Path | None,
    config: ContinuousConfig,
    skeleton: str,
    capture: Path | None,
    bags: Sequence[Path],
    maps: bool,
    progress: Progress,
) -> ContinuousTask:
    sources = {"--detections": detections, "a capture folder": capture, "--bag": bags}
    given = [name for name, source in sources.items() if source]
    if len(given) != 1:
        raise UsageError(
            "give one of: a capture folder, --bag BAG, --rig R --detections D; found "
            f"{' and '.join(given) or 'none'}"
        )
    if capture is not None:
        found = bag_in(capture)
        bags = [] if found is None else [found]
        files = [capture / name for name in DETECTION_FILES if (capture / name).is_file()]
        if files and not bags:
            rig, detections = rig or capture, files[0]
    if detections is not None:
        if rig is None:
            raise UsageError("--detections needs --rig, the calibration of the cameras")
        return _file_task(rig, detections, config, skeleton)
    # imported here because plans load for half a second
    from panoptic_ros.running.runs.recorded_views import plan_recording, recorded_views

    plan = plan_recording(capture, bags, rig, "" if skeleton == AUTO else skeleton)
    sets, told = recorded_views(plan, progress, maps)
    context = StageContext(plan.rig, plan.skeleton)
    recording = InMemoryRecording({"detection_sets": sets})
    usual = noise_only(plan.skeleton.bias_floors)  # a line that concerns every recording
    told = [*(line for line in plan.notices if line not in usual), *told]
    return ContinuousTask(context, recording, config, plan.joint_names, tuple(told))


def _file_task(rig: Path | Rig, detections: Path, config: ContinuousConfig, skeleton: str) -> ContinuousTask:
    cameras = rig if isinstance(rig, Rig) else read_rig_at(rig)
    people = read_people(detections, cameras, skeleton, any_order=True)
    told = (*cameras.notices, *people.told())
    context = StageContext(cameras, people.skeleton)
    recording = InMemoryRecording({"detection_sets": people.sets})
    return ContinuousTask(context, recording, config, people.joint_names, told)


def without_wrong_stamps(task: ContinuousTask) -> ContinuousTask:
    """Return the task without views whose timestamps disagree with the majority of their set.

    Known clocks must be applied before, because they may be off by more.
    """
    sets, far = without_far_views(list(task.recording.records("detection_sets")))
    recording = InMemoryRecording({"detection_sets": sets})
    return replace(task, recording=recording, notices=(*task.notices, *(notice.text for notice in far)))


def _check_unit(views: Sequence[ViewDetections]) -> None:
    """Check that timestamps can be in nanoseconds.

    Raises:
        DataError: if most views of a camera follow each other faster than any camera exposes.
    """
    stamps: dict[str, list[int]] = {}
    for view in views:
        stamps.setdefault(view.camera, []).append(view.stamp_ns)
    for camera, own in stamps.items():
        steps = np.diff(np.unique(own))
        if len(steps) and np.median(steps) < LEAST_PERIOD_NS:
            raise DataError(
                f"views of camera {camera} are {np.median(steps):.0f} ns apart, too near for any camera; "
                "give stamps in nanoseconds"
            )


def with_segments(context: StageContext) -> StageContext:
    """Return the context with the default skeleton of segments and its shape."""
    model = read_body_model()
    return replace(
        context, extras={**context.extras, "segments": model, "body_shape": read_body_shape(model)}
    )


def solve_continuous(
    task: ContinuousTask, progress: Progress, subject: Path | None = None
) -> ContinuousMotion:
    """Return the motion of all people.

    Args:
        subject: file of a designated person, who gets curves of joint angles.

    Raises:
        UserError: if the rig, the recording or the subject cannot be used.
    """
    work: Pass[ContinuousMotion]
    if subject is None:
        work = ContinuousPass(task.config, task.context)
    else:
        context = with_segments(task.context)
        work = SubjectPass(task.config, context, read_subject(subject, context.extras["segments"]))
    motion = work.run(task.recording, progress)
    return motion if motion.people else replace(motion, notices=(*motion.notices, *_why_nobody(task)))


def _why_nobody(task: ContinuousTask) -> list[Notice]:
    """Return a notice that explains why no person is found."""
    views = views_in_order(task.recording.records("detection_sets"))
    if not any(len(view.scores) for view in views):
        return [Notice("result.nobody", "warning", f"none of the {len(views)} views has a 2D person")]
    sets, _ = grouped(configure({}), task.context, views)
    warnings = check_rig(task.context.rig, sets, task.context.skeleton).warnings
    return why_nobody(sets, 0, warnings)


def read_instants(path: Path) -> Array:
    """Return the instants (T,) ns of a CSV file with a column `stamp_ns`, in increasing order.

    Raises:
        DataError: naming the file, the line and the fault.
    """
    rows = csv.DictReader(read_bytes(path).decode("utf-8-sig", "replace").splitlines())
    if COLUMN not in (rows.fieldnames or ()):
        raise DataError(f"{path} has no column {COLUMN}; the first line names the columns")
    stamps = []
    with parsing(path):
        for row in rows:
            text = row[COLUMN]
            try:
                stamp = np.int64(int(text))
            except (TypeError, ValueError, OverflowError):
                stamp = np.int64(-1)
            if stamp < 0:
                raise DataError(
                    f"{path}, line {rows.line_num}: {COLUMN} = {shown(text)} is not an integer number of ns "
                    "from 0 to 2^63 - 1"
                )
            stamps.append(stamp)
    if not stamps:
        raise DataError(f"{path} has no row; give one instant per row")
    return np.unique(stamps)


def check_outputs(files: Mapping[str, Path | None]) -> None:
    """Check that no two options name the same file.

    Args:
        files: the file of each option, None = not given.

    Raises:
        UsageError: naming both options and the file.
    """
    names: dict[Path, str] = {}
    for name, path in files.items():
        if path is not None:
            other = names.setdefault(path.resolve(), name)
            if other != name:
                raise UsageError(f"{other} and {name} name the same file, {path}; name two files")


def check_instants(stamps: Array, motion: ContinuousMotion) -> list[str]:
    """Return a line about instants (T,) ns outside of the recording.

    Raises:
        DataError: if all of them are outside.
    """
    outside = int(((stamps < motion.first_ns) | (stamps > motion.last_ns)).sum())
    span = f"of the recording, {motion.first_ns} to {motion.last_ns} ns"
    if outside == len(stamps):
        raise DataError(f"all {outside} instants of --at are outside {span}; are they of the same clock?")
    return [f"{outside} of {len(stamps)} instants of --at are outside {span}: nobody is there"] * (
        outside > 0
    )
