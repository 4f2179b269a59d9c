"""When a result is due, and for which instant: the meaning of `lag`.

A result for an instant uses views up to the instant plus the lag, and waits for no others. A set of instant t
whose newest view is at n > t (cameras that are not synchronous) can only be used as a whole. So where the
lag is shorter than n - t, the result is for the later instant n - lag; and where one more set comes within
the lag after n, but not after t, the result waits for it and is for an instant between t and n, too.
"""

from __future__ import annotations

from panoptic_ros.domain import TrackedPoseSet

SLACK = 0.1  # frame periods by which sets may come later than the lag allows: stamps jitter
LONGER = 1.2  # how much the expected period may grow from one set to the next


class Clock:
    """Knows the sets that were taken, by their stamps alone."""

    def __init__(self, lag: float):
        self._lag_ns = round(1e9 * lag)
        self._period = 0
        self._newest = 0
        self._last: int | None = None

    def take(self, item: TrackedPoseSet) -> None:
        """One more set."""
        if self._last is not None:
            interval = item.stamp_ns - self._last
            self._period = min(interval, round(LONGER * self._period)) if self._period else interval
        self._last, self._newest = item.stamp_ns, item.newest_ns

    def is_due(self, item: TrackedPoseSet) -> bool:
        """Whether the next set would come too late for this one."""
        late = self._newest + self._period - self._lag_ns - self._slack
        alone = item.stamp_ns == self._last
        return late >= (item.newest_ns if alone else item.stamp_ns)

    def instant_ns(self, item: TrackedPoseSet) -> int:
        """The instant of this set's result, with all that was taken."""
        wanted = self._newest - self._lag_ns
        if wanted <= item.stamp_ns + self._slack:
            return item.stamp_ns
        half = item.stamp_ns + self._period // 2  # results later than that look like the next set's
        instant = min(wanted, item.newest_ns)
        return half if 0 <= instant - half <= self._slack else instant

    @property
    def _slack(self) -> int:
        return round(SLACK * self._period)
