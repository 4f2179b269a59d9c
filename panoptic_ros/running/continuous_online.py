"""Online motion as a function of time over a recording: the stage `continuous` without ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from panoptic_ros.continuous.config import MOST_HZ
from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.running.continuous import ContinuousTask
from panoptic_ros.stage import Notice, Progress, each

TOLD = 100  # number of views between two reports of progress


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

    The stage `continuous` takes the views one by one in the order of their timestamps, as in a graph.

    Raises:
        UserError: if the rig or the recording cannot be used.
    """
    sets = task.recording.records("detection_sets")
    views = sorted((view for item in sets for view in item.views), key=lambda view: view.stamp_ns)
    cameras = {view.camera for view in views}
    if len(cameras) < 2:
        only = f"views of {', '.join(cameras)} alone" if cameras else "no view"
        raise DataError(f"the recording has {only}; give 2D people of at least two cameras")
    found: list[RefinedPoseSet] = []
    told: list[Notice] = []
    views_needed = task.config.capture_views
    configs = configure(
        {"continuous": {"active": True, "rate_hz": rate, "lag": lag, "capture_views": views_needed}}
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
    first: dict[tuple[str, str], str] = {}  # by code and device
    for notice in told:
        if notice.severity != "info":
            first.setdefault((notice.code, str(notice.values.get("device", ""))), notice.text)
    return OnlineResult(found, list(first.values()))
