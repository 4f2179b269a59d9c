"""What a node counts about its stages, and what it says of it in the log.

Notices of stages: one line in the log for each event; counts and the newest text on /diagnostics.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from panoptic_ros.errors import PanopticError
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


QUIET_S = 5.0  # between lines about what was refused
MOST_REFUSED = 90  # records one after another: three seconds at 30 Hz
FARTHEST_NS = 3_600_000_000_000  # a stamp that is farther from now is on another clock


class Tally:
    """Counts by stage.

    Args:
        stages: names.
    """

    def __init__(self, logger: Any, stages: Sequence[str]):
        self._logger = logger
        self.statistics = {stage: StageStatistics() for stage in stages}
        self._logs = {stage: NoticeLog(logger, own) for stage, own in self.statistics.items()}
        self._refused = dict.fromkeys(stages, 0)  # one after another
        self._said_s = -QUIET_S

    @property
    def first(self) -> str:
        """The first stage."""
        return next(iter(self.statistics))

    def stepped(self, stage: str, duration_ns: int) -> None:
        """A stage has taken a record."""
        self._refused[stage] = 0
        self.statistics[stage].taken += 1
        self.statistics[stage].add_duration(duration_ns)

    def used(self, stage: str, cpu_ns: int) -> None:
        """A stage has used so much processor time."""
        self.statistics[stage].cpu_ns += cpu_ns

    def gave(self, stage: str, latency_ns: int | None) -> None:
        """A stage has given a record, so long after its stamp (live)."""
        self.statistics[stage].given += 1
        if latency_ns is not None and abs(latency_ns) < FARTHEST_NS:
            self.statistics[stage].add_latency(latency_ns)

    def tell(self, stage: str, notice: Notice) -> None:
        """A notice of a stage."""
        self._logs[stage].tell(notice)

    def refuse(self, stage: str, error: PanopticError) -> None:
        """Something bad for a stage was dropped."""
        self.statistics[stage].dropped["bad_message"] += 1
        if time.monotonic() - self._said_s >= QUIET_S:
            self._said_s = time.monotonic()
            self._logger.warning(f"dropped: {error}")

    @property
    def events(self) -> int:
        """Return the number of events of which stages have warned."""
        return sum(log.events for log in self._logs.values())

    def has_taken(self, stage: str) -> bool:
        """Whether a stage has taken anything."""
        return self.statistics[stage].taken > 0

    def refuses_all(self, stage: str) -> bool:
        """Whether a stage that was asked has refused many records one after another; asked after each."""
        self._refused[stage] += 1
        spoilt = self._refused[stage] >= MOST_REFUSED
        if spoilt:
            self._refused[stage] = 0
        return spoilt

    def dropped(self, stage: str, cause: str, count: int) -> None:
        """So many records for a stage are gone."""
        self.statistics[stage].dropped[cause] += count
