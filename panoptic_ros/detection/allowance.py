"""Live: how much may be looked at, so that looks never hold up what is carried.

What is due comes in bursts: at the start, after an alarm, where people were lost, after a time in which
images were left out. Looked at at once, it holds up the images that follow, which are left out, and all
cameras are due again. So every image brings its share of a look, whatever was left out before it, and looks
take from what is there; who waits longest comes first.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

SECOND = 10**9
SPARE = 1.0  # looks beyond one round of images that may be saved
SCAN = 0.5  # what a scan for newcomers costs, in looks
FORGOTTEN = 4  # rounds of images after which a camera that waits and gives no more is not minded
FIRST_PERIOD_NS = SECOND // 30  # between images, while that is not known


@dataclass
class _Camera:
    stamp_ns: int
    number: int


class Allowance:
    """Looks that are left for a rig of so many cameras. May be asked for several of them at a time."""

    def __init__(self, cameras: int):
        self._count = cameras
        self._left = math.inf
        self._images = 0
        self._period_ns = FIRST_PERIOD_NS
        self._cameras: dict[str, _Camera] = {}
        self._waiting: dict[str, int] = {}  # who waits longest is first; at which image it was there last
        self._asking = threading.Lock()

    def takes(self, camera: str, stamp_ns: int, number: int, looks_per_s: float, wanted: bool) -> bool:
        """Whether an image may be looked at; call it once for each.

        Args:
            number: of the frame: those that nobody took count as well.
            looks_per_s: of each camera; 0: every image is looked at.
            wanted: whether a look is due.
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
        """A small whole image is looked at besides: newcomers must not wait."""
        with self._asking:
            self._left -= SCAN

    def _learn(self, camera: str, stamp_ns: int, number: int) -> None:
        known = self._cameras.get(camera)
        if known is not None and stamp_ns > known.stamp_ns and number > known.number:
            self._period_ns = (stamp_ns - known.stamp_ns) // (number - known.number)
        self._cameras[camera] = _Camera(stamp_ns, number)
