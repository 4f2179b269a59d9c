"""Online motion as a function of time over a recording: the stage `continuous` without ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.continuous.config import MOST_HZ
from panoptic_ros.continuous.faults import SampledMotion, clock_faults, fault_notices, views_without
from panoptic_ros.continuous.stamps import usable_views
from panoptic_ros.domain import RefinedPoseSet, ViewDetections
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.stage import Notice, Progress, each

TOLD = 100  # number of views between two reports of progress
MOST_PERIODS = 2.5  # periods of the instants, longest time between two instants of a person without a gap


class OnlineResult(NamedTuple):
    """Result of `solve_online`.

    Args:
        sets: people at the instants.
        notices: lines of the stage for the user.
    """

    sets: list[RefinedPoseSet]
    notices: list[str]

    @property
    def people(self) -> int:
        """Return the number of people."""
        return len({number for item in self.sets for number in item.ids.tolist()})


def check_online(options: Mapping[str, Any]) -> None:
    """Check that the online form can do as the options of `panoptic continuous` say.

    Raises:
        UsageError: naming an option that needs the whole recording, or a rate that is too high.
    """
    words = ("at", "clocks", "rolling_shutter", "trusted_camera", "clocks_out", "curves", "preset", "subject")
    given = [f"--{word.replace('_', '-')}" for word in words if options[word]]
    if given:
        raise UsageError(f"--lag does not go with {' and '.join(given)}, which need the whole recording")
    if options["rate"] > MOST_HZ:
        raise UsageError(f"--rate {options['rate']:g} with --lag is above {MOST_HZ:g} Hz; give a lower rate")


def solve_online(task: ContinuousTask, lag: float, rate: float, progress: Progress) -> OnlineResult:
    """Return the people at the instants k / rate, each from the views up to `lag` (s) later.

    The stage `continuous` takes the views one by one in the order of their timestamps, as in a graph. Views
    whose timestamps cannot be right are left out as without a lag: those of a camera that the people
    contradict lead to a second run.

    Raises:
        UserError: if the rig or the recording cannot be used.
    """
    context = task.context
    arrays, names = RigArrays.of(context.rig), context.rig.names
    views: dict[CameraFrame, ViewDetections] = {}
    for item in task.recording.records("detection_sets"):
        for view in item.views:
            single = replace(item, views=(view,))
            views |= dict.fromkeys(camera_frames([single], arrays, context.skeleton), view)
    cameras = {view.camera for view in views.values()}
    if len(cameras) < 2:
        only = f"views of {', '.join(cameras)} alone" if cameras else "no view"
        raise DataError(f"the recording has {only}; give 2D people of at least two cameras")
    frames, notices = usable_views(list(views), names)
    found, told = _followed(task, [views[frame] for frame in frames], lag, rate, progress)
    times = np.array([1e-9 * (frame.stamp_ns - frames[0].stamp_ns) for frame in frames])
    people = SampledMotion.of_sets(found, frames[0].stamp_ns, MOST_PERIODS / rate)
    faults = clock_faults(frames, times, people, arrays)
    if faults:
        notices += fault_notices(faults, names)
        kept = [views[frame] for frame in views_without(faults, frames, times)]
        found, told = _followed(task, kept, lag, rate, progress)
    first: dict[tuple[str, str], str] = {}  # by code and device
    for notice in (*notices, *told):
        if notice.severity != "info":
            first.setdefault((notice.code, str(notice.values.get("device", ""))), notice.text)
    return OnlineResult(found, list(first.values()))


def _followed(
    task: ContinuousTask, views: Sequence[ViewDetections], lag: float, rate: float, progress: Progress
) -> tuple[list[RefinedPoseSet], list[Notice]]:
    """Return the people and the notices of the stage from views in the order of their timestamps."""
    found: list[RefinedPoseSet] = []
    told: list[Notice] = []
    needed = task.config.capture_views
    configs = configure(
        {"continuous": {"active": True, "rate_hz": rate, "lag": lag, "capture_views": needed}}
    )
    pipeline = Pipeline(
        configs,
        task.context,
        ["continuous"],
        on_record=lambda topic, record: found.append(record),
        on_notice=lambda stage, notice: told.append(notice),
    )
    parts = [views[k : k + TOLD] for k in range(0, len(views), TOLD)]
    for part in each(parts, len(parts), progress, "following views"):
        for view in part:
            pipeline.push("detections", view)
    pipeline.flush()
    return found, told
