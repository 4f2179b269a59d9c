"""Live: times by which images of several cameras are put together, whatever their clocks say."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NamedTuple

from panoptic_ros.stage import Notice
from panoptic_ros.sync.agreement import Agreement


class ImageStamp(NamedTuple):
    """The stamp of an image that has arrived; see `sync.agreement.StampedFrame`."""

    camera: str
    stamp_ns: int
    frame_number: int


class AlignedTimes:
    """Gives images of cameras whose clock disagrees with the majority their time by arrival.

    So a camera with wrong stamps is put together with the images that arrive with its own, and does not keep
    the others from being taken. It is named by its images, before a busy detector has looked at any of them.
    `sync` decides by the same rules whether its stamps are used. May be used by several threads.

    Args:
        cameras: names in the order of the rig.
    """

    def __init__(self, cameras: Sequence[str]):
        self._agreement: Agreement[ImageStamp] = Agreement(cameras)
        self._counts = dict.fromkeys(cameras, 0)
        self._lock = threading.Lock()

    def time_of(self, camera: str, stamp_ns: int, came_ns: int, host_ns: int) -> tuple[int, list[Notice]]:
        """Return the time of an image on the clock of the majority, ns, and notices about its camera.

        Args:
            came_ns, host_ns: its arrival on a monotonic clock and on the clock of the host.
        """
        with self._lock:
            self._counts[camera] += 1
            image = ImageStamp(camera, stamp_ns, self._counts[camera])
            agreeing, notices = self._agreement.take(image, came_ns, host_ns)
            offset = self._agreement.offset
        told = [notice for notice in notices if notice.code.startswith("sync.clock_")]
        if image in agreeing or offset is None:
            return stamp_ns, told
        return came_ns + offset, told
