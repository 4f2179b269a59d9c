"""The self-check of the calibration, as soon as there are people enough to judge by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from panoptic_ros.domain import ClockModel, ViewDetections
from panoptic_ros.evaluation.rig_check import check_rig
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.regrouping import regrouped
from panoptic_ros.stage import Notice

INSTANTS = 30  # looked at; a second or so of a capture


class StartupCheck:
    """Watches the first views of a run, then says in plain words whether they agree.

    Args:
        on_judged: called once with the notices.
    """

    def __init__(self, plan: Plan, on_judged: Callable[[tuple[Notice, ...]], None]):
        self._plan = plan
        self._on_judged = on_judged
        self._views: list[ViewDetections] = []
        self._clocks: dict[str, ClockModel] = {}
        self.notices: tuple[Notice, ...] | None = None  # None: not judged yet

    def saw(self, key: str, record: Any) -> None:
        """A record of the topic of that key; enough instants are judged at once."""
        if self.notices is not None:
            return
        if key == "detections":
            self._views.append(record)
        if key == "clock_models":
            self._clocks[record.device] = record
        if key == "skeletons" and len(self._views) >= INSTANTS * len(self._plan.rig):
            self.judge()

    def judge(self) -> tuple[Notice, ...]:
        """Judge by what has come, unless that was done."""
        if self.notices is None and not self._plan.rig.cameras:
            self.notices = ()
        if self.notices is None:
            sets = regrouped(self._plan, self._clocks.values(), self._views)
            report = check_rig(self._plan.rig, sets, self._plan.skeleton)
            self.notices = tuple(report.notices)
            self._views.clear()
            self._on_judged(self.notices)
        return self.notices
