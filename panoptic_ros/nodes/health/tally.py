"""Counters and log lines of a node about its stages.

A notice of a stage gives one log line per event. Counts and the newest text go to /diagnostics.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.stage import Notice

CALM_S = 10.0  # s without a notice of this kind, after which the next one is a new event


class NoticeLog:
    """Log of the first notice of an event per camera or device; counts the notices that follow.

    Args:
        now_s: returns the time of a monotonic clock, s.
    """

    def __init__(self, logger: Any, statistics: StageStatistics, now_s: Callable[[], float] = time.monotonic):
        self._logger = logger
        self._statistics = statistics
        self._now_s = now_s
        self._newest: dict[tuple[str, str], float] = {}
        self.events = 0  # number of logged events

    def tell(self, notice: Notice) -> None:
        """Count a notice, and log it if it is the first of its event."""
        self._statistics.take(notice)
        key = notice.code, str(notice.values.get("device", notice.values.get("camera", "")))
        now, before = self._now_s(), self._newest.get(key)
        self._newest[key] = now
        if notice.severity != "info" and (before is None or now - before > CALM_S):
            self.events += 1
            self._logger.warning(f"{notice.code}: {notice.text} (the like is counted on /diagnostics)")


QUIET_S = 5.0  # s between log lines about refused records
MOST_REFUSED = 90  # refused records in a row: three seconds at 30 Hz
FARTHEST_NS = 3_600_000_000_000  # 1 h; a timestamp farther from the current time is on another clock


class Tally:
    """Counters by stage.

    Args:
        stages: names.
    """

    def __init__(self, logger: Any, stages: Sequence[str]):
        self._logger = logger
        self.statistics = {stage: StageStatistics() for stage in stages}
        self._logs = {stage: NoticeLog(logger, own) for stage, own in self.statistics.items()}
        self._refused = dict.fromkeys(stages, 0)  # refused records in a row, by stage
        self._said_s = -QUIET_S

    @property
    def first(self) -> str:
        """Return the name of the first stage."""
        return next(iter(self.statistics))

    def stepped(self, stage: str, duration_ns: int) -> None:
        """Count a record that a stage has processed, and its duration (ns)."""
        self._refused[stage] = 0
        self.statistics[stage].taken += 1
        self.statistics[stage].add_duration(duration_ns)

    def used(self, stage: str, cpu_ns: int) -> None:
        """Add processor time (ns) to a stage."""
        self.statistics[stage].cpu_ns += cpu_ns

    def gave(self, stage: str, latency_ns: int | None) -> None:
        """Count an output record of a stage.

        Args:
            latency_ns: time since the timestamp of the record, live only.
        """
        self.statistics[stage].given += 1
        if latency_ns is not None and abs(latency_ns) < FARTHEST_NS:
            self.statistics[stage].add_latency(latency_ns)

    def tell(self, stage: str, notice: Notice) -> None:
        """Count and log a notice of a stage."""
        self._logs[stage].tell(notice)

    def refuse(self, stage: str, error: PanopticError) -> None:
        """Count a dropped bad message for a stage; log at most one line per `QUIET_S`."""
        self.statistics[stage].dropped["bad_message"] += 1
        if time.monotonic() - self._said_s >= QUIET_S:
            self._said_s = time.monotonic()
            self._logger.warning(f"dropped: {error}")

    @property
    def events(self) -> int:
        """Return the number of logged events of all stages."""
        return sum(log.events for log in self._logs.values())

    def has_taken(self, stage: str) -> bool:
        """Return whether a stage has processed any record."""
        return self.statistics[stage].taken > 0

    def refuses_all(self, stage: str) -> bool:
        """Count a refusal and return whether the stage has refused `MOST_REFUSED` records in a row.

        Call this after each refusal.
        """
        self._refused[stage] += 1
        spoilt = self._refused[stage] >= MOST_REFUSED
        if spoilt:
            self._refused[stage] = 0
        return spoilt

    def dropped(self, stage: str, cause: str, count: int) -> None:
        """Add a number of dropped records to a stage, by cause."""
        self.statistics[stage].dropped[cause] += count
