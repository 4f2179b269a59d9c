"""Checks the calibration at the start of a run, as soon as enough people were detected.

The check regroups the views of the run into detection sets, by the newest clock models.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from panoptic_ros.domain import ClockModel, DetectionSet, ViewDetections
from panoptic_ros.evaluation.rig_check import check_rig
from panoptic_ros.running.grouping import grouped
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Notice, StageContext


def regrouped(
    plan: Plan, clocks: Iterable[ClockModel], views: Iterable[ViewDetections]
) -> list[DetectionSet]:
    """Group views into detection sets as the graph does.

    Args:
        clocks: at most one model per clock.
    """
    side_by_side = sorted(views, key=lambda view: plan.at(view.camera, view.stamp_ns))
    sets, _ = grouped(plan.configs, StageContext(plan.rig, plan.skeleton), (*clocks, *side_by_side))
    return sets


INSTANTS = 30  # instants used for the check; about 1 s of a capture


class StartupCheck:
    """Checks the first views of a run for agreement with the calibration.

    Args:
        on_judged: callback with the notices, called once.
    """

    def __init__(self, plan: Plan, on_judged: Callable[[tuple[Notice, ...]], None]):
        self._plan = plan
        self._on_judged = on_judged
        self._views: list[ViewDetections] = []
        self._clocks: dict[str, ClockModel] = {}
        self.notices: tuple[Notice, ...] | None = None  # None: the check has not run yet

    def saw(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key. Run the check once enough instants have arrived."""
        if self.notices is not None:
            return
        if key == "detections":
            self._views.append(record)
        if key == "clock_models":
            self._clocks[record.device] = record
        if key == "skeletons" and len(self._views) >= INSTANTS * len(self._plan.rig):
            self.judge()

    def judge(self) -> tuple[Notice, ...]:
        """Run the check on the views received so far, unless it has run already; return its notices."""
        if self.notices is None and not self._plan.rig.cameras:
            self.notices = ()
        if self.notices is None:
            sets = regrouped(self._plan, self._clocks.values(), self._views)
            report = check_rig(self._plan.rig, sets, self._plan.skeleton)
            self.notices = tuple(report.notices)
            self._views.clear()
            self._on_judged(self.notices)
        return self.notices
