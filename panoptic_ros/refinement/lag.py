"""Due time and instant of a result: the meaning of the parameter `lag`.

A result uses views up to its instant plus the lag, and waits for no later ones. If cameras are not
synchronous, the newest view of a set is at n, after the timestamp t of the set. The set can only be used as a
whole. If the lag is shorter than n - t, the result is for the later instant n - lag.

If a further set is expected after t + lag but before n + lag, the result waits for it as well. The instant of
the result then also lies between t and n.
"""

from __future__ import annotations

from panoptic_ros.domain import TrackedPoseSet

SLACK = 0.1  # frame periods, tolerance of the lag, because timestamps jitter
LONGER = 1.2  # largest growth factor of the expected period from one set to the next


class LagSchedule:
    """Timing of the sets that were received, from their timestamps alone."""

    def __init__(self, lag: float):
        self._lag_ns = round(1e9 * lag)
        self._period = 0
        self._newest = 0
        self._last: int | None = None

    def take(self, item: TrackedPoseSet) -> None:
        """Register one more set."""
        if self._last is not None:
            interval = item.stamp_ns - self._last
            self._period = min(interval, round(LONGER * self._period)) if self._period else interval
        self._last, self._newest = item.stamp_ns, item.newest_ns

    def is_due(self, item: TrackedPoseSet) -> bool:
        """Return whether the next set would arrive too late for the result of this set."""
        late = self._newest + self._period - self._lag_ns - self._slack
        alone = item.stamp_ns == self._last
        return late >= (item.newest_ns if alone else item.stamp_ns)

    def instant_ns(self, item: TrackedPoseSet) -> int:
        """Return the instant (ns) of this set's result, given all sets that were received."""
        wanted = self._newest - self._lag_ns
        if wanted <= item.stamp_ns + self._slack:
            return item.stamp_ns
        half = item.stamp_ns + self._period // 2  # a later result would look like that of the next set
        instant = min(wanted, item.newest_ns)
        return half if 0 <= instant - half <= self._slack else instant

    @property
    def _slack(self) -> int:
        return round(SLACK * self._period)
