"""Reads the views of a recording one by one, with timestamps on the master time line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.io.interruption import interrupted
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.stage import Notice, Progress
from panoptic_ros.stamps.correction import StampCorrection
from panoptic_ros.sync.config import SyncConfig


class _Views:
    """Receiver of detections and clock models; it keeps the views with timestamps on the master time line."""

    def __init__(self, plan: Plan, progress: Progress, maps: bool):
        self.views: list[ViewDetections] = []
        self.notices: list[Notice] = []
        clocks = {camera.name: camera.clock for camera in plan.rig.cameras}
        sync = config_of(plan.configs, SyncConfig)
        self._correction = StampCorrection(clocks, sync.clocks, sync.delays_ms, sync.queue_limit)
        self._progress, self._total, self._count = progress, plan.frame_count or 0, 0
        self._maps = maps

    def take(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key."""
        if key == "clock_models":
            self._keep(*self._correction.clock(record))
        elif key == "detections":
            self._count += 1
            self._progress(min(1.0, self._count / max(self._total, self._count)), "reading views")
            maps = record.maps if self._maps else None
            self._keep(*self._correction.view(replace(record, maps=maps, limit=None)))

    def end(self, cameras: Iterable[str]) -> None:
        """Drop the views that still wait for a clock, with a notice."""
        for name in cameras:
            self.notices += self._correction.end(name)

    def _keep(self, views: Iterable[ViewDetections], notices: Iterable[Notice]) -> None:
        self.views += views
        self.notices += notices


class _Sets:
    """Receiver of detection sets; it keeps them without score maps."""

    def __init__(self) -> None:
        self.sets: list[DetectionSet] = []

    def take(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key."""
        if key == "detection_sets":
            views = tuple(replace(view, maps=None, limit=None) for view in record.views)
            self.sets.append(replace(record, views=views))


def plan_recording(capture: Path | None, bags: Sequence[Path], rig: Path | Rig | None, skeleton: str) -> Plan:
    """Return the plan of a capture folder or of bags.

    Args:
        capture: folder; used if there are no bags.
        rig: calibration, or its file; None = that of the capture or bag.
        skeleton: working skeleton; "" = the usual one.

    Raises:
        UserError: on any fault that the user can fix.
    """
    options = RunOptions(skeleton=skeleton)
    if bags or capture is None:
        return plan_bags(bags, options, rig=rig)
    return plan_capture(capture, options, rig=rig)


def recorded_sets(bag: Path, rig: Rig) -> tuple[list[DetectionSet], SkeletonModel]:
    """Return the detection sets of a bag, and their skeleton model. Images go through detection.

    Args:
        rig: calibration; it replaces that of the bag.

    Raises:
        UserError: if the bag cannot be read, or is of other cameras.
        KeyboardInterrupt: if a request to end has arrived.
    """
    plan, found = plan_bags([bag], rig=rig), _Sets()
    run_in_process(replace(plan, views_only=True), found, interrupted)
    if interrupted():
        raise KeyboardInterrupt
    return found.sets, plan.skeleton


def recorded_views(
    plan: Plan, progress: Progress, maps: bool = False
) -> tuple[list[DetectionSet], list[str]]:
    """Return the views of a plan on a recording as sets of one view each, and lines about faults.

    Images go through detection. The views of a camera keep their order.

    Args:
        maps: keep score maps, which take much memory.

    Raises:
        UserError: if the recording cannot be read.
        KeyboardInterrupt: if a request to end has arrived.
    """
    views = _Views(plan, progress, maps)
    counted = run_in_process(replace(plan, views_only=True), views, interrupted)
    if interrupted():
        raise KeyboardInterrupt
    views.end(plan.rig.names)
    sets = [DetectionSet(k, view.stamp_ns, view.skeleton_hash, (view,)) for k, view in enumerate(views.views)]
    told = {notice.code: notice.text for notice in views.notices if notice.severity != "info"}
    for name, stage in counted.items():
        if name != "sync":  # it judges sets, which are not used
            told |= {code: stage.latest(code) for code in stage.warned}
    return sets, list(told.values())
