"""What stages notice: a line in the log for each event, counts and the newest text on /diagnostics."""
from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.stage import Notice

CALM_S = 10.0  # without the like of it: then a notice tells of another event


class News:
    """Logs the first notice of an event, for every camera or device apart, and counts those that follow.

    Args:
        now_s: a clock that never goes back.
    """

    def __init__(self, logger: Any, statistics: StageStatistics, now_s: Callable[[], float] = time.monotonic):
        self._logger = logger
        self._statistics = statistics
        self._now_s = now_s
        self._newest: dict[tuple[str, str], float] = {}

    def tell(self, notice: Notice) -> None:
        """Take a notice."""
        self._statistics.take(notice)
        key = notice.code, str(notice.values.get("device", notice.values.get("camera", "")))
        now, before = self._now_s(), self._newest.get(key)
        self._newest[key] = now
        if notice.severity != "info" and (before is None or now - before > CALM_S):
            self._logger.warning(f"{notice.code}: {notice.text} (the like is counted on /diagnostics)")
