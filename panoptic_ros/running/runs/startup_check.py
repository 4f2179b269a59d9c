"""The self-check of the calibration, as soon as there are people enough to judge by.

Detection sets of a run, made once more from its views: by the last clocks that it found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from panoptic_ros.domain import ClockModel, DetectionSet, ViewDetections
from panoptic_ros.evaluation.rig_check import check_rig
from panoptic_ros.graph.build import make_stage
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Notice, StageContext


def regrouped(
    plan: Plan, clocks: Iterable[ClockModel], views: Iterable[ViewDetections]
) -> list[DetectionSet]:
    """The views put together as the graph does.

    Args:
        clocks: at most one model of each clock.
    """
    stage = make_stage("sync", plan.configs["sync"], StageContext(plan.rig, plan.skeleton))
    side_by_side = sorted(views, key=lambda view: plan.at(view.camera, view.stamp_ns))
    steps = [stage.step(item) for item in (*clocks, *side_by_side)]
    return [item for result in (*steps, stage.flush()) for item in result.outputs]


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
