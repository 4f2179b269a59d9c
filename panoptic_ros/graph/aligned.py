"""Live: times by which images of several cameras are put together, whatever their clocks say."""
from __future__ import annotations

import threading
from collections.abc import Iterable

from panoptic_ros.sync.majority import Majority


class AlignedTimes:
    """Gives images of cameras whose clock disagrees with the majority their time by arrival.

    So a camera with wrong stamps is put together with the images that come with its own, and does not keep
    the others from being taken. `sync` decides whether its stamps are used. May be used by several threads.
    """

    def __init__(self, cameras: Iterable[str]):
        self._majority = Majority(cameras)
        self._lock = threading.Lock()

    def time_of(self, camera: str, stamp_ns: int, came_ns: int) -> int:
        """Return the time of an image on the clock of the majority, ns.

        Args:
            came_ns: its arrival on a monotonic clock.
        """
        with self._lock:
            return self._time_of(camera, stamp_ns, came_ns)

    def _time_of(self, camera: str, stamp_ns: int, came_ns: int) -> int:
        majority = self._majority
        offset = majority.vote(camera, stamp_ns, came_ns)
        if majority.agrees(offset):
            return stamp_ns
        groups = majority.groups(came_ns)
        ruling = max((len(group.names) for group in groups if majority.agrees(group.offset)), default=0)
        if majority.offset is None or len(groups[0].names) > ruling:
            majority.offset = groups[0].offset
        return stamp_ns if majority.agrees(offset) else came_ns + majority.offset
