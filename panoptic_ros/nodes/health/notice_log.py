"""Notices of stages: one line in the log for each event; counts and the newest text on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.stage import Notice

CALM_S = 10.0  # without such a notice; the next one is then about another event


class NoticeLog:
    """Logs the first notice of an event of each camera or device, and counts those that follow.

    Args:
        now_s: a monotonic clock, s.
    """

    def __init__(self, logger: Any, statistics: StageStatistics, now_s: Callable[[], float] = time.monotonic):
        self._logger = logger
        self._statistics = statistics
        self._now_s = now_s
        self._newest: dict[tuple[str, str], float] = {}
        self.events = 0  # that were logged

    def tell(self, notice: Notice) -> None:
        """Count a notice, and log it if it is the first of its event."""
        self._statistics.take(notice)
        key = notice.code, str(notice.values.get("device", notice.values.get("camera", "")))
        now, before = self._now_s(), self._newest.get(key)
        self._newest[key] = now
        if notice.severity != "info" and (before is None or now - before > CALM_S):
            self.events += 1
            self._logger.warning(f"{notice.code}: {notice.text} (the like is counted on /diagnostics)")
