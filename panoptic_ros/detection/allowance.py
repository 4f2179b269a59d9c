"""Limit on the number of looks in live runs, so that looks never delay the propagation of people.

Looks fall due in bursts: at the start, after an alarm, after people were lost, after images were skipped.
Running all at once would delay the next images. These would be skipped, and all cameras would fall due again.
So every image earns its share of a look, even after skipped images, and looks spend these shares. The camera
that has waited longest comes first.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

SECOND = 10**9
SPARE = 1.0  # looks; maximum balance beyond the share of one round of images
SCAN = 0.5  # cost of a scan for new people, in looks
FORGOTTEN = 4  # rounds of images after which a waiting camera without images leaves the queue
FIRST_PERIOD_NS = SECOND // 30  # assumed time between images, until it is measured


@dataclass
class _CameraStamp:
    stamp_ns: int
    number: int


class Allowance:
    """Account of the looks available to a rig. Several cameras may call it concurrently."""

    def __init__(self, cameras: int):
        self._count = cameras
        self._left = math.inf
        self._images = 0
        self._period_ns = FIRST_PERIOD_NS
        self._cameras: dict[str, _CameraStamp] = {}
        self._waiting: dict[str, int] = {}  # longest wait first; value: image count at last request
        self._asking = threading.Lock()

    def takes(self, camera: str, stamp_ns: int, number: int, looks_per_s: float, wanted: bool) -> bool:
        """Return whether the network may run on an image; call it once per image.

        Args:
            number: Number of the frame. Skipped frames count as well.
            looks_per_s: Rate of each camera; 0: the network runs on every image.
            wanted: Whether a look is due.
        """
        with self._asking:
            self._learn(camera, stamp_ns, number)
            share = looks_per_s * self._period_ns / SECOND
            if not 0.0 < share < 1.0:
                return wanted
            self._images += 1
            self._left = min(self._left + share, self._count * share + SPARE)
            if not wanted and camera not in self._waiting:
                return False
            old = self._images - FORGOTTEN * self._count
            self._waiting = {name: last for name, last in self._waiting.items() if last > old}
            self._waiting[camera] = self._images
            if self._left <= list(self._waiting).index(camera):
                return False
            del self._waiting[camera]
            self._left -= 1.0
            return True

    def scanned(self) -> None:
        """Account for a scan, which runs without asking: new people must not wait."""
        with self._asking:
            self._left -= SCAN

    def _learn(self, camera: str, stamp_ns: int, number: int) -> None:
        known = self._cameras.get(camera)
        if known is not None and stamp_ns > known.stamp_ns and number > known.number:
            self._period_ns = (stamp_ns - known.stamp_ns) // (number - known.number)
        self._cameras[camera] = _CameraStamp(stamp_ns, number)
