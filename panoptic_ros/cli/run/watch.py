"""Terminal output during a run: a progress bar or the live table, and warnings."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.finish import NoOutputTimer, dropped_in_all, warnings_of
from panoptic_ros.running.runs.run import RunObserver
from panoptic_ros.running.takes import named_unclosed_takes
from panoptic_ros.stage import Notice
from panoptic_ros.view.live_table import LiveTable
from panoptic_ros.view.progress import ProgressBar

EACH_TEXT = "sync.clock_off"  # printed once for each text: each camera and each clock offset
EACH = (  # prefixes of codes that are printed once for each device
    "kinematics.imu_",
    "kinematics.odd_",
    "kinematics.never_",
    "kinematics.mounting",
    "kinematics.strap",
    "graph.unusable",
    "graph.encoding",
)
PATIENCE_S = 10.0  # s without a result after the first detections
START_S = 20.0  # s without a result since the start, live only


class TerminalObserver(RunObserver):
    """Terminal output of a run; a context manager that restores the terminal.

    Args:
        table: show the live table instead of the progress bar.
    """

    def __init__(self, table: bool):
        self._with_table = table
        self._table: LiveTable | None = None
        self._bar: ProgressBar | None = None
        self._live, self._has_cameras = False, True
        self._instants = 0
        self._waiting = NoOutputTimer(_warn)
        self._told: set[str] = set()

    def started(self, plan: Plan) -> None:
        """Begin to draw."""
        if plan.live:
            for line in named_unclosed_takes():
                _warn(f"warning: {line}")
        self._live, self._has_cameras = plan.live, bool(plan.rig.cameras)
        if self._with_table:
            self._table = LiveTable(plan.rig.names, plan.skeleton)
        else:
            self._bar = ProgressBar(
                None if plan.live else plan.instants, "skeletons" if plan.rig.cameras else "bodies"
            )
        if plan.live and plan.rig.cameras:
            self._waiting.begin(START_S)

    def saw(self, key: str, record: Any) -> None:
        """Update the output with a record; see `RunObserver`."""
        if key == "detections":
            self._waiting.begin(PATIENCE_S)
        if key == "detections" and self._table is not None:
            self._table.saw_view(record.camera, len(record.person_scores))
        if key == "skeletons":
            self._waiting.end()
            if self._table is not None:
                self._table.saw_poses(record, self._latency_ms(record.stamp_ns))
            self._count()
        if key == "bodies" and not self._has_cameras:
            self._count()
        if key == "diagnostics":
            self._waiting.counted = record
            self._tell_of(record)
            if self._table is not None:
                self._table.set_dropped(dropped_in_all(record))

    def _count(self) -> None:
        self._instants += 1
        if self._bar is not None:
            self._bar.update(self._instants)

    def judged(self, notices: Sequence[Notice]) -> None:
        """Print all notices that are not mere information."""
        for notice in notices:
            if notice.severity != "info":
                _warn(f"{notice.severity}: {notice.text}")

    def _tell_of(self, counted: Mapping[str, Mapping[str, str]]) -> None:
        """Print the warnings of stages once for each kind, and those in `EACH` once for each device."""
        for notice in warnings_of(counted):
            about = notice.values.get("device", "") if notice.code.startswith(EACH) else ""
            kind = f"{notice.code} {notice.text if notice.code == EACH_TEXT else about}"
            if kind not in self._told:
                self._told.add(kind)
                _warn(f"warning: {notice.text}")

    def ended(self) -> None:
        """Stop drawing."""
        self._waiting.end()
        if self._table is not None:
            self._table.close()
        if self._bar is not None:
            self._bar.close()
        self._table = self._bar = None

    def drew(self, done: int, total: int) -> None:
        """Show the progress of the overlays; see `RunObserver`."""
        self._bar = self._bar or ProgressBar(total, "overlays")
        self._bar.update(done)

    def _latency_ms(self, stamp_ns: int) -> float | None:
        """Return the latency since exposure, ms; None for recordings: their timestamps lie in the past."""
        return (time.time_ns() - stamp_ns) * 1e-6 if self._live else None

    def __enter__(self) -> TerminalObserver:
        return self

    def __exit__(self, *exception: object) -> None:
        self.ended()


def _warn(text: str) -> None:
    print(f"\n{text}", file=sys.stderr, flush=True)
